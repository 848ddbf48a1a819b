//! What is refused in a scene that can be read.

use kerf_physics::World;
use kerf_physics::scene::wording::given;
use kerf_physics::scene::{
    BladeDesc, CapsuleDesc, EdgeDesc, FinerDesc, GrasperDesc, MaterialDesc, PrestrainDesc, RateDesc, RegionDesc, Scene,
    SceneDesc, SceneError, ScissorsDesc, ShapeDesc, ToolDesc, ToolShapeDesc, ViscosityDesc,
};

const SCENE: &str = r#"
version = 1
name = "block"
[[objects]]
name = "block"
shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.1, 0.1, 0.1] } }
voxel_size_m = 0.01
level = 1
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4, fracture_energy_j_per_m2 = 200.0 }
[[tools]]
name = "knife"
shape = { blade = { width_m = 0.05, height_m = 0.05 } }
[[tracked_points]]
name = "top"
object = "block"
position_m = [0.05, 0.1, 0.05]
"#;

fn scene() -> SceneDesc {
    SceneDesc::from_toml("block.toml", SCENE).unwrap()
}

/// What is wrong with a scene of no meshes.
fn problems(desc: &SceneDesc) -> Vec<SceneError> {
    Scene { desc: desc.clone(), meshes: Default::default() }.problems()
}

/// The fields that are refused after a change.
fn refused(change: impl FnOnce(&mut SceneDesc)) -> Vec<String> {
    let mut scene = scene();
    change(&mut scene);
    let field = |e: &SceneError| match e {
        SceneError::Field { field, .. } => field.clone(),
        SceneError::InFile { .. } => unreachable!("values are judged, not text"),
    };
    problems(&scene).iter().map(field).collect()
}

#[test]
fn a_sound_scene_has_no_problems() {
    assert_eq!(problems(&scene()), []);
}

#[test]
fn numbers_out_of_range_or_not_finite_are_refused() {
    assert_eq!(refused(|s| s.rate_hz = 9.0), ["rate_hz"]);
    assert_eq!(refused(|s| s.rate_hz = f64::NAN), ["rate_hz"]);
    assert_eq!(refused(|s| s.gravity_m_per_s2[1] = f64::INFINITY), ["gravity_m_per_s2"]);
    assert_eq!(refused(|s| s.objects[0].level = 5), ["objects[0].level"]);
    for across in [0.9, 8.1, f64::NAN] {
        assert_eq!(refused(|s| s.objects[0].min_elements_across = Some(across)), ["objects[0].min_elements_across"]);
    }
    let finer = |level| {
        let shape = ShapeDesc::Sphere { center_m: [0.0; 3], radius_m: 0.01 };
        refused(|s| s.objects[0].finer = vec![FinerDesc { shape, level }])
    };
    assert_eq!(finer(1), ["objects[0].finer[0].level"]);
    assert!(finer(0).is_empty());
    let blade = |change: fn(&mut BladeDesc)| {
        refused(|s| {
            let ToolShapeDesc::Blade(blade) = &mut s.tools[0].shape else { panic!("a blade") };
            change(blade);
        })
    };
    assert_eq!(blade(|b| b.wedge_angle_rad = Some(0.2)), ["tools[0].shape.blade.wedge_angle_rad"]);
    assert_eq!(
        blade(|b| (b.thickness_m, b.wedge_angle_rad) = (1e-3, Some(2.1))),
        ["tools[0].shape.blade.wedge_angle_rad"]
    );
    assert!(blade(|b| (b.thickness_m, b.wedge_angle_rad) = (1e-3, Some(2.0))).is_empty());
    assert_eq!(blade(|b| b.flank_friction = Some(0.0)), ["tools[0].shape.blade.flank_friction"]);
    assert_eq!(blade(|b| b.flank_friction = Some(2.1)), ["tools[0].shape.blade.flank_friction"]);
    assert!(blade(|b| b.flank_friction = Some(2.0)).is_empty());
    let material = |change: fn(&mut MaterialDesc)| refused(|s| change(&mut s.objects[0].material));
    assert_eq!(material(|m| m.poisson_ratio = 0.5), ["objects[0].material.poisson_ratio"]);
    assert_eq!(material(|m| m.density_kg_per_m3 = 0.0), ["objects[0].material.density_kg_per_m3"]);
    assert_eq!(material(|m| m.initiation_ratio = 0.9), ["objects[0].material.initiation_ratio"]);
    assert_eq!(material(|m| m.rayleigh_beta_s = -1e-9), ["objects[0].material.rayleigh_beta_s"]);
    assert_eq!(
        refused(|s| s.tools = vec![ToolDesc::blade("blade", BladeDesc::straight(0.0, 0.05))]),
        ["tools[0].shape.blade.width_m"]
    );
    assert_eq!(refused(|s| s.version = 3), ["version"]);
}

/// A number of a scene: how to set it, the field that names it and its limits.
struct Bound {
    set: fn(&mut SceneDesc, f64),
    field: &'static str,
    limits: [f64; 2],
    /// Fraction of the limit by which a value is just outside.
    beyond: f64,
}

/// A scene that leaves the other limits far away, whatever one number is.
fn roomy() -> SceneDesc {
    let mut scene = scene();
    let object = &mut scene.objects[0];
    object.shape = ShapeDesc::Box { min_m: [0.0; 3], max_m: [1e-4, 1e-4, 1e-4] };
    object.voxel_size_m = Some(5e-5);
    object.material.fracture_energy_j_per_m2 = None;
    object.fixed = vec![object.shape.clone()];
    scene.tools.clear();
    scene
}

/// The viscosity of a scene's material, there from now on.
fn relaxing(scene: &mut SceneDesc) -> &mut ViscosityDesc {
    let some = ViscosityDesc { relaxation_time_s: 0.1, relaxing_modulus_ratio: 0.5 };
    scene.objects[0].material.viscosity.insert(some)
}

fn grasper(scene: &mut SceneDesc) -> &mut GrasperDesc {
    scene.tools = vec![ToolDesc::grasper("tool", GrasperDesc::new(0.01))];
    match &mut scene.tools[0].shape {
        ToolShapeDesc::Grasper(grasper) => grasper,
        other => unreachable!("{other:?}"),
    }
}

fn probe(scene: &mut SceneDesc) -> &mut CapsuleDesc {
    scene.tools = vec![ToolDesc::probe("tool", CapsuleDesc { radius_m: 0.01, length_m: 0.0 })];
    match &mut scene.tools[0].shape {
        ToolShapeDesc::Probe(capsule) => capsule,
        other => unreachable!("{other:?}"),
    }
}

/// The handle of a scene's blade, there from now on.
fn handle(scene: &mut SceneDesc) -> &mut CapsuleDesc {
    scene.tools = vec![ToolDesc::blade("tool", BladeDesc::straight(0.01, 0.01))];
    match &mut scene.tools[0].shape {
        ToolShapeDesc::Blade(blade) => blade.handle.insert(CapsuleDesc { radius_m: 0.01, length_m: 0.0 }),
        other => unreachable!("{other:?}"),
    }
}

fn scissors(scene: &mut SceneDesc) -> &mut ScissorsDesc {
    scene.tools = vec![ToolDesc::scissors("tool", ScissorsDesc::new(0.05, 0.05))];
    match &mut scene.tools[0].shape {
        ToolShapeDesc::Scissors(scissors) => scissors,
        other => unreachable!("{other:?}"),
    }
}

#[test]
fn tools_of_every_kind_are_read_with_their_defaults_and_unknown_ones_are_told_which_there_are() {
    let with = |shape: &str| {
        let text = SCENE.replace("{ blade = { width_m = 0.05, height_m = 0.05 } }", shape);
        SceneDesc::from_toml("block.toml", &text).map_err(|e| e.to_string())
    };
    let read = |shape: &str| with(shape).unwrap().tools[0].clone();
    let holds = ToolDesc::grasper("knife", GrasperDesc::new(0.02));
    assert_eq!(read("{ grasper = { radius_m = 0.02 } }"), holds);
    let presses = ToolDesc::probe("knife", CapsuleDesc { radius_m: 0.02, length_m: 0.0 });
    assert_eq!(read("{ probe = { radius_m = 0.02 } }"), presses);
    let handle = Some(CapsuleDesc { radius_m: 0.02, length_m: 0.1 });
    let held = ToolDesc::blade("knife", BladeDesc { handle, ..BladeDesc::straight(0.05, 0.05) });
    let handle = "handle = { radius_m = 0.02, length_m = 0.1 }";
    assert_eq!(read(&format!("{{ blade = {{ width_m = 0.05, height_m = 0.05, {handle} }} }}")), held);
    let cuts = ToolDesc::scissors("knife", ScissorsDesc::new(0.04, 0.02));
    assert_eq!(read("{ scissors = { blade_length_m = 0.04, blade_height_m = 0.02 } }"), cuts);
    let told = with("{ saw = { radius_m = 0.02 } }").unwrap_err();
    assert!(told.contains("`saw`") && told.contains("`grasper`") && told.contains("`scissors`"), "{told}");
    let told = with("{ grasper = { radius_m = 0.02, force_n = 1.0 } }").unwrap_err();
    assert!(told.contains("force_n") && told.contains("max_force_n"), "{told}");
}

#[test]
fn a_colour_is_written_as_css_writes_it_and_other_texts_are_refused_by_place() {
    let with = |color: &str| {
        let text = SCENE.replace("poisson_ratio = 0.4", &format!("poisson_ratio = 0.4, color = \"{color}\""));
        SceneDesc::from_toml("block.toml", &text).map_err(|e| e.to_string())
    };
    let read = with("#B5473c").unwrap();
    let color = read.objects[0].material.color.unwrap();
    assert_eq!((color.srgb(), color.to_string().as_str()), ([0xb5, 0x47, 0x3c], "#b5473c"));
    assert_eq!(SceneDesc::from_toml("block.toml", &toml::to_string(&read).unwrap()).unwrap(), read);
    for wrong in ["red", "#b5473", "#b5473c0", "b5473c", "#b5473g", "#+12345"] {
        let told = with(wrong).unwrap_err();
        assert!(told.contains("block.toml:9") && told.contains("#rrggbb") && told.contains(wrong), "{told}");
    }
}

#[test]
fn a_probe_or_handle_finer_than_the_surface_and_scissors_over_too_many_voxels_are_refused() {
    assert_eq!(refused(|s| probe(s).radius_m = 0.0201), [""; 0]);
    assert_eq!(refused(|s| probe(s).radius_m = 0.0199), ["tools[0].shape.probe.radius_m"]);
    assert_eq!(refused(|s| handle(s).radius_m = 0.0201), [""; 0]);
    assert_eq!(refused(|s| handle(s).radius_m = 0.0199), ["tools[0].shape.blade.handle.radius_m"]);
    let length = |voxels: f64| {
        refused(|s| {
            *s = roomy();
            scissors(s).blade_length_m = voxels * 5e-5;
        })
    };
    assert_eq!(length(4096.0), [""; 0]);
    assert_eq!(length(4097.0), ["tools[0].shape.scissors.blade_length_m"]);
}

/// The rate law of a scene's fracture energy, there from now on.
fn toughening(scene: &mut SceneDesc) -> &mut RateDesc {
    scene.objects[0].material.rate.insert(RateDesc { reference_speed_m_per_s: 0.01, exponent: 0.5 })
}

#[test]
fn viscosity_is_given_whole_or_not_at_all() {
    let with = |viscosity: &str| {
        let text = SCENE.replace("fracture_energy", &format!("viscosity = {{ {viscosity} }}, fracture_energy"));
        SceneDesc::from_toml("block.toml", &text).map_err(|e| e.to_string())
    };
    let whole = with("relaxation_time_s = 0.1, relaxing_modulus_ratio = 0.5").unwrap();
    assert_eq!(problems(&whole), []);
    assert_eq!(whole.objects[0].material.viscosity, Some(*relaxing(&mut scene())));
    for (given, missing) in
        [("relaxation_time_s = 0.1", "relaxing_modulus_ratio"), ("relaxing_modulus_ratio = 0.5", "relaxation_time_s")]
    {
        let told = with(given).unwrap_err();
        assert!(told.contains("material.viscosity: ") && told.contains(missing), "{told}");
    }
}

#[test]
fn each_number_is_taken_up_to_its_limits_and_refused_beyond_with_field_and_limit() {
    let bound = |set, field, limits, beyond| Bound { set, field, limits, beyond };
    let bounds = [
        bound(|s, v| s.rate_hz = v, "rate_hz", [10.0, 10_000.0], 1e-9),
        bound(
            |s, v| s.objects[0].material.young_modulus_pa = v,
            "objects[0].material.young_modulus_pa",
            [1e2, 1e10],
            1e-9,
        ),
        bound(|s, v| s.objects[0].material.poisson_ratio = v, "objects[0].material.poisson_ratio", [0.0, 0.4999], 1e-9),
        bound(
            |s, v| s.objects[0].material.density_kg_per_m3 = v,
            "objects[0].material.density_kg_per_m3",
            [1.0, 2e4],
            1e-9,
        ),
        bound(
            |s, v| s.objects[0].material.rayleigh_alpha_per_s = v,
            "objects[0].material.rayleigh_alpha_per_s",
            [0.0, 1e4],
            1e-9,
        ),
        bound(
            |s, v| s.objects[0].material.rayleigh_beta_s = v,
            "objects[0].material.rayleigh_beta_s",
            [0.0, 10.0],
            1e-9,
        ),
        bound(
            |s, v| s.objects[0].material.strain_stiffening = v,
            "objects[0].material.strain_stiffening",
            [0.0, 20.0],
            1e-9,
        ),
        bound(
            |s, v| relaxing(s).relaxation_time_s = v,
            "objects[0].material.viscosity.relaxation_time_s",
            [1e-4, 1e4],
            1e-9,
        ),
        bound(
            |s, v| relaxing(s).relaxing_modulus_ratio = v,
            "objects[0].material.viscosity.relaxing_modulus_ratio",
            [1e-6, 100.0],
            1e-6,
        ),
        bound(
            |s, v| s.objects[0].material.prestrain = Some(PrestrainDesc { strain: v, along: None }),
            "objects[0].material.prestrain.strain",
            [-0.2, 0.5],
            1e-9,
        ),
        bound(
            |s, v| {
                let along = Some([0.0, v, 0.0]);
                s.objects[0].material.prestrain = Some(PrestrainDesc { strain: 0.1, along });
            },
            "objects[0].material.prestrain.along",
            [1e-6, 1e6],
            1e-9,
        ),
        bound(
            |s, v| s.objects[0].material.friction_coefficient = v,
            "objects[0].material.friction_coefficient",
            [0.0, 10.0],
            1e-9,
        ),
        bound(
            |s, v| s.objects[0].material.initiation_ratio = v,
            "objects[0].material.initiation_ratio",
            [1.0, 10.0],
            1e-9,
        ),
        bound(
            |s, v| toughening(s).reference_speed_m_per_s = v,
            "objects[0].material.rate.reference_speed_m_per_s",
            [1e-6, 10.0],
            1e-6,
        ),
        bound(|s, v| toughening(s).exponent = v, "objects[0].material.rate.exponent", [0.0, 1.0], 1e-9),
        bound(|s, v| s.objects[0].voxel_size_m = Some(v), "objects[0].voxel_size_m", [1e-5, 1.0], 1e-9),
        bound(|s, v| s.solver.relative_tolerance = Some(v), "solver.relative_tolerance", [1e-12, 0.5], 1e-9),
        bound(|s, v| s.solver.max_iterations = v as u32, "solver.max_iterations", [1.0, 1e5], 1.0),
        bound(|s, v| s.gravity_m_per_s2[2] = v, "gravity_m_per_s2", [-1e3, 1e3], 1e-9),
        bound(|s, v| grasper(s).radius_m = v, "tools[0].shape.grasper.radius_m", [1e-4, 0.1], 1e-9),
        bound(|s, v| grasper(s).max_force_n = Some(v), "tools[0].shape.grasper.max_force_n", [1e-6, 1e6], 1e-9),
        bound(|s, v| probe(s).radius_m = v, "tools[0].shape.probe.radius_m", [1e-4, 1.0], 1e-9),
        bound(|s, v| probe(s).length_m = v, "tools[0].shape.probe.length_m", [0.0, 10.0], 1e-9),
        bound(|s, v| handle(s).radius_m = v, "tools[0].shape.blade.handle.radius_m", [1e-4, 1.0], 1e-9),
        bound(|s, v| handle(s).length_m = v, "tools[0].shape.blade.handle.length_m", [0.0, 10.0], 1e-9),
        bound(|s, v| scissors(s).blade_height_m = v, "tools[0].shape.scissors.blade_height_m", [1e-4, 10.0], 1e-9),
        bound(|s, v| scissors(s).max_angle_rad = v, "tools[0].shape.scissors.max_angle_rad", [0.1, 2.0], 1e-9),
        bound(
            |s, v| scissors(s).edge_half_width_m = v,
            "tools[0].shape.scissors.edge_half_width_m",
            [1e-8, 1e-2],
            1e-9,
        ),
        bound(|s, v| scissors(s).thickness_m = v, "tools[0].shape.scissors.thickness_m", [0.0, 0.1], 1e-9),
    ];
    for Bound { set, field, limits, beyond } in bounds {
        let problems_at = |value: f64| {
            let mut scene = roomy();
            set(&mut scene, value);
            problems(&scene).iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        for (limit, outward) in limits.into_iter().zip([-1.0, 1.0]) {
            assert_eq!(problems_at(limit), [""; 0], "{field} = {limit}");
            let outside = limit + outward * (beyond * limit.abs()).max(1e-12);
            let told = problems_at(outside);
            let named = given(limit.abs());
            assert!(told.len() == 1 && told[0].starts_with(&format!("{field}: ")), "{field} = {outside}: {told:?}");
            assert!(told[0].contains(&named), "{field} = {outside}: {told:?} does not name {named}");
        }
        assert_eq!(problems_at(f64::NAN).len(), 1, "{field} = NaN");
    }
}

#[test]
fn steps_from_a_tenth_of_a_millisecond_to_a_tenth_of_a_second_are_possible() {
    for dt_s in [1e-4, 1e-3, 1e-2, 0.1] {
        let with_step = |s: &mut SceneDesc| {
            s.rate_hz = 1.0 / dt_s;
            let foot = ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 0.01, 1.0] };
            s.objects[0].fixed.push(foot);
        };
        assert_eq!(refused(with_step), [""; 0], "dt {dt_s} s");
    }
}

#[test]
fn a_resolution_that_gives_voxels_out_of_range_is_refused() {
    let with = |side_m: f64, count: u32| {
        refused(|s| {
            *s = roomy();
            s.objects[0].shape = ShapeDesc::Box { min_m: [0.0; 3], max_m: [side_m; 3] };
            s.objects[0].voxel_size_m = None;
            s.objects[0].resolution = Some(count);
        })
    };
    assert_eq!(with(1e-3, 100), [""; 0]);
    assert_eq!(with(1e-3, 101), ["objects[0].resolution"]);
    assert_eq!(with(40.0, 40), [""; 0]);
    assert_eq!(with(41.0, 40), ["objects[0].resolution"]);
}

#[test]
fn stiffness_contrast_is_taken_over_the_whole_object() {
    let contrast = |moduli: &[f64]| {
        refused(|s| {
            *s = roomy();
            let shape = s.objects[0].shape.clone();
            s.objects[0].material.young_modulus_pa = moduli[0];
            for (i, young_modulus_pa) in moduli[1..].iter().copied().enumerate() {
                let material = MaterialDesc { young_modulus_pa, ..s.objects[0].material.clone() };
                s.objects[0].regions.push(RegionDesc { name: format!("r{i}"), shape: shape.clone(), material });
            }
        })
    };
    assert_eq!(contrast(&[1e3, 1e9]), [""; 0]);
    assert_eq!(contrast(&[1e3, 1.01e9]), ["objects[0].regions[0].material.young_modulus_pa"]);
    assert_eq!(contrast(&[1e9, 9e2]), ["objects[0].regions[0].material.young_modulus_pa"]);
    // Neither region is too far from the object's own material; they are from each other.
    assert_eq!(contrast(&[1e6, 1e3, 1e10]), ["objects[0].regions[1].material.young_modulus_pa"]);
}

#[test]
fn waves_may_not_cross_too_many_voxels_of_an_object_that_nothing_holds() {
    // 10 m/s at nu = 0, a step of 0.1 s: 1 m, or 100 voxels of 10 mm.
    let at = |voxel_size_m: f64, poisson_ratio: f64, free: bool| {
        refused(|s| {
            *s = roomy();
            s.rate_hz = 10.0;
            s.objects[0].material.poisson_ratio = poisson_ratio;
            s.objects[0].voxel_size_m = Some(voxel_size_m);
            s.objects[0].shape = ShapeDesc::Box { min_m: [0.0; 3], max_m: [4.0 * voxel_size_m; 3] };
            if free {
                s.objects[0].fixed.clear();
            }
        })
    };
    assert_eq!(at(10.01e-3, 0.0, true), [""; 0]);
    assert_eq!(at(9.99e-3, 0.0, true), ["rate_hz"]);
    assert_eq!(at(10.01e-3, 0.1, true), ["rate_hz"]);
    assert_eq!(at(9.99e-3, 0.1, false), [""; 0]);
}

#[test]
fn a_blade_over_too_many_voxels_is_refused() {
    let width = |width_m: f64| {
        refused(|s| {
            *s = roomy();
            s.tools = vec![ToolDesc::blade("blade", BladeDesc::straight(width_m, 0.05))];
        })
    };
    assert_eq!(width(4096.0 * 5e-5), [""; 0]);
    assert_eq!(width(4097.0 * 5e-5), ["tools[0].shape.blade.width_m"]);
}

/// What is refused of a blade of 50 mm, voxels of 50 um, with this edge.
fn edge_problems(edge: EdgeDesc) -> Vec<String> {
    let mut scene = roomy();
    let blade = BladeDesc { edge, ..BladeDesc::straight(0.05, 0.05) };
    scene.tools = vec![ToolDesc::blade("blade", blade)];
    problems(&scene).iter().map(ToString::to_string).collect()
}

#[test]
fn edges_of_every_shape_are_read_and_taken() {
    for (text, edge) in [
        ("\"straight\"", EdgeDesc::Straight),
        ("{ arc = { sagitta_m = 0.004 } }", EdgeDesc::Arc { sagitta_m: 4e-3 }),
        (
            "{ sine = { amplitude_m = 0.002, wavelength_m = 0.01 } }",
            EdgeDesc::Sine { amplitude_m: 2e-3, wavelength_m: 1e-2 },
        ),
        (
            "{ polyline = { points_m = [[-0.025, 0, 0], [0, -0.002, 0.003], [0.025, 0, 0]] } }",
            EdgeDesc::Polyline { points_m: vec![[-0.025, 0.0, 0.0], [0.0, -2e-3, 3e-3], [0.025, 0.0, 0.0]] },
        ),
        (
            "{ file = { file = \"edge.csv\", scale_m_per_unit = 1e-3 } }",
            EdgeDesc::File { file: "edge.csv".into(), scale_m_per_unit: 1e-3 },
        ),
    ] {
        let text = SCENE.replace("height_m = 0.05 }", &format!("height_m = 0.05, edge = {text} }}"));
        let scene = SceneDesc::from_toml("block.toml", &text).unwrap();
        let ToolShapeDesc::Blade(blade) = &scene.tools[0].shape else { panic!("a blade") };
        assert_eq!(blade.edge, edge);
        assert_eq!(problems(&scene), []);
    }
}

#[test]
fn edges_that_cannot_cut_are_refused_with_field_and_limit() {
    let polyline = |points_m: &[[f64; 3]]| EdgeDesc::Polyline { points_m: points_m.to_vec() };
    let sine = |amplitude_m, wavelength_m| EdgeDesc::Sine { amplitude_m, wavelength_m };
    let (from, to) = ([-0.025, 0.0, 0.0], [0.025, 0.0, 0.0]);
    assert_eq!(edge_problems(EdgeDesc::Arc { sagitta_m: 0.02 }), [""; 0]);
    for (edge, field, limit) in [
        (EdgeDesc::Arc { sagitta_m: 0.022 }, "arc.sagitta_m", "80 degrees"),
        (EdgeDesc::Arc { sagitta_m: f64::NAN }, "arc.sagitta_m", "not finite"),
        (sine(-1e-9, 0.01), "sine.amplitude_m", "0 and 10"),
        (sine(1e-3, 0.05 / 65.0), "sine.wavelength_m", "64"),
        (sine(1.0, 0.01), "sine", "4096"),
        (polyline(&[from]), "polyline.points_m", "between 2 and 4096"),
        (polyline(&[from, from, to]), "polyline.points_m", "points 0 and 1"),
        (polyline(&[from, [f64::NAN, 0.0, 0.0], to]), "polyline.points_m[1]", "10"),
        (polyline(&[from, [0.0, 0.0, 0.0], [1e-3, 0.02, 0.0], to]), "polyline.points_m", "points 1 and 2"),
        (polyline(&[[-25.0, 0.0, 0.0].map(|x| 1e-2 * x), to]), "polyline.points_m", "width_m, 0.05"),
        (EdgeDesc::File { file: String::new(), scale_m_per_unit: 1.0 }, "file.file", "empty"),
        (EdgeDesc::File { file: "edge".into(), scale_m_per_unit: 0.0 }, "file.scale_m_per_unit", "1e-9"),
    ] {
        let told = edge_problems(edge.clone());
        let named = format!("tools[0].shape.blade.edge.{field}: ");
        assert!(told.len() == 1 && told[0].starts_with(&named) && told[0].contains(limit), "{edge:?}: {told:?}");
    }
}

#[test]
fn an_edge_whose_points_are_still_in_a_file_makes_no_world() {
    let mut desc = scene();
    let edge = EdgeDesc::File { file: "edge.csv".into(), scale_m_per_unit: 1.0 };
    desc.tools = vec![ToolDesc::blade("knife", BladeDesc { edge, ..BladeDesc::straight(0.05, 0.05) })];
    let told = World::new(&Scene { desc, meshes: Default::default() }.judge().unwrap()).err().unwrap().to_string();
    assert!(told.starts_with("tools[0].shape.blade.edge.file: ") && told.contains("edge.csv"), "{told}");
}

#[test]
fn every_problem_is_told_at_once() {
    let fields = refused(|s| {
        s.rate_hz = 0.0;
        s.objects[0].material.poisson_ratio = -0.1;
        s.tracked_points[0].object = "elsewhere".into();
    });
    assert_eq!(fields, ["rate_hz", "objects[0].material.poisson_ratio", "tracked_points[0].object"]);
}

#[test]
fn exactly_one_of_voxel_size_and_resolution_is_wanted() {
    assert_eq!(refused(|s| s.objects[0].voxel_size_m = None), ["objects[0].voxel_size_m"]);
    assert_eq!(refused(|s| s.objects[0].resolution = Some(10)), ["objects[0].voxel_size_m"]);
}

#[test]
fn names_are_unique_within_their_kind() {
    assert_eq!(refused(|s| s.tools.push(s.tools[0].clone())), ["tools[1].name"]);
    assert_eq!(refused(|s| s.tracked_points[0].name = String::new()), ["tracked_points[0].name"]);
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
    let inner = ShapeDesc::SmoothUnion { blend_m: 0.0, parts: vec![], without: vec![] };
    let fields =
        refused(|s| s.objects[0].shape = ShapeDesc::SmoothUnion { blend_m: 0.0, parts: vec![inner], without: vec![] });
    assert_eq!(fields, ["objects[0].shape.smooth_union.parts[0]"]);
    let ball = ShapeDesc::Sphere { center_m: [0.0; 3], radius_m: 0.1 };
    let without = vec![ShapeDesc::Sphere { center_m: [0.0; 3], radius_m: -0.1 }];
    let fields = refused(|s| s.objects[0].shape = ShapeDesc::SmoothUnion { blend_m: 0.0, parts: vec![ball], without });
    assert_eq!(fields, ["objects[0].shape.smooth_union.without[0].sphere.radius_m"]);
}

#[test]
fn a_lattice_beyond_the_limit_is_refused() {
    assert_eq!(refused(|s| s.objects[0].voxel_size_m = Some(2e-5)), ["objects[0].voxel_size_m"]);
}

#[test]
fn toughness_beyond_what_the_law_carries_is_refused() {
    // E H = 1e5 Pa * 0.02 m = 2000 N/m; the linear law carries 0.6 of it at level 1.
    let gc = |gc, stiffening| {
        refused(|s| {
            s.objects[0].material.fracture_energy_j_per_m2 = Some(gc);
            s.objects[0].material.strain_stiffening = stiffening;
        })
    };
    assert_eq!(gc(590.0, 0.0), [""; 0]);
    assert_eq!(gc(610.0, 0.0), ["objects[0].material.fracture_energy_j_per_m2"]);
    assert_eq!(gc(14_500.0, 10.0), [""; 0]);
    assert_eq!(gc(15_500.0, 10.0), ["objects[0].material.fracture_energy_j_per_m2"]);
}

#[test]
fn a_label_map_is_refused_by_field_and_no_part_of_a_union() {
    let map = |labels: &[u16], scale, offset_m| ShapeDesc::LabelMap {
        file: "m.nii".into(),
        labels: labels.into(),
        scale,
        offset_m: [offset_m, 0.0, 0.0],
    };
    let refused_map = |shape| refused(|s| s.objects[0].shape = shape);
    assert_eq!(refused_map(map(&[1, 0], 1.0, 0.0)), ["objects[0].shape.label_map.labels"]);
    assert_eq!(refused_map(map(&[1], 0.0, 0.0)), ["objects[0].shape.label_map.scale"]);
    assert_eq!(refused_map(map(&[1], 1.0, f64::NAN)), ["objects[0].shape.label_map.offset_m"]);
    let nameless = ShapeDesc::LabelMap { file: String::new(), labels: vec![], scale: 1.0, offset_m: [0.0; 3] };
    assert_eq!(refused_map(nameless), ["objects[0].shape.label_map.file"]);
    let union = ShapeDesc::SmoothUnion { blend_m: 0.0, parts: vec![map(&[], 1.0, 0.0)], without: vec![] };
    assert_eq!(refused_map(union), ["objects[0].shape.smooth_union.parts[0]"]);
}
