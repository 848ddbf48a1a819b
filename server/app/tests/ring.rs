//! The script of the tense skin cuts a disc of it free from what is around.

use std::path::Path;

use kerf_physics::{NoClock, StepInputs, VoxelId, Workers, World};
use kerf_scenes::catalog;
use kerf_server::scene_args::read_script;

use super::hepatectomy::piece;

/// Where skin ends and fat begins, m.
const FAT_BELOW_M: f64 = 0.016;
/// The scalpel's middle goes round a circle of this radius, m.
const RADIUS_M: f64 = 0.015;
const HALF_BLADE_M: f64 = 0.006;

#[test]
fn the_scalpel_goes_round_a_disc_of_skin_that_hangs_on_the_fat_alone_then() {
    let mut scene = catalog::builtin("tense-skin").unwrap().into_scene();
    scene.desc.rate_hz = 250.0;
    let scene = scene.judge().unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/builtin/tense-skin.csv");
    let mut script = read_script(&path, &scene).unwrap();
    let mut world = World::new(&scene).unwrap();
    for step in 1..=(script.end_s() * scene.desc.rate_hz).round() as u32 {
        let tools = script.advance(f64::from(step) / scene.desc.rate_hz);
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&tools));
        assert!(output.fault.is_none(), "{:?}", output.fault);
    }
    let grid = world.bodies()[0].grid();
    let centre_m = |voxel: VoxelId| grid.centre_m(grid.voxels()[voxel.index()].ijk);
    let is_skin = |voxel: VoxelId| centre_m(voxel).y > FAT_BELOW_M;
    let off_axis_m = |voxel: VoxelId| centre_m(voxel).x.hypot(centre_m(voxel).z);
    let voxels = grid.voxels().iter().filter_map(|voxel| grid.voxel_at(voxel.ijk));
    let skin: Vec<VoxelId> = voxels.filter(|voxel| is_skin(*voxel)).collect();
    let middle = skin.iter().copied().min_by(|a, b| off_axis_m(*a).total_cmp(&off_axis_m(*b))).unwrap();
    let disc = piece(grid, middle, is_skin).len();
    // The blade's leading end cuts.
    let end_radius_m = RADIUS_M.hypot(HALF_BLADE_M);
    let within = skin.iter().filter(|voxel| off_axis_m(**voxel) < end_radius_m).count();
    println!("{disc} voxels of skin hang together in the ring, {within} are within the end's circle");
    let share = disc as f64 / within as f64;
    // A ring that is closed three voxels beside where it began leaves a strip.
    assert!((0.85..1.1).contains(&share), "{share} of the disc");
}
