//! The built-in scenes and the meshes found in the wild, as voxels.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use kerf_physics::grid::voxelize::{region_voxels, voxelize};
use kerf_physics::grid::{Grid, Link};
use kerf_physics::scene::{Meshes, SceneDesc, TriangleMesh};
use kerf_session::catalog;

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
        ("liver-tissue", [58, 48, 40]),
    ];
    for (name, dims) in cases {
        // The paper has no real tissue; its shape is the liver's.
        let paper = catalog::paper_counts(name.trim_end_matches("-tissue")).unwrap().voxels;
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
fn builtin_scenes_hold_some_voxels_and_probe_others() {
    for name in catalog::builtin_names() {
        let scene = catalog::load(name).unwrap();
        let object = &scene.desc.objects[0];
        let grid = voxelize(object, &scene.meshes).unwrap();
        let held = region_voxels(&grid, &object.fixed[0], &scene.meshes).unwrap();
        assert!(held.len() > 100 && held.len() < grid.voxels().len() / 5, "{name}: {}", held.len());
        for probe in &scene.desc.probes {
            let voxel = grid.voxel_at(grid.cell_of(&probe.position_m.into()));
            assert!(voxel.is_some_and(|id| !held.contains(&id)), "{name}: probe {}", probe.name);
        }
    }
}

/// The folder of meshes beside the repository; `None` where there is none.
fn shared_model(file: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/models").join(file);
    let found = path.is_file();
    if !found {
        println!("SKIPPED: {} is absent", path.display());
    }
    found.then_some(path)
}

/// A scene of one mesh scaled to a metre, `resolution` voxels along its longest edge.
fn voxelize_file(path: &Path, resolution: u32) -> (Grid, TriangleMesh) {
    let mesh = catalog::read_mesh(path).unwrap();
    let text = format!(
        "version = 1\nname = 'm'\n[[objects]]\nname = 'm'\nresolution = {resolution}\n\
         shape = {{ mesh = {{ file = 'm', scale_m_per_unit = 1.0 }} }}\n\
         material = {{ young_modulus_pa = 1e5, poisson_ratio = 0.4 }}\n"
    );
    let scene = SceneDesc::from_toml("m", &text).unwrap();
    let grid = voxelize(&scene.objects[0], &Meshes::from([("m".to_owned(), mesh.clone())])).unwrap();
    (grid, mesh)
}

/// Volume enclosed by a mesh by the divergence theorem, either way round, cubic units.
fn enclosed(mesh: &TriangleMesh) -> f64 {
    let corner = |v: u32| kerf_physics::Vec3::from(mesh.positions[v as usize]);
    let sixth = |t: &[u32; 3]| corner(t[0]).cross(&corner(t[1])).dot(&corner(t[2])) / 6.0;
    mesh.triangles.iter().map(sixth).sum::<f64>().abs()
}

#[test]
fn meshes_found_in_the_wild_fill_the_volume_they_enclose() {
    // The bunny's base has holes, so its enclosed volume depends on the origin; it is near enough.
    let cases =
        [("liver.obj", 58, 0.02), ("horse.ply", 60, 0.02), ("bunny.obj", 56, 0.05), ("armadillo.obj", 60, 0.02)];
    for (file, resolution, tolerance) in cases {
        let Some(path) = shared_model(file) else { continue };
        let start = std::time::Instant::now();
        let (grid, mesh) = voxelize_file(&path, resolution);
        let volume = grid.voxels().len() as f64 * grid.voxel_size_m().powi(3);
        let expected = enclosed(&mesh);
        println!(
            "{file}: {} voxels in {:?}, {} parts, volume {volume:.4e} against {expected:.4e}, {:?}",
            grid.voxels().len(),
            grid.dims(),
            parts(&grid),
            start.elapsed(),
        );
        assert!((volume / expected - 1.0).abs() < tolerance, "{file}: {volume} against {expected}");
    }
}
