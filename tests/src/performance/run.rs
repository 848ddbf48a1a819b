//! Strokes whose steps are timed.

use anyhow::Result;
use kerf_physics::world::WorldCounts;
use kerf_physics::{SceneDesc, SoundScene, Stage, StepInputs, StepOutput, Vec3, Workers, World};
use kerf_scenes::catalog;
use kerf_server::script::stroke::default_stroke_in;
use kerf_session::SessionLimits;
use kerf_session::clock::MonotonicClock;

/// Simulated time after the stroke, s.
const AFTER_S: f64 = 0.2;

/// Who looks at the surface while steps are timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Viewer {
    /// Somebody: the surface follows each cut, and is adapted to the steps that a session would show.
    Watching,
    /// Nobody: no surface is made.
    Absent,
}

/// What of a step is kept.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    pub total_ms: f64,
    /// By `Stage as usize`; NaN where the stage did not run.
    pub stage_ms: [f64; Stage::ALL.len()],
    pub iterations: u32,
    pub solves: u32,
    pub parted_links: u32,
    pub work_units: u64,
    /// Force on the first tool, N.
    pub force_n: Vec3,
    pub sim_time_s: f64,
}

/// A stroke step by step.
pub struct Run {
    pub samples: Vec<Sample>,
    pub counts: WorldCounts,
    pub state_hash: u64,
}

/// A built-in scene.
pub fn builtin(name: &str) -> Result<SoundScene> {
    Ok(catalog::builtin(name)?)
}

/// The liver with voxels of another size.
pub fn liver(voxel_m: f64, level: u8, rate_hz: f64) -> Result<SoundScene> {
    let change = |desc: &mut SceneDesc| {
        desc.rate_hz = rate_hz;
        desc.objects[0].voxel_size_m = Some(voxel_m);
        desc.objects[0].level = level;
        // They lie in the scene's own voxels, not in coarser ones.
        desc.tracked_points.clear();
    };
    Ok(builtin("liver")?.with(change)?)
}

/// How a stroke is run.
#[derive(Clone, Copy)]
pub struct Stroke {
    pub threads: usize,
    pub viewer: Viewer,
    /// Of the stroke at most so many.
    pub max_steps: usize,
    /// Steps from one model of the tool's contact to the next.
    pub steps_per_model: usize,
    /// Work that a step may do, if it is bounded.
    pub work_units: Option<u64>,
}

impl Stroke {
    /// The whole stroke, with nobody who looks or feels, work unbounded.
    pub const ALONE: Self = Self {
        threads: 1,
        viewer: Viewer::Absent,
        max_steps: usize::MAX,
        steps_per_model: usize::MAX,
        work_units: None,
    };

    /// Runs the default stroke of a scene.
    pub fn run(&self, scene: &SoundScene) -> Result<Run> {
        let mut world = World::new(scene)?;
        let mut script = default_stroke_in(&world, &scene.desc);
        let rate_hz = scene.desc.rate_hz;
        let steps = (((script.end_s() + AFTER_S) * rate_hz).round() as usize).min(self.max_steps);
        let counts = world.counts();
        if self.viewer == Viewer::Absent {
            world.forget_surface();
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build()?;
        let workers = if self.threads == 1 { Workers::serial() } else { Workers::of(&pool) };
        let steps_per_state = (rate_hz / SessionLimits::default().view_rate_hz).round().max(1.0) as usize;
        let mut samples = Vec::with_capacity(steps);
        for step in 1..=steps {
            let tools = script.advance(step as f64 / rate_hz);
            let models: &[usize] = if step % self.steps_per_model == 0 { &[0] } else { &[] };
            let inputs = StepInputs { models, work_units: self.work_units, ..StepInputs::of(&tools) };
            world.step(&workers, &MonotonicClock, &inputs);
            if self.viewer == Viewer::Watching && step % steps_per_state == 0 {
                world.adapt_surface(&MonotonicClock);
            }
            samples.push(sample(world.output()));
        }
        Ok(Run { samples, counts, state_hash: world.state_hash() })
    }
}

/// The default stroke of a scene, at most `max_steps` of it, on a number of threads.
pub fn stroke(scene: &SoundScene, threads: usize, viewer: Viewer, max_steps: usize) -> Result<Run> {
    Stroke { threads, viewer, max_steps, ..Stroke::ALONE }.run(scene)
}

fn sample(output: &StepOutput) -> Sample {
    Sample {
        total_ms: output.profile.total_ns() as f64 * 1e-6,
        stage_ms: output.profile.stage_ns.map(|ns| ns.map_or(f64::NAN, |ns| ns as f64 * 1e-6)),
        iterations: output.solve.iterations,
        solves: output.solve.solves,
        parted_links: output.fracture.parted_links,
        work_units: output.solve.work_units,
        force_n: output.tools[0].wrench.force_n,
        sim_time_s: output.sim_time_s,
    }
}

impl Run {
    /// Steps in which links parted, or those in which none did.
    pub fn of_kind(&self, fracture: bool) -> impl Iterator<Item = &Sample> + Clone {
        self.samples.iter().filter(move |sample| (sample.parted_links > 0) == fracture)
    }

    /// Median of whole steps of a kind, ms.
    pub fn median_ms(&self, fracture: bool) -> f64 {
        quantile(self.of_kind(fracture).map(|sample| sample.total_ms), 0.5)
    }

    /// Mean time of the given stages in the steps of a kind in which the first of them ran, ms.
    pub fn mean_stages_ms(&self, fracture: bool, stages: &[Stage]) -> f64 {
        let ran = self.of_kind(fracture).filter(|sample| !sample.stage_ms[stages[0] as usize].is_nan());
        mean(ran.map(|sample| stage_sum(sample, stages)))
    }

    /// Iterations per solve over the whole run.
    pub fn iterations_per_solve(&self) -> f64 {
        let sum = |of: fn(&Sample) -> u32| self.samples.iter().map(|sample| f64::from(of(sample))).sum::<f64>();
        sum(|sample| sample.iterations) / sum(|sample| sample.solves)
    }
}

/// Time of the given stages, ms; those that did not run count nothing.
pub fn stage_sum(sample: &Sample, stages: &[Stage]) -> f64 {
    stages.iter().map(|stage| sample.stage_ms[*stage as usize]).filter(|ms| !ms.is_nan()).sum()
}

/// The paper's FEM: everything that moves the tissue.
pub const FEM: [Stage; 4] = [Stage::Velocities, Stage::Integrate, Stage::Rotations, Stage::ApplyInputs];
/// The paper's collision detection: of the blade with tissue, and of tissue with tissue.
pub const COLLISION: [Stage; 2] = [Stage::Contact, Stage::SelfContact];
/// The paper's topology modification, the surface's change with it.
pub const TOPOLOGY: [Stage; 2] = [Stage::Topology, Stage::Surface];

/// The smallest value that at least a fraction of the values do not exceed; NaN of none.
pub fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let rank = (values.len() as f64 * share).ceil() as usize;
    values.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

/// The mean; NaN of none.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count)
}

/// A cell of a table; a dash for what was not measured.
pub fn cell(value: f64) -> String {
    match value {
        v if v.is_nan() => "-".into(),
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 10.0 => format!("{v:.1}"),
        v if v >= 0.1 => format!("{v:.2}"),
        v => format!("{v:.3}"),
    }
}
