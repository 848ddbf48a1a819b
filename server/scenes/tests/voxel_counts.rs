//! The built-in scenes as voxels.

use std::collections::BTreeSet;

use kerf_physics::{Grid, Link, region_voxels, voxelize};
use kerf_scenes::catalog;

/// Number of parts that hang together by faces.
fn parts(grid: &Grid) -> usize {
    let mut unseen: BTreeSet<[i32; 3]> = grid.voxels().iter().map(|v| v.ijk).collect();
    let mut parts = 0;
    while let Some(start) = unseen.pop_first() {
        parts += 1;
        let mut open = vec![start];
        while let Some(cell) = open.pop() {
            let reached = Grid::links_of(cell).filter(|(link, _)| grid.link(*link) == Link::Intact);
            open.extend(reached.map(|(_, other)| other).filter(|other| unseen.remove(other)));
        }
    }
    parts
}

#[test]
fn builtin_scenes_have_the_papers_voxels_in_one_part() {
    let cases = [
        ("jelly", [30, 22, 30]),
        ("tofu", [30, 22, 30]),
        ("rubber", [30, 22, 30]),
        ("cuboid", [46, 28, 46]),
        ("cuboid-polyline", [46, 28, 46]),
        ("cuboid-sine", [46, 28, 46]),
        ("gummy-bear", [39, 59, 37]),
        ("liver", [58, 48, 40]),
    ];
    for (name, dims) in cases {
        let paper = catalog::paper_counts(name).unwrap().voxels;
        let scene = catalog::load(name).unwrap();
        let grid = voxelize(&scene.desc.objects[0], &scene.meshes).unwrap();
        let count = grid.voxels().len();
        println!("{name}: {count} voxels in {:?}, {paper} in {dims:?} in the paper", grid.dims());
        assert!((count as f64 / f64::from(paper) - 1.0).abs() < 0.05, "{name}: {count}");
        assert_eq!(grid.dims(), dims, "{name}");
        assert_eq!(parts(&grid), 1, "{name}");
    }
}

#[test]
fn builtin_scenes_hold_some_voxels_and_track_others() {
    for name in catalog::builtin_names() {
        let scene = catalog::load(name).unwrap();
        let object = &scene.desc.objects[0];
        let grid = voxelize(object, &scene.meshes).unwrap();
        let held = region_voxels(&grid, &object.fixed[0], &scene.meshes).unwrap();
        assert!(held.len() > 100 && held.len() < grid.voxels().len() / 5, "{name}: {}", held.len());
        for point in &scene.desc.tracked_points {
            let voxel = grid.voxel_at(grid.cell_of(&point.position_m.into()));
            assert!(voxel.is_some_and(|id| !held.contains(&id)), "{name}: tracked point {}", point.name);
        }
    }
}
