//! Where tools can be put down without touching anything: by the geometry of a block at rest.

use super::support::{object, scene, world_of};
use kerf_physics::scene::{BladeDesc, CapsuleDesc, GrasperDesc, ScissorsDesc, ToolDesc};
use kerf_physics::{OPEN, Pose, Quat, Vec3, World};

const VOXEL_M: f64 = 2e-3;
const HALF_M: f64 = 0.02;

/// A block about the origin, and the tool.
fn world(tool: ToolDesc) -> World {
    let mut scene = scene(vec![object([-HALF_M; 3], [HALF_M; 3], VOXEL_M, 1)]);
    scene.desc.tools = vec![tool];
    world_of(&scene)
}

fn at(position_m: [f64; 3]) -> Pose {
    Pose { position_m: position_m.into(), orientation: Quat::identity() }
}

#[test]
fn a_blade_is_clear_where_neither_its_edge_nor_what_is_behind_it_is_in_tissue() {
    let world = world(ToolDesc::blade("blade", BladeDesc::straight(0.02, 0.03)));
    let is_clear = |position_m| world.is_clear(0, &at(position_m), OPEN);
    assert!(is_clear([0.0, HALF_M + 1e-4, 0.0]), "above");
    assert!(is_clear([0.0, HALF_M - 0.4 * VOXEL_M, 0.0]), "on the surface");
    assert!(!is_clear([0.0, HALF_M - 1.5 * VOXEL_M, 0.0]) && !is_clear([0.0; 3]), "in it");
    assert!(!is_clear([0.0, -HALF_M - 0.005, 0.0]), "the edge is out below, and the blade is not");
    assert!(is_clear([0.0, -HALF_M - 0.031, 0.0]), "all of it is below");
    assert!(!is_clear([HALF_M + 0.008, 0.0, 0.0]) && is_clear([HALF_M + 0.0101, 0.0, 0.0]), "beside it along the edge");
    assert!(is_clear([0.0, 0.0, HALF_M + 1e-4]), "along its side");
    let along_z = Pose { orientation: Quat::from_axis_angle(&Vec3::y_axis(), 1.5), ..at([0.0, 0.0, HALF_M + 0.005]) };
    assert!(!world.is_clear(0, &along_z, OPEN), "turned into it");
}

#[test]
fn a_blade_is_not_clear_where_its_handle_is_in_tissue() {
    let handle = Some(CapsuleDesc { radius_m: 0.004, length_m: 0.02 });
    let world = world(ToolDesc::blade("blade", BladeDesc { handle, ..BladeDesc::straight(0.02, 0.01) }));
    let is_clear = |y: f64| world.is_clear(0, &at([0.0, y, 0.0]), OPEN);
    assert!(is_clear(HALF_M + 1e-4), "above");
    assert!(!is_clear(-HALF_M - 0.015), "blade and spine are out below, and the handle is not");
    assert!(is_clear(-HALF_M - 0.0381), "all of it is below");
}

#[test]
fn a_probe_is_clear_where_no_more_than_half_a_voxel_of_it_is_in_tissue() {
    let (radius_m, length_m) = (0.004, 0.02);
    let world = world(ToolDesc::probe("probe", CapsuleDesc { radius_m, length_m }));
    let is_clear = |position_m| world.is_clear(0, &at(position_m), OPEN);
    assert!(is_clear([0.0, HALF_M + radius_m + 1e-4, 0.0]) && is_clear([0.0, HALF_M + radius_m - 0.3 * VOXEL_M, 0.0]));
    assert!(!is_clear([0.0, HALF_M + radius_m - VOXEL_M, 0.0]) && !is_clear([0.0; 3]), "on it and in it");
    assert!(!is_clear([HALF_M + 0.012, 0.0, 0.0]) && is_clear([HALF_M + 0.0141, 0.0, 0.0]), "by its end");
}

#[test]
fn scissors_are_clear_around_tissue_and_not_through_it_and_a_grasper_holds_nothing_before_it_closes() {
    let desc = ScissorsDesc { max_angle_rad: 1.0, ..ScissorsDesc::new(0.12, 0.01) };
    let scissors = world(ToolDesc::scissors("scissors", desc));
    // 50 mm from the pivot blades at 0.5 rad are 27 mm off the middle, and the block is 20 mm high either way.
    let pivot = at([-0.07, 0.0, 0.0]);
    assert!(scissors.is_clear(0, &pivot, OPEN));
    assert!(!scissors.is_clear(0, &pivot, 0.5) && !scissors.is_clear(0, &pivot, 0.0));
    let grasper = world(ToolDesc::grasper("grasper", GrasperDesc::new(0.005)));
    assert!(grasper.is_clear(0, &at([0.0; 3]), 0.0));
}
