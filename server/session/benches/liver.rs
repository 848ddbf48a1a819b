//! Whole steps of the built-in liver: a stroke of the blade into its right lobe, at 1 kHz on one thread.
//! Before the timed runs the liver is voxelized once at two million voxels, and one stroke is taken step
//! by step; the time of the one and the medians of the other are printed. So is what the state takes as a file, and how long
//! it takes to be copied, written, read and hashed, at rest and at the end of the stroke.
#![allow(missing_docs, reason = "criterion's macros write undocumented functions")]

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{Pose, Quat, SoundScene, Stage, StepInputs, StepOutput, ToolInput, Vec3, Workers, World, voxelize};
use kerf_scenes::catalog;
use kerf_session::clock::MonotonicClock;

const SPEED_M_PER_S: f64 = 0.1;
/// From just over the lobe to 50 mm into it.
const STEPS: u32 = 560;
/// Makes two million voxels of the liver.
const FINE_VOXEL_M: f64 = 0.0035 / 4.05;

/// A stroke that begins anew when it is over.
struct Stroke {
    scene: SoundScene,
    world: World,
    step: u32,
}

impl Stroke {
    fn new() -> Self {
        let scene = catalog::builtin("liver").expect("a built-in scene");
        let world = World::new(&scene).expect("a valid scene");
        Self { scene, world, step: 0 }
    }

    fn advance(&mut self) -> (Duration, &StepOutput) {
        if self.step == STEPS {
            self.world = World::new(&self.scene).expect("a valid scene");
            self.step = 0;
        }
        let height_m = 0.158 - 1e-3 * SPEED_M_PER_S * f64::from(self.step);
        self.step += 1;
        let orientation = Quat::from_euler_angles(0.0, 0.2, 0.0);
        let pose = Pose { position_m: Vec3::new(-0.0420, height_m, -0.0210), orientation };
        let input = ToolInput { tool: 0, motion: ToolMotion::move_to(pose) };
        let start_ns = MonotonicClock::now_ns();
        let output = self.world.step(&Workers::serial(), &MonotonicClock, &StepInputs::of(&[input]));
        (since(start_ns), output)
    }

    /// Time of `steps` steps of one kind.
    fn time(&mut self, steps: u64, fracture: bool) -> Duration {
        let (mut total, mut taken) = (Duration::ZERO, 0);
        while taken < steps {
            let (time, output) = self.advance();
            if (output.fracture.parted_links > 0) == fracture {
                total += time;
                taken += 1;
            }
        }
        total
    }
}

fn since(start_ns: u64) -> Duration {
    Duration::from_nanos(MonotonicClock::now_ns() - start_ns)
}

fn print_voxelization() {
    let mut scene = catalog::builtin("liver").expect("a built-in scene").into_scene();
    scene.desc.objects[0].voxel_size_m = Some(FINE_VOXEL_M);
    let start_ns = MonotonicClock::now_ns();
    let grid = voxelize(&scene.desc.objects[0], &scene.meshes).expect("a valid object");
    println!("voxelize: {} voxels in {:.2} s", grid.voxels().len(), since(start_ns).as_secs_f64());
}

/// The hash is that of a state that a step has changed: what did not change since the last one keeps its part of it.
fn print_state(when: &str, world: &mut World) {
    const RUNS: usize = 20;
    let ms = |work: &mut dyn FnMut()| {
        let start_ns = MonotonicClock::now_ns();
        work();
        since(start_ns).as_secs_f64() * 1e3
    };
    let snapshot = world.snapshot();
    let file = snapshot.save();
    let of = |work: &mut dyn FnMut()| median((0..RUNS).map(|_| ms(work)).collect());
    let copied = of(&mut || drop(world.snapshot()));
    let written = of(&mut || drop(snapshot.save()));
    let read = of(&mut || drop(snapshot.load(&file).expect("its own file")));
    let hashed = (0..RUNS).map(|_| {
        world.step(&Workers::serial(), &MonotonicClock, &StepInputs::default());
        ms(&mut || _ = std::hint::black_box(world.state_hash()))
    });
    let hashed = median(hashed.collect());
    println!(
        "state {when}: file {} kB; copied {copied:.2} ms, written {written:.2} ms, read {read:.1} ms, hashed {hashed:.3} ms",
        file.len() / 1000
    );
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn print_profile(stroke: &mut Stroke) {
    println!("liver: {:?}", stroke.world.counts());
    let outputs: Vec<(f64, StepOutput)> = (0..STEPS)
        .map(|_| {
            let (time, output) = stroke.advance();
            (time.as_secs_f64() * 1e3, output.clone())
        })
        .collect();
    for (name, fracture) in [("without fracture", false), ("with fracture", true)] {
        let chosen: Vec<_> = outputs.iter().filter(|o| (o.1.fracture.parted_links > 0) == fracture).collect();
        let of = |value: &dyn Fn(&StepOutput) -> f64| median(chosen.iter().map(|o| value(&o.1)).collect());
        let whole = median(chosen.iter().map(|o| o.0).collect());
        let parted = chosen.iter().map(|o| o.1.fracture.parted_links).max().unwrap_or(0);
        print!(
            "{name}: {} steps, median {whole:.3} ms, iterations {}, ",
            chosen.len(),
            of(&|o| o.solve.iterations.into())
        );
        print!("links parted {} (most {parted});", of(&|o| o.fracture.parted_links.into()));
        for stage in Stage::ALL {
            let us = of(&|o| o.profile.stage_ns[stage as usize].map_or(f64::NAN, |ns| ns as f64 * 1e-3));
            if us.is_finite() {
                print!(" {} {us:.0} us", stage.name());
            }
        }
        println!();
    }
}

fn liver(criterion: &mut Criterion) {
    print_voxelization();
    let mut stroke = Stroke::new();
    print_state("at rest", &mut stroke.world);
    stroke = Stroke::new();
    print_profile(&mut stroke);
    print_state("after the stroke", &mut stroke.world);
    stroke = Stroke::new();
    let mut group = criterion.benchmark_group("liver");
    group.sample_size(20);
    group.bench_function("step_without_fracture", |b| b.iter_custom(|steps| stroke.time(steps, false)));
    group.bench_function("step_with_fracture", |b| b.iter_custom(|steps| stroke.time(steps, true)));
    group.finish();
}

criterion_group!(benches, liver);
criterion_main!(benches);
