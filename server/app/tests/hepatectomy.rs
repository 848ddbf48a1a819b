//! The script of the hepatectomy takes the lesion out, whole.

use std::collections::BTreeSet;
use std::path::Path;

use kerf_physics::step_io::Grasp;
use kerf_physics::{Grid, NoClock, StepInputs, VoxelId, Workers, World, region_voxels};
use kerf_scenes::catalog;
use kerf_server::scene_args::read_script;

/// Voxels that `keep` accepts and that hang together with `start` through such voxels, by links that have not parted.
pub fn piece(grid: &Grid, start: VoxelId, keep: impl Fn(VoxelId) -> bool) -> BTreeSet<VoxelId> {
    let mut seen = BTreeSet::from([start]);
    let mut open = vec![start];
    while let Some(voxel) = open.pop() {
        let links = Grid::links_of(grid.voxels()[voxel.index()].ijk).filter(|(link, _)| grid.is_intact(*link));
        let next = links.filter_map(|(_, other)| grid.voxel_at(other)).filter(|next| keep(*next));
        open.extend(next.filter(|next| seen.insert(*next)));
    }
    seen
}

#[test]
fn the_lesion_comes_off_in_one_piece_with_no_cut_in_it() {
    let scene = catalog::builtin("hepatectomy").unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/builtin/hepatectomy.csv");
    let mut script = read_script(&path, &scene).unwrap();
    let mut world = World::new(&scene).unwrap();
    let steps = (script.end_s() * scene.desc.rate_hz).round() as u32;
    let (mut holding, mut area_m2) = (0, 0.0);
    for step in 1..=steps {
        let tools = script.advance(f64::from(step) / scene.desc.rate_hz);
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&tools));
        assert!(output.fault.is_none(), "{:?}", output.fault);
        holding += u32::from(output.tools[1].grasp == Grasp::Holding);
        area_m2 += output.fracture.cut_area_m2;
    }
    let output = world.output().clone();
    let body = world.bodies()[0];
    let grid = body.grid();
    let lesion = region_voxels(grid, &scene.desc.objects[0].regions[0].shape, &scene.meshes).unwrap();
    let removed = piece(grid, lesion[0], |_| true);
    let inside: BTreeSet<VoxelId> = lesion.iter().copied().collect();
    let parted_inside = lesion
        .iter()
        .flat_map(|voxel| Grid::links_of(grid.voxels()[voxel.index()].ijk))
        .filter(|(link, other)| grid.voxel_at(*other).is_some_and(|id| inside.contains(&id)) && !grid.is_intact(*link))
        .count();
    println!(
        "{} of {} voxels come off with the lesion of {}, {:.1} cm^2 cut, {} parts; lesion moved by {:?} m",
        removed.len(),
        grid.voxels().len(),
        lesion.len(),
        1e4 * area_m2,
        body.part_count(),
        output.tracked_displacement_m[1]
    );
    assert!(lesion.len() > 100 && holding > steps - 60, "held in {holding} of {steps} steps");
    assert_eq!(parted_inside, 0, "links parted in the lesion");
    assert!(lesion.iter().all(|voxel| removed.contains(voxel)), "the lesion is in one piece");
    assert!(removed.len() < grid.voxels().len() / 5, "{} voxels come off", removed.len());
    // What is held follows the grasper, which ends 30 mm from where it took hold.
    assert!(output.tracked_displacement_m[1].norm() > 0.02, "{:?}", output.tracked_displacement_m[1]);
}
