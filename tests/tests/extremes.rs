//! The quick part of the extremes; `make extremes` runs the whole matrix and writes docs/explanation/stability.md.

use kerf_physics::SceneDesc;
use kerf_scenes::catalog;
use kerf_system_tests::extremes::properties::PROPERTIES;
use kerf_system_tests::extremes::refusals::refusals;
use kerf_system_tests::extremes::{Budget, Family, matrix, run_all};

const SEED: u64 = 1;
/// Inputs that each property is tried on here.
const INPUTS: u32 = 8;

#[test]
fn every_property_holds_for_a_few_inputs() {
    for (name, property) in PROPERTIES {
        property(SEED, INPUTS).unwrap_or_else(|failure| panic!("{name}: {failure}"));
    }
}

/// Cases of the matrix that hold and must go on to.
const HELD: [(Family, &str); 14] = [
    (Family::Materials, "E = 1e2 Pa"),
    (Family::Materials, "E = 1e10 Pa"),
    (Family::Materials, "nu = 0.499"),
    (Family::Materials, "rho = 1"),
    (Family::Materials, "dt = 0.1 s"),
    (Family::Materials, "h = 0.00001 m"),
    (Family::Materials, "h = 1 m"),
    (Family::Contrast, "stiff ball, 1e6 : 1"),
    (Family::Supports, "one voxel, k 4, held"),
    (Family::Supports, "everything held, struck by a blade"),
    (Family::Supports, "cut free: diced by 2 voxels at once"),
    (Family::Starts, "all nodes in one point, k 4, c 0"),
    (Family::Tools, "10 m/s askew, free"),
    (Family::Loads, "pressed by a traction, 1.5 E, c 10"),
];

#[test]
fn cases_from_every_corner_of_the_matrix_hold() {
    let mut cases = matrix(SEED, 0);
    cases.retain(|case| HELD.contains(&(case.family, case.name.as_str())));
    assert_eq!(cases.len(), HELD.len(), "a case was renamed");
    let rows = run_all(&cases, Budget { most_steps: 300 }, |_| ());
    let failed: Vec<_> = rows.iter().filter(|row| !row.findings.is_empty()).collect();
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn what_is_out_of_range_is_refused_with_field_and_limit() {
    let refusals = refusals();
    assert!(refusals.len() >= 20);
    for refusal in refusals {
        assert!(refusal.holds(), "{} ({}): {:?}", refusal.field, refusal.range, refusal.said);
    }
}

#[test]
fn a_scene_file_out_of_range_is_refused_when_it_is_loaded() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("soft.toml");
    let text = "version = 1\nname = \"soft\"\nrate_hz = 10.0\n[[objects]]\nname = \"soft\"\nresolution = 4\n\
                shape = { sphere = { center_m = [0.0, 0.0, 0.0], radius_m = 0.1 } }\n\
                material = { young_modulus_pa = 100.0, poisson_ratio = 0.4999 }\n";
    SceneDesc::from_toml("soft.toml", text).expect("the text of a scene");
    std::fs::write(&file, text).expect("a file");
    catalog::load(file.to_str().expect("a path")).expect("the ends of the ranges are taken");
    std::fs::write(&file, text.replace("= 100.0", "= 99.0")).expect("a file");
    let refused = catalog::load(file.to_str().expect("a path")).expect_err("99 Pa").to_string();
    assert!(refused.contains("objects[0].material.young_modulus_pa: 99 is not between 100 and"), "{refused}");
}
