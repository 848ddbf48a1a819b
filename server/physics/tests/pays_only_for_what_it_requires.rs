//! A scene pays only for what it requires: the stages that a step enters, and the bits that a capability
//! nobody uses leaves alone. (Allocations: `allocation.rs`; times: `make performance`.)

use std::sync::atomic::{AtomicU64, Ordering};

use super::support::motion_hash;
use super::support::press::{cutting_scene, pose_at};
use super::support::world_of;
use kerf_physics::scene::{
    CapsuleDesc, GovernorDesc, GrasperDesc, RegionDesc, Scene, ShapeDesc, ToolDesc, TrackedPointDesc,
};
use kerf_physics::step_io::{ToolInput, ToolMotion};
use kerf_physics::{Stage, StageClock, StepInputs, Workers, World};

/// A clock that is different at each look.
#[derive(Default)]
struct Counter(AtomicU64);

impl StageClock for Counter {
    fn now_ns(&self) -> u64 {
        self.0.fetch_add(1, Ordering::Relaxed)
    }
}

const MOTION: [Stage; 4] = [Stage::ApplyInputs, Stage::Velocities, Stage::Integrate, Stage::Rotations];

/// The stages that a step enters in which the tool does this.
fn stages(world: &mut World, motion: Option<ToolMotion>) -> Vec<Stage> {
    let tools: Vec<_> = motion.map(|motion| ToolInput { tool: 0, motion }).into_iter().collect();
    let output = world.step(&Workers::serial(), &Counter::default(), &StepInputs::of(&tools));
    Stage::ALL.into_iter().filter(|stage| output.profile.stage_ns[*stage as usize].is_some()).collect()
}

fn with(stage: &[Stage]) -> Vec<Stage> {
    let mut all = [&MOTION, stage].concat();
    all.sort();
    all
}

#[test]
fn a_bare_scene_only_moves() {
    let mut scene = cutting_scene();
    scene.desc.tools.clear();
    assert_eq!(stages(&mut world_of(&scene), None), MOTION);
}

#[test]
fn a_tool_costs_contact_while_it_is_there_and_fracture_while_its_edge_touches() {
    let mut world = world_of(&cutting_scene());
    assert_eq!(stages(&mut world, None), MOTION, "it has not entered");
    assert_eq!(stages(&mut world, Some(pose_at(0.3))), with(&[Stage::Contact]), "it hangs above");
    assert_eq!(stages(&mut world, Some(pose_at(0.045))), with(&[Stage::Contact]), "it comes down");
    assert_eq!(stages(&mut world, Some(pose_at(0.0395))), with(&[Stage::Contact, Stage::Fracture]), "it touches");
    assert_eq!(stages(&mut world, Some(ToolMotion::Lift)), MOTION, "it is lifted");
}

#[test]
fn the_surface_is_adapted_where_somebody_looks_and_a_tool_touches() {
    let mut world = world_of(&cutting_scene());
    let touching = [Stage::Contact, Stage::Fracture];
    stages(&mut world, Some(pose_at(0.045)));
    assert_eq!(stages(&mut world, Some(pose_at(0.0395))), with(&touching), "nobody looks");
    let _ = world.keyframe();
    assert_eq!(stages(&mut world, Some(pose_at(0.0394))), with(&touching), "it touches, and the step is not shown");
    assert!(world.adapted_vertices(0).is_empty());
    let took_ns = world.adapt_surface(&Counter::default());
    assert!(took_ns.is_some_and(|ns| ns > 0), "it is shown");
    assert_eq!(world.output().profile.stage_ns[Stage::Adaptation as usize], took_ns);
    assert!(!world.adapted_vertices(0).is_empty());
    assert_eq!(world.adapt_surface(&Counter::default()), None, "once a step");
    assert_eq!(stages(&mut world, Some(pose_at(0.045))), with(&[Stage::Contact]), "it is drawn back");
    assert_eq!(world.adapt_surface(&Counter::default()), None);
    assert!(world.adapted_vertices(0).is_empty());
    stages(&mut world, Some(pose_at(0.0394)));
    world.forget_surface();
    assert_eq!(stages(&mut world, Some(pose_at(0.0393))), with(&touching), "nobody looks any more");
    assert_eq!(world.adapt_surface(&Counter::default()), None);
    assert!(world.adapted_vertices(0).is_empty());
}

#[test]
fn tissue_is_looked_for_at_tissue_where_there_is_more_than_one_piece_of_surface() {
    let mut scene = cutting_scene();
    let mut world = world_of(&scene);
    let mut cut = false;
    for i in 0..60 {
        let stages = stages(&mut world, Some(pose_at(0.041 - 4e-4 * f64::from(i))));
        assert_eq!(stages.contains(&Stage::SelfContact), cut, "step {i}");
        cut |= world.output().fracture.parted_links > 0;
    }
    assert!(cut);
    let mut other = scene.desc.objects[0].clone();
    other.name = "other".into();
    scene.desc.objects.push(other);
    assert_eq!(stages(&mut world_of(&scene), None), with(&[Stage::SelfContact]), "two objects");
}

#[test]
fn topology_and_surface_are_entered_by_steps_in_which_links_part() {
    let mut world = world_of(&cutting_scene());
    let mut entered = [0u32; 2];
    for i in 0..60 {
        if i == 45 {
            // Somebody comes to look.
            let _ = world.surface_hash();
        }
        let motion = pose_at(0.041 - 4e-4 * f64::from(i));
        let stages = stages(&mut world, Some(motion));
        let parted = world.output().fracture.parted_links > 0;
        assert_eq!(stages.contains(&Stage::Topology), parted);
        assert_eq!(stages.contains(&Stage::Surface), parted && i >= 45);
        entered[0] += u32::from(parted);
        entered[1] += u32::from(parted && i >= 45);
    }
    assert!(entered.iter().all(|count| *count > 3), "{entered:?}");
}

/// Hash of the motion and solver iterations after a stroke that cuts.
fn stroke(scene: &Scene, mut look: impl FnMut(&mut World)) -> (u64, u32) {
    let mut world = world_of(scene);
    let mut iterations = 0;
    for i in 0..50 {
        let motion = pose_at(0.041 - 4e-4 * f64::from(i));
        let inputs = [ToolInput { tool: 0, motion }];
        iterations += world.step(&Workers::serial(), &Counter::default(), &StepInputs::of(&inputs)).solve.iterations;
        look(&mut world);
    }
    assert!(world.output().topology_version > 3);
    (motion_hash(&world), iterations)
}

#[test]
fn what_nobody_uses_leaves_every_bit_as_it_is() {
    let bare = cutting_scene();
    let expected = stroke(&bare, |_| ());
    let changed = |change: fn(&mut Scene)| {
        let mut scene = bare.clone();
        change(&mut scene);
        stroke(&scene, |_| ())
    };
    let point = |scene: &mut Scene| {
        let object = scene.desc.objects[0].name.clone();
        scene.desc.tracked_points.push(TrackedPointDesc { name: "p".into(), object, position_m: [0.001, 0.02, 0.001] });
    };
    assert_eq!(changed(point), expected, "a tracked point");
    assert_eq!(
        changed(|scene| scene.desc.governor = Some(GovernorDesc { max_relative_tolerance: 0.1 })),
        expected,
        "a governor's bounds"
    );
    assert_eq!(stroke(&bare, |world| _ = world.surface_hash()), expected, "a viewer");
    assert_eq!(
        changed(|scene| {
            let tools = &mut scene.desc.tools;
            tools.push(ToolDesc::grasper("grasper", GrasperDesc::new(0.01)));
            tools.push(ToolDesc::probe("probe", CapsuleDesc { radius_m: 0.01, length_m: 0.0 }));
        }),
        expected,
        "tools that never enter"
    );
    let mut region = bare.clone();
    let material = region.desc.objects[0].material.clone();
    let (name, shape) = ("elsewhere".into(), ShapeDesc::Sphere { center_m: [1.0; 3], radius_m: 0.01 });
    region.desc.objects[0].regions.push(RegionDesc { name, shape, material });
    assert_eq!(stroke(&region, |_| ()), expected, "a region that holds no voxel");
}
