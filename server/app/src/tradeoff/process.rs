//! One run of the sweep, in a process of its own: its peak of memory and its faults are its own.

use std::io::{Read, Write};
use std::path::Path;

use anyhow::{Context, Result};
use kerf_physics::{Grid, Link, StepInputs, StepOutput, Vec3, Workers, World};
use kerf_scenes::catalog;
use kerf_session::clock::MonotonicClock;
use serde::{Deserialize, Serialize};

use super::job::Job;
use super::points::Followed;
use super::samples::{Sampler, Samples};
use crate::machine::peak_memory_mib;
use crate::scene_args::read_script;
use crate::script::stroke::default_stroke;
use crate::simulate::summary::quantile_ms;

/// What a run cost. Steps in which a tool touches count; all of them where none ever does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Median duration of a step, ms.
    pub median_ms: f64,
    /// 99th percentile of the duration of a step, ms.
    pub p99_ms: f64,
    /// Memory of the process at its highest, MiB.
    pub memory_mib: f64,
    /// Time of computing of the whole run, s.
    pub run_s: f64,
}

/// What a run amounted to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// What it was to do.
    pub job: Job,
    /// Fine voxels.
    pub voxels: u64,
    /// Composite elements at rest.
    pub elements: u64,
    /// Steps taken.
    pub steps: u64,
    /// Steps whose state was not finite and was rolled back.
    pub faults: u64,
    /// Largest relative residual that a step's solve ended with.
    pub worst_residual: f64,
    /// What was sampled.
    pub samples: Samples,
    /// Displacement of each point of the profile at the end, m.
    pub profile_m: Vec<[f32; 3]>,
    /// Extent of what parted along the cutting direction, m.
    pub cut_depth_m: f64,
    /// Area that the fronts swept, m^2.
    pub cut_area_m2: f64,
    /// Sum of the ledger's residual, J.
    pub residual_j: f64,
    /// Work of the tools; that of the loads where the scene has no tool; J.
    pub work_j: f64,
    /// What it cost.
    pub cost: Cost,
}

/// Runs the job that stands on standard input as JSON, tells its progress in percent on standard output, a
/// line each, and writes the [`Run`] to a file: whole or not at all.
///
/// # Errors
/// The job or its scene cannot be read or is not supported, or the file cannot be written.
pub fn run(out: &Path) -> Result<()> {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text)?;
    let job: Job = serde_json::from_str(&text).context("the job on standard input")?;
    let run = simulate_job(job, &mut |percent| {
        // A parent that has gone is none of the run's business.
        let _ = writeln!(std::io::stdout(), "{percent}");
    })?;
    write(out, &run)
}

/// Writes a run's file: whole or not at all.
///
/// # Errors
/// The file cannot be written.
pub fn write(out: &Path, run: &Run) -> Result<()> {
    let temporary = out.with_extension("part");
    std::fs::write(&temporary, serde_json::to_string(run)?).with_context(|| temporary.display().to_string())?;
    std::fs::rename(&temporary, out).with_context(|| out.display().to_string())
}

fn simulate_job(job: Job, progress: &mut dyn FnMut(u64)) -> Result<Run> {
    let scene = job.scene()?.judge()?;
    let stated = catalog::load(&job.scene)?;
    let mut script = match &job.script {
        Some(path) => read_script(path, &stated)?,
        None => default_stroke(&stated)?,
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(job.threads).build()?;
    let workers = Workers::of(&pool);
    let mut world = World::new(&scene)?;
    let elements: usize = world.bodies().iter().map(|body| body.element_count()).sum();
    let rate_hz = scene.desc.rate_hz;
    let mut sampler = Sampler::new(&world, &job, 1.0 / rate_hz);
    let mut tally = Tally::default();
    let began_ns = MonotonicClock::now_ns();
    let passed_s = || (MonotonicClock::now_ns() - began_ns) as f64 * 1e-9;
    // Rounding must not add a step to a whole number of them.
    let steps = ((job.duration_s - job.start_s) * rate_hz - 1e-6).ceil().max(1.0) as u64;
    let mut percent = 0;
    for step in 1..=steps {
        let tools = script.advance(job.start_s + step as f64 / rate_hz);
        sampler.before_step(&world);
        tally.push(world.step(&workers, &MonotonicClock, &StepInputs::of(&tools)));
        sampler.after_step(&world);
        if 100 * step / steps > percent {
            percent = 100 * step / steps;
            progress(percent);
        }
        if job.limit_s.is_some_and(|limit_s| passed_s() > limit_s) {
            break;
        }
    }
    let bodies = world.bodies();
    let depth_m = bodies.iter().map(|body| cut_depth_m(body.grid(), &tally.cutting_direction)).fold(0.0, f64::max);
    Ok(Run {
        voxels: bodies.iter().map(|body| body.grid().voxels().len() as u64).sum(),
        elements: elements as u64,
        steps: world.output().step,
        faults: tally.faults,
        worst_residual: tally.worst_residual,
        profile_m: Followed::new(&bodies, &job.profile).displacements_m(&bodies),
        cut_depth_m: depth_m,
        cut_area_m2: tally.cut_area_m2,
        residual_j: tally.residual_j,
        work_j: if scene.desc.tools.is_empty() { tally.load_work_j } else { tally.tool_work_j },
        cost: tally.cost(passed_s())?,
        samples: sampler.finish(),
        job,
    })
}

/// Extent of what parted along a direction, m: from the first to the last voxel with a parted link.
fn cut_depth_m(grid: &Grid, direction: &Vec3) -> f64 {
    let parted = grid
        .voxels()
        .iter()
        .map(|voxel| voxel.ijk)
        .filter(|cell| Grid::links_of(*cell).any(|(link, _)| matches!(grid.link(link), Link::Parted(_))));
    let along = parted.map(|cell| grid.centre_m(cell).dot(direction));
    let (least, most) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), a| (l.min(a), m.max(a)));
    if most < least { 0.0 } else { most - least + grid.voxel_size_m() }
}

/// Sums over the steps of a run.
struct Tally {
    touching_ns: Vec<u64>,
    free_ns: Vec<u64>,
    faults: u64,
    worst_residual: f64,
    cut_area_m2: f64,
    residual_j: f64,
    tool_work_j: f64,
    load_work_j: f64,
    /// Of the tool that cut last, scene frame.
    cutting_direction: Vec3,
}

impl Default for Tally {
    fn default() -> Self {
        Self {
            touching_ns: Vec::new(),
            free_ns: Vec::new(),
            faults: 0,
            worst_residual: 0.0,
            cut_area_m2: 0.0,
            residual_j: 0.0,
            tool_work_j: 0.0,
            load_work_j: 0.0,
            cutting_direction: -Vec3::y(),
        }
    }
}

impl Tally {
    fn push(&mut self, output: &StepOutput) {
        let touches = output.tools.iter().any(|tool| tool.touches);
        let times = if touches { &mut self.touching_ns } else { &mut self.free_ns };
        times.push(output.profile.total_ns());
        self.faults += u64::from(output.fault.is_some());
        self.worst_residual = self.worst_residual.max(output.solve.relative_residual);
        self.cut_area_m2 += output.fracture.cut_area_m2;
        self.residual_j += output.energy.residual_j;
        self.tool_work_j += output.energy.tool_work_j;
        self.load_work_j += output.energy.load_work_j;
        let cutting = output.tools.iter().find(|tool| tool.cutting_length_m > 0.0);
        if let Some(pose) = cutting.and_then(|tool| tool.pose) {
            self.cutting_direction = pose.orientation * -Vec3::y();
        }
    }

    fn cost(self, run_s: f64) -> Result<Cost> {
        let times = if self.touching_ns.is_empty() { self.free_ns } else { self.touching_ns };
        let at = |quantile| quantile_ms(times.clone(), quantile).context("the run took no step");
        Ok(Cost { median_ms: at(0.5)?, p99_ms: at(0.99)?, memory_mib: peak_memory_mib()?, run_s })
    }
}

#[cfg(test)]
mod tests {
    use kerf_physics::{Crossing, LinkId, voxelize};

    use super::*;

    #[test]
    fn a_cut_is_as_deep_as_the_voxels_on_it() {
        let scene = catalog::builtin("cuboid").unwrap();
        let mut grid = voxelize(&scene.desc.objects[0], &scene.meshes).unwrap();
        assert_eq!(cut_depth_m(&grid, &-Vec3::y()), 0.0);
        for y in 20..28 {
            grid.part(LinkId { cell: [10, y, 22], axis: 2 }, Crossing { t: 0.5, normal: [0.0, 0.0, 1.0] });
        }
        assert!((cut_depth_m(&grid, &-Vec3::y()) - 8.0 * 0.0025).abs() < 1e-12);
        assert!((cut_depth_m(&grid, &Vec3::x()) - 0.0025).abs() < 1e-12);
    }

    #[test]
    fn memory_of_this_process_is_more_than_what_it_holds() {
        let held = vec![1u8; 64 << 20];
        let memory_mib = peak_memory_mib().unwrap();
        assert!(memory_mib > 64.0 * f64::from(held[held.len() / 2]), "{memory_mib}");
    }
}
