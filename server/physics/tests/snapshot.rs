//! A world goes back to where it was, and on from there as if nothing had been in between.

use super::support::press::{LAWS, cutting_scene, press_with};
use super::support::world_of;
use kerf_physics::step_io::{StepOutput, ToolMotion};
use kerf_physics::{NoClock, StepInputs, ToolInput, Workers, World};

/// Steps of a stroke before the snapshot, and after it: both part links.
const BEFORE: u32 = 25;
const AFTER: u32 = 30;

/// A world with the blade in a cut.
fn in_a_cut(workers: &Workers<'_>, level: u8, law: usize) -> World {
    let mut scene = cutting_scene();
    scene.desc.objects[0].level = level;
    LAWS[law](&mut scene.desc.objects[0].material);
    let mut world = world_of(&scene);
    let mut parted = 0;
    for i in 0..BEFORE {
        parted += press_with(&mut world, workers, height_m(i)).fracture.parted_links;
    }
    let tool = world.output().tools[0];
    assert!(parted > 0 && tool.touches && tool.cutting_length_m > 0.0, "{parted} links parted");
    world
}

fn height_m(step: u32) -> f64 {
    0.041 - 4e-4 * f64::from(step)
}

/// Goes on with the stroke; what every step left behind.
fn go_on(world: &mut World, workers: &Workers<'_>) -> Vec<(u64, StepOutput)> {
    let step = |i| {
        let output = press_with(world, workers, height_m(BEFORE + i)).clone();
        (world.state_hash(), output)
    };
    (0..AFTER).map(step).collect()
}

/// Something else: the tool is lifted and put down again over the block, and cuts on faster.
fn stray(world: &mut World, workers: &Workers<'_>) {
    let lift = [ToolInput { tool: 0, motion: ToolMotion::Lift }];
    let inputs = StepInputs { work_units: Some(1), ..StepInputs::of(&lift) };
    world.step(workers, &NoClock, &inputs);
    let parted: u32 =
        (0..20).map(|i| press_with(world, workers, 0.045 - 1.5e-3 * f64::from(i)).fracture.parted_links).sum();
    assert!(parted > 0, "the other way cuts too");
}

#[test]
fn a_restored_world_has_the_states_hash_and_goes_on_to_the_same_bits() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("three threads");
    for (level, law) in [(2, 0), (2, 1), (2, 2), (1, 0)] {
        let mut world = in_a_cut(&Workers::serial(), level, law);
        let (snapshot, hash, output) = (world.snapshot(), world.state_hash(), world.output().clone());
        let uninterrupted = go_on(&mut world, &Workers::serial());
        let end_of_cut = world.surface_hash();
        assert!(uninterrupted.iter().any(|(_, output)| output.fracture.parted_links > 0), "the cut goes on");
        for workers in [Workers::serial(), Workers::of(&pool)] {
            stray(&mut world, &workers);
            world.restore(&snapshot);
            assert_eq!((snapshot.step(), world.state_hash(), world.output()), (output.step, hash, &output));
            assert_eq!(go_on(&mut world, &workers), uninterrupted, "level {level}, law {law}");
            assert_eq!(world.surface_hash(), end_of_cut);
        }
    }
}

#[test]
fn a_snapshot_may_be_taken_back_by_another_world_of_the_scene() {
    let mut world = in_a_cut(&Workers::serial(), 2, 0);
    let snapshot = world.snapshot();
    let uninterrupted = go_on(&mut world, &Workers::serial());
    let mut other = world_of(&cutting_scene());
    other.restore(&snapshot);
    assert_eq!(go_on(&mut other, &Workers::serial()), uninterrupted);
}

#[test]
fn the_surface_of_a_restored_world_is_that_of_the_snapshot() {
    let mut world = in_a_cut(&Workers::serial(), 2, 0);
    let (snapshot, shown) = (world.snapshot(), world.keyframe());
    stray(&mut world, &Workers::serial());
    assert_ne!(world.keyframe().surface_hash, shown.surface_hash);
    world.restore(&snapshot);
    assert_eq!(world.topology_patch(), None);
    assert_eq!(world.keyframe(), shown);
}
