//! Meshes that other programs wrote, by `tests/corpus/make_meshes.py`: their volume and area are known.

use std::path::Path;

use kerf_physics::scene::TriangleMesh;

use super::cells::tests::volume_and_area;
use super::{MAX_NUMBERS, parse};
use crate::mesh_faults::mesh_faults;

/// Files whose names begin so, with what is in them.
fn corpus(begin: &str, extensions: &[&str]) -> Vec<(String, TriangleMesh)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/corpus");
    let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let is_wanted = |path: &Path| {
        let name = path.file_name().unwrap().to_string_lossy();
        name.starts_with(begin) && path.extension().is_some_and(|e| extensions.iter().any(|wanted| e == *wanted))
    };
    let read = |path: &Path| {
        let name = path.display().to_string();
        let mesh = parse(path, &std::fs::read(path).unwrap(), MAX_NUMBERS);
        (name.clone(), mesh.unwrap_or_else(|told| panic!("{name}: {told}")))
    };
    paths.filter(|path| is_wanted(path)).map(|path| read(&path)).collect()
}

fn check(files: &[(String, TriangleMesh)], volume: f64, area: f64) {
    for (name, mesh) in files {
        let (found_volume, found_area) = volume_and_area(mesh);
        assert!((found_volume / volume - 1.0).abs() < 1e-12, "{name}: {found_volume}");
        assert!((found_area / area - 1.0).abs() < 1e-12, "{name}: {found_area}");
        assert_eq!(mesh_faults(mesh), [""; 0], "{name}");
    }
}

#[test]
fn a_box_from_vtk_gmsh_and_meshio_has_the_volume_and_area_of_a_box_in_every_encoding() {
    let files = corpus("box-", &["vtu", "vtp", "msh"]);
    assert_eq!(files.len(), 12);
    check(&files, 6.0, 22.0);
}

#[test]
fn cells_of_all_shapes_from_vtk_are_bounded_as_the_cubes_that_they_fill_in_every_encoding() {
    let files = corpus("bar-", &["vtu"]);
    assert_eq!(files.len(), 7);
    // Three cubes in a row, and one by itself.
    check(&files, 4.0, 14.0 + 6.0);
    // The point far away, which only a vertex has, is not in the mesh.
    assert!(files.iter().all(|(_, mesh)| mesh.positions.iter().all(|position| position[0] <= 6.0)));
}
