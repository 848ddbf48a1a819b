//! A stroke through a block: its steady force and work, and the energy release rate at its front.

use anyhow::{Context, Result};
use kerf_physics::Vec3;
use kerf_physics::scene::{MaterialDesc, RegionDesc};

use super::rig::{
    Hold, Rig, Setup, below, beyond, front_work_j_per_m2, ledger_residual, mean_force_n, spent_j_per_m2, sum,
};
use crate::verification::scenes::{Mesh, block};

/// Way of the edge into the block, over its height, where what counts as steady begins and ends.
const STEADY: [f64; 2] = [0.3, 0.45];
/// The same where cutting strains all of the block: what the start of the cut set free has come to rest.
const STRAINED_STEADY: [f64; 2] = [0.45, 0.6];
/// A block less than so many times Gc/E across is strained by cutting it, so that its force is 1 % off Gc w.
const LARGE: f64 = 50.0;
/// Height of a block that is strained over the thickness of its held layer.
const STRAINED_TALL: f64 = 48.0;
/// The edge goes on between states at rest by no more than this over Gc/E, nor over an element, and so often at most.
const MOST_ON: f64 = 1.5;
const MOST_ON_ELEMENTS: f64 = 0.25;
const MOST_PARTS: f64 = 16.0;
/// Speed between states at rest over the stroke's: a front that comes fast to where it rests goes too far.
const SLOWLY: f64 = 0.25;
/// Half-width of an edge that states none, m.
pub const EDGE_HALF_WIDTH_M: f64 = 5e-5;

/// The plane of a cut, by its lattice direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Plane {
    /// (1, 0, 0): straight down.
    Along,
    /// (1, 0, 1), one of the planes (1, 1, 0): straight down.
    Diagonal,
    /// (1, 1, 1): down along (1, -1, 0).
    Oblique,
}

impl Plane {
    /// How tables call it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Along => "(1,0,0)",
            Self::Diagonal => "(1,1,0)",
            Self::Oblique => "(1,1,1)",
        }
    }

    /// Unit vectors along the edge and of the cutting direction.
    fn directions(self) -> [Vec3; 2] {
        match self {
            Self::Along => [Vec3::z(), -Vec3::y()],
            Self::Diagonal => [Vec3::new(-1.0, 0.0, 1.0).normalize(), -Vec3::y()],
            Self::Oblique => [Vec3::new(-1.0, -1.0, 2.0).normalize(), Vec3::new(1.0, -1.0, 0.0).normalize()],
        }
    }
}

/// What a block stands in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Support {
    /// Its lowest layer is held.
    Bottom,
    /// The layers at its sides beside the cut are held, too.
    Sides,
}

/// A block and the blade that goes through it.
#[derive(Clone, Debug)]
pub struct Stroke {
    /// What the block is of.
    pub material: MaterialDesc,
    /// Where it is of something else.
    pub regions: Vec<RegionDesc>,
    /// Its discretisation.
    pub mesh: Mesh,
    /// Its size, m; the edge lies across z.
    pub size_m: [f64; 3],
    /// Thickness of the layers that are held, m.
    pub held_m: f64,
    /// Which ones are.
    pub support: Support,
    /// The plane of the cut.
    pub plane: Plane,
    /// Distance of the plane from the block's middle along x, m.
    pub off_m: f64,
    /// Speed of the blade, m/s.
    pub speed_m_per_s: f64,
    /// Steps per second, Hz.
    pub rate_hz: f64,
    /// Half-width of the edge, m.
    pub edge_half_width_m: f64,
    /// Factor on the penalties among the blade's contacts.
    pub penalty_factor: f64,
}

/// The steady part of a stroke.
#[derive(Clone, Copy, Debug)]
pub struct Steady {
    /// Mean force over Gc w.
    pub force: f64,
    /// Work of the tool less what is stored, over Gc A.
    pub work: f64,
    /// Sum of the ledger's residuals' sizes over the tool's work, over all of the run.
    pub residual: f64,
}

/// What came of a stroke; what is from states at rest is not a number where the tissue does not come to rest.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Its steady part.
    pub steady: Steady,
    /// Work of the front over Gc A, over all of the stroke.
    pub front_work: f64,
    /// Work of the tool less what is stored and the surplus at initiation, over Gc A, over all of the stroke.
    pub tool_work: f64,
    /// Energy release rate at constant force, over Gc.
    pub release: f64,
    /// Energy release rate at a held blade, over Gc.
    pub held_release: f64,
    /// Highest force over initiation ratio Gc w.
    pub highest: f64,
    /// Way of the edge into the block, m, and force over Gc w.
    pub curve: Vec<(f64, f64)>,
}

impl Stroke {
    /// Through the middle of a block of `[16, tall, 8]` times `unit_m`, on the lattice's planes, at a quarter of Gc/E in
    /// a step of 1 ms but no faster than 0.25 m/s. Where cutting strains all of it the block is taller and held at its
    /// sides: it can neither buckle nor be squeezed far below the front, so that its steady force is Gc w.
    #[must_use]
    pub fn through(material: MaterialDesc, mesh: Mesh, unit_m: f64, tall: f64) -> Self {
        let length_m = gc(&material) / material.young_modulus_pa;
        let strained = LARGE * length_m > 8.0 * unit_m;
        let (tall, support) = if strained { (STRAINED_TALL, Support::Sides) } else { (tall, Support::Bottom) };
        Self {
            support,
            regions: Vec::new(),
            mesh,
            size_m: [16.0 * unit_m, tall * unit_m, 8.0 * unit_m],
            held_m: unit_m,
            plane: Plane::Along,
            off_m: 0.0,
            speed_m_per_s: (250.0 * length_m).clamp(0.02, 0.25),
            rate_hz: 1000.0,
            edge_half_width_m: EDGE_HALF_WIDTH_M,
            penalty_factor: 1.0,
            material,
        }
    }

    /// Width that is cut, m.
    #[must_use]
    pub fn width_m(&self) -> f64 {
        self.size_m[2] / self.plane.directions()[0].z
    }

    /// Gc times the width that is cut, N.
    #[must_use]
    pub fn gc_w_n(&self) -> f64 {
        gc(&self.material) * self.width_m()
    }

    /// Gc/E, m.
    fn length_m(&self) -> f64 {
        gc(&self.material) / self.material.young_modulus_pa
    }

    /// Whether cutting strains all of the block.
    #[must_use]
    pub fn is_strained(&self) -> bool {
        LARGE * self.length_m() > self.size_m.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Steady force over Gc w in a tall block that is held at its bottom alone. Far below the front it is a bar of
    /// section A that the force shortens to `lambda = 1 - eps`, far above it is at rest. As the front goes on by ds in
    /// the material, the blade goes on by `lambda ds` and a piece of bar ds long with its energy U per volume comes to
    /// rest: `F lambda + U A = Gc w`, with `F = A E eps exp(c eps^2)`, `U = E (exp(c eps^2) - 1) / 2c`. (As in the
    /// strip in pure shear, Rivlin and Thomas 1953, nothing near the front comes into it.)
    #[must_use]
    pub fn bar_force(&self) -> f64 {
        let [length_m, _, width_m] = self.size_m;
        let (c, due) = (self.material.strain_stiffening, self.gc_w_n() / (length_m * width_m));
        let young_pa = self.material.young_modulus_pa;
        let stress_pa = |eps: f64| young_pa * eps * (c * eps * eps).exp();
        let stored_pa = |eps: f64| {
            if c > 0.0 { young_pa * (c * eps * eps).exp_m1() / (2.0 * c) } else { 0.5 * young_pa * eps * eps }
        };
        let (mut low, mut high) = (0.0, 0.5);
        for _ in 0..60 {
            let eps = 0.5 * (low + high);
            let released = stress_pa(eps) * (1.0 - eps) + stored_pa(eps);
            if released < due { low = eps } else { high = eps }
        }
        stress_pa(low) / due
    }

    /// Way of the edge from where its first point comes in to where its last one does, m.
    fn entry_m(&self) -> f64 {
        let [along, forward] = self.plane.directions();
        self.width_m() * along.y.abs() / forward.y.abs()
    }

    /// The scene, the blade a little above the block: not a whole number of steps, for an edge that is put down on
    /// the surface itself is in the tissue or not by rounding.
    #[must_use]
    pub fn setup(&self) -> Setup {
        let [along, forward] = self.plane.directions();
        let [x, y, z] = self.size_m;
        let mut object = block(self.size_m, self.mesh, self.material.clone());
        object.regions.clone_from(&self.regions);
        object.fixed = vec![below(self.held_m)];
        if self.support == Support::Sides {
            object.fixed.extend(beyond(self.held_m, x - self.held_m));
        }
        // An oblique blade comes in beside the middle, toward which it goes.
        let aside_m = if self.plane == Plane::Oblique { -0.3 * x } else { 0.0 };
        let above_m = 2.3 * self.speed_m_per_s / self.rate_hz + 0.5 * self.width_m() * along.y.abs();
        Setup {
            object,
            blade_width_m: 2.0 * self.width_m(),
            hold: Hold { start_m: Vec3::new(0.5 * x + self.off_m + aside_m, y + above_m, 0.5 * z), along, forward },
            speed_m_per_s: self.speed_m_per_s,
            rate_hz: self.rate_hz,
            edge_half_width_m: self.edge_half_width_m,
            penalty_factor: self.penalty_factor,
        }
    }

    /// Drives the blade through the steady part, lets it come to rest there, and relaxes the tissue with the front
    /// farther on.
    ///
    /// # Errors
    /// The scene is not valid, or a step had a fault.
    pub fn run(&self) -> Result<Outcome> {
        self.try_run().with_context(|| format!("{}, plane {}", self.mesh.name(), self.plane.name()))
    }

    /// Drives the blade through the steady part; the sample where that begins.
    fn drive(&self) -> Result<(Rig, usize)> {
        let mut rig = Rig::new(&self.setup())?;
        let steady = if self.is_strained() { STRAINED_STEADY } else { STEADY };
        let [begin_m, end_m] = steady.map(|share| self.entry_m() + share * self.size_m[1]);
        rig.advance(begin_m)?;
        let begin = rig.samples.len();
        rig.advance(end_m - begin_m)?;
        Ok((rig, begin))
    }

    /// What a drive found in its steady part.
    fn steady(&self, rig: &Rig, begin: usize) -> Steady {
        let force_n = -mean_force_n(&rig.samples[begin..]).dot(&self.plane.directions()[1]);
        Steady {
            force: force_n / self.gc_w_n(),
            work: spent_j_per_m2(&rig.samples[begin - 1..]) / gc(&self.material),
            residual: ledger_residual(&rig.samples),
        }
    }

    /// The steady part alone.
    ///
    /// # Errors
    /// The scene is not valid, or a step had a fault.
    pub fn run_steady(&self) -> Result<Steady> {
        let (rig, begin) = self.drive().with_context(|| self.mesh.name())?;
        Ok(self.steady(&rig, begin))
    }

    fn try_run(&self) -> Result<Outcome> {
        let (gc, gc_w_n) = (gc(&self.material), self.gc_w_n());
        let (mut rig, begin) = self.drive()?;
        let front_work = front_work_j_per_m2(&rig.samples) / gc;
        let steady = self.steady(&rig, begin);
        let curve: Vec<(f64, f64)> = rig.force_curve().iter().map(|p| (p.0, p.1 / gc_w_n)).collect();
        let at_rest = self.relaxed(&mut rig)?;
        let [tool_work, held_release, release] = at_rest.map_or([f64::NAN; 3], |works| works.map(|work| work / gc));
        Ok(Outcome {
            steady: Steady { residual: ledger_residual(&rig.samples), ..steady },
            front_work,
            tool_work,
            release,
            held_release,
            highest: curve.iter().fold(0.0f64, |m, p| m.max(p.1)) / self.material.initiation_ratio,
            curve,
        })
    }

    /// From differences between states at rest, J/m^2: the work of the tool less what is stored and the surplus at
    /// initiation, per area; the energy release rates with the blade held and at constant force. `None` where the
    /// tissue does not come to rest.
    ///
    /// The edge goes on by an element, in parts: what the elements set free as the front leaves them comes once in an
    /// element's way (or by as many parts as there may be, where they are short beside it: there it is next to
    /// nothing). Held: the blade goes back by the part, which leaves the front farther on at the same pose. Between
    /// the two G falls with the force; what is summed is at the force before. On the next part the front goes on: at rest it
    /// has all the force that it goes on at.
    fn relaxed(&self, rig: &mut Rig) -> Result<Option<[f64; 3]>> {
        let Some(rest) = rig.rest()? else { return Ok(None) };
        let spent = (sum(&rig.samples, |e| e.tool_work_j - e.initiation_j) - rest.stored_j) / rest.area_m2;
        let element_m = self.mesh.element_m() / self.plane.directions()[1].amax();
        let most_m = (MOST_ON * self.length_m()).min(MOST_ON_ELEMENTS * element_m);
        let parts = (element_m / most_m).ceil().min(MOST_PARTS);
        let part_m = most_m.min(element_m / parts);
        let (mut held, mut loaded) = (Balance::default(), Balance::default());
        rig.hasten(SLOWLY);
        rig.ease(part_m)?;
        let Some(mut before) = rig.rest()? else { return Ok(None) };
        let mut way_m = part_m;
        for _ in 0..parts as usize {
            rig.ease(way_m)?;
            let Some(on) = rig.rest()? else { return Ok(None) };
            loaded.released_j += 0.5 * (before.force_n + on.force_n) * part_m - (on.stored_j - before.stored_j);
            loaded.area_m2 += on.area_m2 - before.area_m2;
            rig.ease(-part_m)?;
            let Some(back) = rig.rest()? else { return Ok(None) };
            let mean_n = 0.5 * (before.force_n + back.force_n);
            held.released_j += (before.stored_j - back.stored_j) * before.force_n / mean_n;
            held.area_m2 += back.area_m2 - before.area_m2;
            (before, way_m) = (on, 2.0 * part_m);
        }
        Ok(Some([spent, held.rate_j_per_m2(), loaded.rate_j_per_m2()]))
    }
}

/// What a front set free, and over what area.
#[derive(Clone, Copy, Debug, Default)]
struct Balance {
    released_j: f64,
    area_m2: f64,
}

impl Balance {
    fn rate_j_per_m2(&self) -> f64 {
        self.released_j / self.area_m2
    }
}

/// Gc of a material that can be cut, J/m^2.
#[must_use]
pub fn gc(material: &MaterialDesc) -> f64 {
    material.fracture_energy_j_per_m2.unwrap_or(f64::NAN)
}
