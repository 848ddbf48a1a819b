//! A block under a blade: whole steps with and without fracture, and parts of them.
#![allow(missing_docs, reason = "criterion's macros write undocumented functions")]
#![allow(clippy::disallowed_types, reason = "a benchmark reads the clock")]

#[path = "../tests/support/mod.rs"]
mod support;

use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use kerf_physics::{Stage, StageClock, StepInputs, StepOutput, ToolInput, Workers, World};
use support::press::{cutting_scene, pose_at};
use support::world_of;

/// From just over the block to 32 mm into it at 0.4 m/s.
const STEPS: u32 = 80;

struct Clock(Instant);

impl StageClock for Clock {
    fn now_ns(&self) -> u64 {
        u64::try_from(self.0.elapsed().as_nanos()).expect("a run shorter than centuries")
    }
}

fn world(voxel_m: f64) -> World {
    let mut scene = cutting_scene();
    scene.desc.objects[0].voxel_size_m = Some(voxel_m);
    world_of(&scene)
}

/// Sum over `count` steps of one kind of what `time` says they took; a stroke that is over begins anew.
fn strokes(voxel_m: f64, count: u64, fracture: bool, time: impl Fn(Duration, &StepOutput) -> Duration) -> Duration {
    let clock = Clock(Instant::now());
    let (mut total, mut taken) = (Duration::ZERO, 0);
    loop {
        let mut world = world(voxel_m);
        for step in 0..STEPS {
            let input = ToolInput { tool: 0, motion: pose_at(0.041 - 4e-4 * f64::from(step)) };
            let start = Instant::now();
            let output = world.step(&Workers::serial(), &clock, &StepInputs::of(&[input]));
            let took = start.elapsed();
            if (output.fracture.parted_links > 0) == fracture {
                total += time(took, output);
                taken += 1;
            }
            if taken == count {
                return total;
            }
        }
    }
}

fn topology(_: Duration, output: &StepOutput) -> Duration {
    Duration::from_nanos(output.profile.stage_ns[Stage::Topology as usize].unwrap_or(0))
}

/// One operator product and one multigrid cycle.
fn solver_iteration(_: Duration, output: &StepOutput) -> Duration {
    let solve_ns = output.profile.stage_ns[Stage::Velocities as usize].unwrap_or(0);
    Duration::from_nanos(solve_ns / u64::from(output.solve.iterations.max(1)))
}

fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("block");
    group.sample_size(10);
    for voxel_m in [0.0025, 0.00125] {
        let elements = world(voxel_m).counts().composite_elements;
        let mut bench = |name: &str, fracture: bool, time: fn(Duration, &StepOutput) -> Duration| {
            let id = BenchmarkId::new(name, elements);
            group.bench_function(id, |b| b.iter_custom(|count| strokes(voxel_m, count, fracture, time)));
        };
        bench("step_without_fracture", false, |took, _| took);
        bench("step_with_fracture", true, |took, _| took);
        bench("topology_update", true, topology);
        bench("solver_iteration", false, solver_iteration);
    }
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
