//! What is refused in a scene that can be read.

use kerf_physics::scene::{FinerDesc, MaterialDesc, SceneDesc, SceneError, ShapeDesc};

const SCENE: &str = r#"
version = 1
name = "block"
[[objects]]
name = "block"
shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.1, 0.1, 0.1] } }
voxel_size_m = 0.01
level = 1
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4, fracture_energy_j_per_m2 = 400.0 }
[[tools]]
name = "knife"
blade = { width_m = 0.05, height_m = 0.05 }
[[probes]]
name = "top"
object = "block"
position_m = [0.05, 0.1, 0.05]
"#;

fn scene() -> SceneDesc {
    SceneDesc::from_toml("block.toml", SCENE).unwrap()
}

/// The fields that are refused after a change.
fn refused(change: impl FnOnce(&mut SceneDesc)) -> Vec<String> {
    let mut scene = scene();
    change(&mut scene);
    let field = |e: &SceneError| match e {
        SceneError::Field { field, .. } => field.clone(),
        SceneError::Parse { .. } => unreachable!("values are judged, not text"),
    };
    scene.problems().iter().map(field).collect()
}

#[test]
fn a_sound_scene_has_no_problems() {
    assert_eq!(scene().problems(), []);
}

#[test]
fn numbers_out_of_range_or_not_finite_are_refused() {
    assert_eq!(refused(|s| s.rate_hz = 9.0), ["rate_hz"]);
    assert_eq!(refused(|s| s.rate_hz = f64::NAN), ["rate_hz"]);
    assert_eq!(refused(|s| s.gravity_m_per_s2[1] = f64::INFINITY), ["gravity_m_per_s2"]);
    assert_eq!(refused(|s| s.objects[0].level = 5), ["objects[0].level"]);
    let finer = |level| {
        let shape = ShapeDesc::Sphere { center_m: [0.0; 3], radius_m: 0.01 };
        refused(|s| s.objects[0].finer = vec![FinerDesc { shape, level }])
    };
    assert_eq!(finer(1), ["objects[0].finer[0].level"]);
    assert!(finer(0).is_empty());
    let material = |change: fn(&mut MaterialDesc)| refused(|s| change(&mut s.objects[0].material));
    assert_eq!(material(|m| m.poisson_ratio = 0.5), ["objects[0].material.poisson_ratio"]);
    assert_eq!(material(|m| m.density_kg_per_m3 = 0.0), ["objects[0].material.density_kg_per_m3"]);
    assert_eq!(material(|m| m.initiation_ratio = 0.9), ["objects[0].material.initiation_ratio"]);
    assert_eq!(material(|m| m.rayleigh_beta_s = -1e-9), ["objects[0].material.rayleigh_beta_s"]);
    assert_eq!(refused(|s| s.tools[0].blade.width_m = 0.0), ["tools[0].blade.width_m"]);
    assert_eq!(refused(|s| s.version = 3), ["version"]);
}

#[test]
fn every_problem_is_told_at_once() {
    let fields = refused(|s| {
        s.rate_hz = 0.0;
        s.objects[0].material.poisson_ratio = -0.1;
        s.probes[0].object = "elsewhere".into();
    });
    assert_eq!(fields, ["rate_hz", "objects[0].material.poisson_ratio", "probes[0].object"]);
}

#[test]
fn exactly_one_of_voxel_size_and_resolution_is_wanted() {
    assert_eq!(refused(|s| s.objects[0].voxel_size_m = None), ["objects[0].voxel_size_m"]);
    assert_eq!(refused(|s| s.objects[0].resolution = Some(10)), ["objects[0].voxel_size_m"]);
}

#[test]
fn names_are_unique_within_their_kind() {
    assert_eq!(refused(|s| s.tools.push(s.tools[0].clone())), ["tools[1].name"]);
    assert_eq!(refused(|s| s.probes[0].name = String::new()), ["probes[0].name"]);
}

#[test]
fn shapes_without_extent_are_refused() {
    let fields = refused(|s| s.objects[0].shape = ShapeDesc::Box { min_m: [0.0; 3], max_m: [0.1, 0.0, 0.1] });
    assert_eq!(fields, ["objects[0].shape.box.max_m"]);
    let fields = refused(|s| s.objects[0].fixed.push(ShapeDesc::Sphere { center_m: [0.0; 3], radius_m: -1.0 }));
    assert_eq!(fields, ["objects[0].fixed[0].sphere.radius_m"]);
}

#[test]
fn a_union_holds_no_unions() {
    let inner = ShapeDesc::SmoothUnion { blend_m: 0.0, parts: vec![] };
    let fields = refused(|s| s.objects[0].shape = ShapeDesc::SmoothUnion { blend_m: 0.0, parts: vec![inner] });
    assert_eq!(fields, ["objects[0].shape.smooth_union.parts[0]"]);
}

#[test]
fn a_lattice_beyond_the_limit_is_refused() {
    assert_eq!(refused(|s| s.objects[0].voxel_size_m = Some(2e-5)), ["objects[0].voxel_size_m"]);
}

#[test]
fn toughness_beyond_what_the_law_carries_is_refused() {
    // E H = 1e5 Pa * 0.02 m = 2000 N/m; the linear law carries 0.9 of it at level 1.
    let gc = |gc, stiffening| {
        refused(|s| {
            s.objects[0].material.fracture_energy_j_per_m2 = Some(gc);
            s.objects[0].material.strain_stiffening = stiffening;
        })
    };
    assert_eq!(gc(890.0, 0.0), [""; 0]);
    assert_eq!(gc(910.0, 0.0), ["objects[0].material.fracture_energy_j_per_m2"]);
    assert_eq!(gc(29_000.0, 10.0), [""; 0]);
    assert_eq!(gc(31_000.0, 10.0), ["objects[0].material.fracture_energy_j_per_m2"]);
}
