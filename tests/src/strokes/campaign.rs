//! Strokes through a model, body after body, and what each left behind.

use std::panic::{AssertUnwindSafe, catch_unwind};

use kerf_physics::step_io::StepOutput;
use kerf_physics::surface::Surface;
use kerf_physics::{Body, NoClock, SceneProblems, StepInputs, ToolInput, Vec3, Workers, World};
use serde::{Deserialize, Serialize};

use super::hand::Stroke;
use super::inspect::seams;
use super::memory::resident_bytes;
use super::model::Model;
use crate::extremes::cuts::{check_body, piece_sizes};
use crate::extremes::scenes::SplitMix64;

/// What rounding leaves of the energy of a body that nothing has touched, at most, J.
const NO_ENERGY_J: f64 = 1e-15;
/// A body is cut up when its largest piece has less than this fraction of its voxels.
const CUT_UP_FRACTION: f64 = 0.25;
/// So is one that so many strokes in a row have parted nothing of.
const IDLE_STROKES: u32 = 15;
/// Enclosed volume may change by the cut area times this fraction of a voxel's edge.
pub(super) const VOLUME_FRACTION: f64 = 0.1;
/// Energy the ledger may leave unexplained, over the work of the tools.
pub(super) const MOST_RESIDUAL: f64 = 1e-2;
/// Findings that are kept in words; all are counted.
const MOST_FINDINGS: usize = 20;

/// What came of the strokes through one body or several of a model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tally {
    /// Fine voxels of a body.
    pub voxels: usize,
    /// Edge of a voxel, m.
    pub voxel_m: f64,
    /// Strokes made.
    pub strokes: u32,
    /// Those in which links parted.
    pub cutting_strokes: u32,
    /// Bodies cut.
    pub bodies: u32,
    /// Steps taken.
    pub steps: u64,
    /// Links parted.
    pub parted_links: u64,
    /// Links spared, lest a piece below the least be set free.
    pub spared_links: u64,
    /// Area the fronts swept, m^2.
    pub cut_area_m2: f64,
    /// Pieces of one body, at most.
    pub most_pieces: usize,
    /// Voxels of a mesh's thin parts that were left out.
    pub left_out: u32,
    /// Voxels of the smallest piece of all.
    pub least_piece: usize,
    /// Steps whose state was rolled back.
    pub faults: u32,
    /// Change of the enclosed volume over cut area times voxel edge, at most.
    pub volume_ratio: f64,
    /// Strokes after which it was beyond its bound.
    pub volume_misses: u32,
    /// Magnitudes of the change at the end, summed over bodies, m^3.
    pub volume_change_m3: f64,
    /// What the ledger left unexplained, sum of magnitudes over that of the tools' work, at most over bodies.
    pub residual_ratio: f64,
    /// Pairs of triangles that pass through each other in the reference configuration, at most after a stroke.
    pub crossing_pairs: usize,
    /// Edges along which the skin folds back, more than before any cut; at most after a stroke.
    pub folded_edges: usize,
    /// Cracks of one link that hang together with no other face, at most after a stroke.
    pub lone_cracks: usize,
    /// How many things did not hold.
    pub failures: u32,
    /// The first of them, each with the body's seed and the stroke.
    pub findings: Vec<String>,
    /// State hash of the last body.
    pub state_hash: u64,
    /// Highest resident set of the process after a stroke, where the system tells it, bytes.
    pub resident_bytes: Option<u64>,
}

impl Tally {
    fn finding(&mut self, seed: u64, what: &str) {
        self.failures += 1;
        if self.findings.len() < MOST_FINDINGS {
            self.findings.push(format!("body {seed:016x}, stroke {}: {what}", self.strokes));
        }
    }

    /// The sum of bodies of one model, in the order they are given in: of as many as hold `strokes`, or of all.
    #[must_use]
    pub fn sum(bodies: impl IntoIterator<Item = Self>, strokes: u32) -> Self {
        let mut sum = Self::default();
        for body in bodies {
            sum = if sum.bodies == 0 { body } else { sum.add(body) };
            if sum.strokes >= strokes {
                break;
            }
        }
        sum
    }

    fn add(self, other: Self) -> Self {
        let mut findings = self.findings;
        findings.extend(other.findings);
        findings.truncate(MOST_FINDINGS);
        Self {
            voxels: other.voxels,
            voxel_m: other.voxel_m,
            strokes: self.strokes + other.strokes,
            cutting_strokes: self.cutting_strokes + other.cutting_strokes,
            bodies: self.bodies + other.bodies,
            steps: self.steps + other.steps,
            parted_links: self.parted_links + other.parted_links,
            spared_links: self.spared_links + other.spared_links,
            cut_area_m2: self.cut_area_m2 + other.cut_area_m2,
            most_pieces: self.most_pieces.max(other.most_pieces),
            left_out: other.left_out,
            least_piece: self.least_piece.min(other.least_piece),
            faults: self.faults + other.faults,
            volume_ratio: self.volume_ratio.max(other.volume_ratio),
            volume_misses: self.volume_misses + other.volume_misses,
            volume_change_m3: self.volume_change_m3 + other.volume_change_m3,
            residual_ratio: self.residual_ratio.max(other.residual_ratio),
            crossing_pairs: self.crossing_pairs.max(other.crossing_pairs),
            folded_edges: self.folded_edges.max(other.folded_edges),
            lone_cracks: self.lone_cracks.max(other.lone_cracks),
            failures: self.failures + other.failures,
            findings,
            state_hash: other.state_hash,
            resident_bytes: self.resident_bytes.max(other.resident_bytes),
        }
    }
}

/// One body and what was done to it.
struct Specimen {
    seed: u64,
    world: World,
    workers: Workers<'static>,
    bounds_m: [Vec3; 2],
    dt_s: f64,
    whole_m3: f64,
    /// Edges of the skin that fold before any cut.
    whole_folded: usize,
    whole_crossing: usize,
    cut_area_m2: f64,
    work_j: f64,
    residual_j: f64,
    idle_strokes: u32,
}

impl Specimen {
    fn new(model: &Model, seed: u64) -> Result<Self, SceneProblems> {
        let mut world = World::new(&model.scene)?;
        let stats = world.object_stats()[0];
        let whole_m3 = world.bodies_and_surfaces().map(|(_, surface)| surface.volume_m3()).sum();
        let folded = |(body, surface): (&Body, &Surface)| surface.folded_edges(body.grid()).len();
        let whole_folded = world.bodies_and_surfaces().map(folded).sum();
        let crossing = |(_, surface): (&Body, &Surface)| surface.crossing_pairs().len();
        let whole_crossing = world.bodies_and_surfaces().map(crossing).sum();
        Ok(Self {
            seed,
            world,
            workers: Workers::serial(),
            bounds_m: [stats.rest_min_m.into(), stats.rest_max_m.into()],
            dt_s: 1.0 / model.scene.desc.rate_hz,
            whole_m3,
            whole_folded,
            whole_crossing,
            cut_area_m2: 0.0,
            work_j: 0.0,
            residual_j: 0.0,
            idle_strokes: 0,
        })
    }

    fn voxel_m(&self) -> f64 {
        self.world.bodies()[0].grid().voxel_size_m()
    }

    fn stroke(&mut self, rng: &mut SplitMix64, tally: &mut Tally) {
        let stroke = Stroke::random(rng, self.bounds_m, 2.0 * self.voxel_m(), self.dt_s);
        let parted_before = tally.parted_links;
        for motion in stroke.motions() {
            self.step(ToolInput { tool: stroke.tool, motion }, tally);
        }
        let has_parted = tally.parted_links > parted_before;
        tally.cutting_strokes += u32::from(has_parted);
        self.idle_strokes = if has_parted { 0 } else { self.idle_strokes + 1 };
    }

    fn step(&mut self, input: ToolInput, tally: &mut Tally) {
        let output = self.world.step(&self.workers, &NoClock, &StepInputs::of(&[input]));
        tally.steps += 1;
        tally.parted_links += u64::from(output.fracture.parted_links);
        tally.spared_links += u64::from(output.fracture.spared_links);
        tally.cut_area_m2 += output.fracture.cut_area_m2;
        self.cut_area_m2 += output.fracture.cut_area_m2;
        self.work_j += output.energy.tool_work_j.abs();
        self.residual_j += output.energy.residual_j.abs();
        if let Some(fault) = &output.fault {
            tally.faults += 1;
            tally.finding(self.seed, &format!("rolled back: {fault:?}"));
        }
        if !is_finite(output) {
            tally.finding(self.seed, "a wrench or an energy is not a number");
        }
    }

    /// Asks of the body all that must hold between strokes.
    fn inspect(&mut self, tally: &mut Tally) {
        let mut wrong = check_body(self.world.bodies()[0], tally.voxels);
        if !self.world.bodies()[0].is_finite() {
            wrong.push("a position or velocity is not a number".into());
        }
        let sizes = piece_sizes(self.world.bodies()[0].grid());
        tally.most_pieces = tally.most_pieces.max(sizes.len());
        tally.least_piece = tally.least_piece.min(sizes[0]);
        let (voxel_m, whole_m3) = (self.voxel_m(), self.whole_m3);
        for (body, surface) in self.world.bodies_and_surfaces() {
            let seams = seams(body.grid(), surface);
            tally.lone_cracks = tally.lone_cracks.max(seams.lone);
            let crossing = surface.crossing_pairs().len().saturating_sub(self.whole_crossing);
            tally.crossing_pairs = tally.crossing_pairs.max(crossing);
            let folded = surface.folded_edges(body.grid()).len().saturating_sub(self.whole_folded);
            tally.folded_edges = tally.folded_edges.max(folded);
            if folded > 0 {
                wrong.push(format!("the skin folds back along {folded} edges"));
            }
            if seams.open > 0 {
                wrong.push(format!("{} open edges", seams.open));
            }
            let changed_m3 = (surface.volume_m3() - whole_m3).abs();
            let room_m3 = self.cut_area_m2 * voxel_m;
            if room_m3 > 0.0 {
                tally.volume_ratio = tally.volume_ratio.max(changed_m3 / room_m3);
            }
            let is_beyond = changed_m3 > VOLUME_FRACTION * room_m3 + f64::from(f32::EPSILON) * whole_m3;
            tally.volume_misses += u32::from(is_beyond);
            tally.volume_change_m3 = changed_m3;
        }
        if self.work_j > 0.0 {
            tally.residual_ratio = tally.residual_ratio.max(self.residual_j / self.work_j);
        }
        if self.residual_j > MOST_RESIDUAL * self.work_j + NO_ENERGY_J {
            wrong.push(format!("{:.2e} J of {:.2e} J are not accounted for", self.residual_j, self.work_j));
        }
        wrong.iter().for_each(|what| tally.finding(self.seed, what));
        tally.state_hash = self.world.state_hash();
    }

    /// Whether the surface that was followed is the one a new viewer gets.
    fn compare_surface(&mut self, tally: &mut Tally) {
        let followed = |(body, surface): (&Body, &Surface)| *surface == Surface::build(body.grid());
        if !self.world.bodies_and_surfaces().all(followed) {
            tally.finding(self.seed, "the surface followed is not the one built anew");
        }
    }

    fn is_cut_up(&self) -> bool {
        let grid = self.world.bodies()[0].grid();
        let largest = piece_sizes(grid).last().copied().unwrap_or(0) as f64;
        self.idle_strokes >= IDLE_STROKES || largest < CUT_UP_FRACTION * grid.voxels().len() as f64
    }
}

fn is_finite(output: &StepOutput) -> bool {
    let e = &output.energy;
    let wrenches = output.tools.iter().flat_map(|t| t.wrench.force_n.iter().chain(t.wrench.torque_nm.iter()));
    let energies = [e.tool_work_j, e.elastic_j, e.kinetic_j, e.contact_j, e.fracture_j, e.residual_j];
    wrenches.copied().chain(energies).all(f64::is_finite)
}

/// Cuts a fresh body of a model by `strokes` random strokes, or until it is cut up or one makes it panic.
///
/// # Errors
/// What the model's scene is refused for.
pub fn cut(model: &Model, seed: u64, strokes: u32) -> Result<Tally, SceneProblems> {
    let mut specimen = Specimen::new(model, seed)?;
    let mut tally = Tally {
        voxels: specimen.world.bodies()[0].grid().voxels().len(),
        voxel_m: specimen.voxel_m(),
        left_out: specimen.world.object_stats()[0].left_out.voxels,
        least_piece: usize::MAX,
        bodies: 1,
        ..Tally::default()
    };
    let mut rng = SplitMix64(seed);
    let mut is_whole = true;
    while is_whole && tally.strokes < strokes && !specimen.is_cut_up() {
        tally.strokes += 1;
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            specimen.stroke(&mut rng, &mut tally);
            specimen.inspect(&mut tally);
        }));
        if let Err(panic) = &outcome {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message");
            tally.finding(seed, &format!("panicked: {text}"));
            is_whole = false;
        }
        tally.resident_bytes = tally.resident_bytes.max(resident_bytes());
    }
    if is_whole {
        specimen.compare_surface(&mut tally);
    }
    Ok(tally)
}

/// Seeds of a campaign's bodies, in order.
pub fn seeds(seed: u64) -> impl Iterator<Item = u64> {
    let mut rng = SplitMix64(seed);
    std::iter::repeat_with(move || rng.word())
}
