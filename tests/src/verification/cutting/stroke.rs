//! A stroke through a block: its steady force and work, and the energy release rate at its front.

use anyhow::{Context, Result};
use kerf_physics::Vec3;
use kerf_physics::scene::{MaterialDesc, RegionDesc};

use super::rig::{Hold, Rig, Setup, below, front_work_j_per_m2, ledger_residual, mean_force_n, sum};
use crate::verification::scenes::{Mesh, block};

/// Way of the edge into the block, over its height, where what counts as steady begins and ends.
const STEADY: [f64; 2] = [0.3, 0.45];
/// Way of the edge between the two states at rest, over the thickness of the held layer.
const ON: f64 = 2.0;
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
    /// Thickness of the layer at its bottom that is held, m.
    pub held_m: f64,
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

/// What came of a stroke; what is from states at rest is not a number where the tissue does not come to rest.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Mean force in the steady part over Gc w.
    pub force: f64,
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
    /// Sum of the ledger's residuals' sizes over the tool's work.
    pub residual: f64,
    /// Way of the edge into the block, m, and force over Gc w.
    pub curve: Vec<(f64, f64)>,
}

impl Stroke {
    /// Through the middle of a block of `[16, tall, 8]` times `unit_m`, on the lattice's planes, at a quarter of
    /// Gc/E in a step of 1 ms but no faster than 0.25 m/s.
    #[must_use]
    pub fn through(material: MaterialDesc, mesh: Mesh, unit_m: f64, tall: f64) -> Self {
        let length_m = gc(&material) / material.young_modulus_pa;
        Self {
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

    fn try_run(&self) -> Result<Outcome> {
        let (gc, gc_w_n) = (gc(&self.material), self.gc_w_n());
        let mut rig = Rig::new(&self.setup())?;
        let [begin_m, end_m] = STEADY.map(|share| self.entry_m() + share * self.size_m[1]);
        rig.advance(begin_m)?;
        let begin = rig.samples.len();
        rig.advance(end_m - begin_m)?;
        let along = |force_n: Vec3| -force_n.dot(&self.plane.directions()[1]) / gc_w_n;
        let force = along(mean_force_n(&rig.samples[begin..]));
        let front_work = front_work_j_per_m2(&rig.samples) / gc;
        let curve: Vec<(f64, f64)> = rig.force_curve().iter().map(|p| (p.0, p.1 / gc_w_n)).collect();
        let at_rest = self.relaxed(&mut rig)?;
        let [tool_work, held_release, release] = at_rest.map_or([f64::NAN; 3], |works| works.map(|work| work / gc));
        Ok(Outcome {
            force,
            front_work,
            tool_work,
            release,
            held_release,
            highest: curve.iter().fold(0.0f64, |m, p| m.max(p.1)) / self.material.initiation_ratio,
            residual: ledger_residual(&rig.samples),
            curve,
        })
    }

    /// From differences between states at rest, J/m^2: the work of the tool less what is stored and the surplus at
    /// initiation, per area; the energy release rate with the blade held; the same at constant force. `None` where
    /// the tissue does not come to rest.
    ///
    /// Held: the blade goes on by a little and back, which leaves the front farther on at the same pose. G falls
    /// with the force on the way; what is returned is at the force before.
    fn relaxed(&self, rig: &mut Rig) -> Result<Option<[f64; 3]>> {
        let Some(rest) = rig.rest()? else { return Ok(None) };
        let spent_j = sum(&rig.samples, |e| e.tool_work_j - e.initiation_j) - rest.stored_j;
        let little_m = 0.5 * (gc(&self.material) / self.material.young_modulus_pa).min(self.held_m);
        rig.advance(little_m)?;
        rig.rest()?;
        rig.advance(-little_m)?;
        let Some(back) = rig.rest()? else { return Ok(None) };
        let mean_n = 0.5 * (rest.force_n + back.force_n);
        let held = (rest.stored_j - back.stored_j) / (back.area_m2 - rest.area_m2) * rest.force_n / mean_n;
        rig.advance(little_m)?;
        let Some(from) = rig.rest()? else { return Ok(None) };
        let on_m = ON * self.held_m;
        rig.advance(on_m)?;
        let Some(to) = rig.rest()? else { return Ok(None) };
        let work_j = 0.5 * (from.force_n + to.force_n) * on_m;
        let loaded = (work_j - (to.stored_j - from.stored_j)) / (to.area_m2 - from.area_m2);
        Ok(Some([spent_j / rest.area_m2, held, loaded]))
    }
}

/// Gc of a material that can be cut, J/m^2.
#[must_use]
pub fn gc(material: &MaterialDesc) -> f64 {
    material.fracture_energy_j_per_m2.unwrap_or(f64::NAN)
}
