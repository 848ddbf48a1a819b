//! Bodies at rest under loads, against beam theory and Hooke's law.

use super::support::{beam, object, scene, world_of};
use kerf_physics::scene::{Face, LoadDesc, ObjectDesc, Scene, ShapeDesc, TrackedPointDesc};
use kerf_physics::{NoClock, StepInputs, Workers, World};

const EVERYWHERE: ShapeDesc = ShapeDesc::Box { min_m: [-10.0; 3], max_m: [10.0; 3] };

/// The cantilever of section 5.4: 0.02 x 0.02 x 0.2 m, E 2 MPa, nu 0.45, rho 1100, its own weight.
const LENGTH_M: f64 = 0.2;
const SIDE_M: f64 = 0.02;
const YOUNG_PA: f64 = 2e6;
const DENSITY_KG_PER_M3: f64 = 1100.0;

fn cantilever(level: u8, h: f64, gravity: f64) -> Scene {
    let clamp = h * f64::from(1 << level);
    let mut desc: ObjectDesc = object([0.0; 3], [SIDE_M, SIDE_M, LENGTH_M + clamp], h, level);
    desc.material.young_modulus_pa = YOUNG_PA;
    desc.material.density_kg_per_m3 = DENSITY_KG_PER_M3;
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.0, clamp] }];
    let mut scene = scene(vec![desc]);
    scene.desc.gravity_m_per_s2 = [0.0, -gravity, 0.0];
    scene
}

/// Mean displacement of the nodes at the free end, m.
fn tip(world: &World) -> [f64; 3] {
    let body = world.bodies()[0];
    let end = (0..body.node_count()).map(|n| body.rest_position_m(n).z).fold(0.0, f64::max);
    let nodes: Vec<usize> = (0..body.node_count()).filter(|n| body.rest_position_m(*n).z > end - 1e-9).collect();
    [0, 1, 2].map(|i| {
        nodes.iter().map(|&n| body.state.position_m[n][i] - body.rest_position_m(n)[i]).sum::<f64>()
            / nodes.len() as f64
    })
}

#[test]
fn a_free_block_under_traction_strains_as_hooke_says() {
    let (h, young, pressure) = (0.005, 1e6, 100.0);
    for poisson in [0.0, 0.3, 0.49] {
        for level in [0, 1, 2] {
            // 6 x 8 x 6 voxels: at level 2 the outer cells are half full.
            let mut desc = object([0.0; 3], [0.03, 0.04, 0.03], h, level);
            desc.material.young_modulus_pa = young;
            desc.material.poisson_ratio = poisson;
            let pull = |face, sign: f64| LoadDesc::Traction {
                region: EVERYWHERE,
                face,
                traction_pa: [0.0, sign * pressure, 0.0],
            };
            desc.loads = vec![pull(Face::MaxY, 1.0), pull(Face::MinY, -1.0)];
            let mut world = world_of(&scene(vec![desc]));
            world.relax(&Workers::serial(), &mut |_| ());
            let body = world.bodies()[0];
            // Strain over the whole lattice, from the extreme nodes of each axis; they are extrapolated
            // by the trilinear field where a cell is half full.
            let strain = |axis: usize| {
                let rest = |n: usize| body.rest_position_m(n)[axis];
                let (low, high) =
                    (0..body.node_count()).fold((f64::MAX, f64::MIN), |(a, b), n| (a.min(rest(n)), b.max(rest(n))));
                let mean = |at: f64| {
                    let nodes: Vec<usize> = (0..body.node_count()).filter(|n| (rest(*n) - at).abs() < 1e-9).collect();
                    nodes.iter().map(|&n| body.state.position_m[n][axis]).sum::<f64>() / nodes.len() as f64
                };
                (mean(high) - mean(low)) / (high - low) - 1.0
            };
            let axial = strain(1) * young / pressure;
            let lateral = [strain(0) * young / pressure, strain(2) * young / pressure];
            println!("nu {poisson}, k {}: E eps_y / p {axial:.6}, E eps_x / p {:.6}", 1 << level, lateral[0]);
            // Linear in the strain of 1e-4, so its square is the error that is allowed.
            assert!((axial - 1.0).abs() < 3e-4, "nu {poisson}, level {level}: {axial}");
            assert!(lateral.iter().all(|l| (l + poisson).abs() < 3e-4), "nu {poisson}, level {level}: {lateral:?}");
        }
    }
}

/// A beam along x, its first layer of voxels held, the other end loaded with `traction_pa`.
fn end_loaded(size_m: [f64; 3], h: f64, young: f64, poisson: f64, traction_pa: [f64; 3]) -> World {
    let mut desc = object([0.0; 3], [size_m[0] + h, size_m[1], size_m[2]], h, 0);
    desc.material.young_modulus_pa = young;
    desc.material.poisson_ratio = poisson;
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [h, 10.0, 10.0] }];
    desc.loads = vec![LoadDesc::Traction { region: EVERYWHERE, face: Face::MaxX, traction_pa }];
    world_of(&scene(vec![desc]))
}

/// Mean displacement of the nodes at the end of the beam, m, at rest.
fn end_at_rest(mut world: World, name: &str) -> [f64; 3] {
    let end = world.relax(&Workers::serial(), &mut |_| ());
    assert!(end.converged, "{name} came to no rest: {end:?}");
    let body = world.bodies()[0];
    let far = (0..body.node_count()).map(|n| body.rest_position_m(n).x).fold(0.0, f64::max);
    let nodes: Vec<usize> = (0..body.node_count()).filter(|n| body.rest_position_m(*n).x > far - 1e-9).collect();
    let mean = [0, 1, 2].map(|i| {
        nodes.iter().map(|&n| body.state.position_m[n][i] - body.rest_position_m(n)[i]).sum::<f64>()
            / nodes.len() as f64
    });
    println!("{name}: end moved by {mean:.3?} m in {} solves", end.solves);
    mean
}

#[test]
fn a_body_without_loads_is_at_rest_at_once() {
    let end = end_loaded([0.2, 0.02, 0.02], 0.005, 1e6, 0.3, [0.0; 3]).relax(&Workers::serial(), &mut |_| ());
    assert!(end.converged && end.solves == 0, "{end:?}");
}

/// A block that its lowest layers of voxels hold, of 1e4 Pa.
fn held_block(level: u8, strain_stiffening: f64, held_m: f64, traction_pa: [f64; 3]) -> World {
    let mut desc = object([0.0; 3], [0.048, 0.048, 0.096], 0.004, level);
    desc.material.young_modulus_pa = 1e4;
    desc.material.strain_stiffening = strain_stiffening;
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.0, held_m] }];
    desc.loads = vec![LoadDesc::Traction { region: EVERYWHERE, face: Face::MaxZ, traction_pa }];
    world_of(&scene(vec![desc]))
}

#[test]
fn a_held_body_without_loads_is_at_rest_at_once_whatever_holds_it() {
    for level in [0, 1, 2] {
        for strain_stiffening in [0.0, 10.0] {
            for held_m in [0.0041, 0.0081, 0.0121, 0.0161] {
                let end = held_block(level, strain_stiffening, held_m, [0.0; 3]).relax(&Workers::serial(), &mut |_| ());
                let case = format!("level {level}, c {strain_stiffening}, held {held_m} m");
                assert!(end.converged && end.solves == 0, "{case}: {end:?}");
            }
        }
    }
}

#[test]
fn a_material_that_stiffens_comes_to_rest_under_a_load_that_hardly_strains_it() {
    // Strains of 1e-4 to 1e-12: near rest the stiffening's energy is the difference of numbers 1e8 to 1e24 times as large.
    let top = |c: f64, pa: f64| {
        let mut world = held_block(2, c, 0.0041, [pa, 0.0, 0.0]);
        let end = world.relax(&Workers::serial(), &mut |_| ());
        assert!(end.converged, "c {c}, {pa} Pa: {end:?}");
        let body = world.bodies()[0];
        let moved = |n: usize| body.state.position_m[n][0] - body.rest_position_m(n).x;
        (0..body.node_count()).map(moved).fold(0.0, f64::max) / pa
    };
    for pa in [1.0, 1e-4, 1e-8] {
        let (stiffening, linear) = (top(10.0, pa), top(0.0, pa));
        assert!((stiffening / linear - 1.0).abs() < 1e-4, "{pa} Pa: {stiffening} m/Pa for {linear}");
    }
}

#[test]
fn a_thousandth_of_a_load_bends_a_thousandth_as_far() {
    let under = |pa: f64| end_at_rest(end_loaded([0.2, 0.02, 0.02], 0.005, 1e6, 0.3, [0.0, pa, 0.0]), "beam")[1];
    let (full, small) = (under(1.0), under(1e-3));
    assert!((small / full * 1e3 - 1.0).abs() < 1e-3, "{small} m for {full} m");
}

#[test]
fn slender_beams_bend_as_macneal_and_harder_say() {
    // 6 x 0.2 x 0.1, E 1e7, nu 0.3, 1 N at the end: 0.1081 over four elements of thickness, 0.4321 over two.
    for (axis, expected, bound) in [(1, 0.1081, 0.02), (2, 0.4321, 0.04)] {
        let mut traction = [0.0; 3];
        traction[axis] = 1.0 / (0.2 * 0.1);
        let moved = end_at_rest(end_loaded([6.0, 0.2, 0.1], 0.05, 1e7, 0.3, traction), "straight beam")[axis];
        assert!((moved / expected - 1.0).abs() < bound, "{moved} m for {expected} m along {axis}");
    }
}

#[test]
fn a_cantilever_bends_far_as_the_elastica_does() {
    // P L^2 / E I = 5 and 10 (Bisshopp and Drucker 1945; Mattiasson 1981): down and back, over L.
    let (length, side, young) = (0.2, 0.02, 1e6);
    for (load, down, back) in [(5.0, 0.713_79, 0.387_63), (10.0, 0.810_61, 0.554_99)] {
        let force = load * young * side * side * side * side / 12.0 / (length * length);
        let world = end_loaded([length, side, side], 0.005, young, 0.0, [0.0, -force / (side * side), 0.0]);
        let [x, y, _] = end_at_rest(world, "elastica");
        assert!((-y / length / down - 1.0).abs() < 0.02, "{y} m down, {down} L");
        assert!((-x / length / back - 1.0).abs() < 0.04, "{x} m back, {back} L");
    }
}

#[test]
fn a_heavy_cantilever_sags_as_the_large_deflection_solution() {
    for (level, h, bound) in [(0, 0.005, 0.03), (1, 0.005, 0.06), (2, 0.0025, 0.07)] {
        let mut world = world_of(&cantilever(level, h, 9.81));
        let end = world.relax(&Workers::serial(), &mut |_| ());
        assert!(end.converged, "level {level} came to no rest: {end:?}");
        let [_, down, back] = tip(&world);
        let (down_error, back_error) = (-down / 31.72e-3 - 1.0, -back / 2.90e-3 - 1.0);
        println!(
            "k {}, h {h}: tip {:.2} mm down ({:+.1} %), {:.2} mm back ({:+.1} %)",
            1 << level,
            -down * 1e3,
            down_error * 100.0,
            -back * 1e3,
            back_error * 100.0
        );
        assert!(down_error.abs() < bound, "level {level}: {down_error} down");
        assert!(back_error.abs() < 2.5 * bound, "level {level}: {back_error} back");
    }
}

#[test]
fn a_plucked_cantilever_swings_at_its_first_frequency() {
    // Small: a hundredth of its weight is taken away. Implicit Euler at 1 kHz damps the 3.44 Hz by
    // pi f dt = 1 % a period and shifts it by half the square of that.
    for (level, h, bound) in [(1, 0.005, 0.05), (2, 0.0025, 0.05)] {
        let mut scene = cantilever(level, h, 0.0981);
        let mut at_rest = world_of(&scene);
        at_rest.relax(&Workers::serial(), &mut |_| ());
        let bent = at_rest.bodies()[0].state.position_m.clone();
        let sag = tip(&at_rest)[1];
        scene.desc.gravity_m_per_s2 = [0.0; 3];
        let mut world = world_of(&scene);
        let body = world.body_mut(0);
        body.state.position_m = bent;
        body.evaluate(&Workers::serial(), 30);
        body.refresh_operator(&Workers::serial());
        // From one downward crossing of zero to the next.
        let (mut before, mut crossings) = (sag, Vec::new());
        for step in 1..600 {
            world.step(&Workers::serial(), &NoClock, &StepInputs::default());
            let now = tip(&world)[1];
            if before * now < 0.0 {
                crossings.push((f64::from(step) - now / (now - before)) * 1e-3);
            }
            before = now;
        }
        assert!(crossings.len() >= 3, "level {level}: {crossings:?}");
        let frequency = 1.0 / (crossings[2] - crossings[0]);
        let error = frequency / 3.44 - 1.0;
        println!(
            "k {}, h {h}: first frequency {frequency:.3} Hz against 3.44 Hz ({:+.1} %)",
            1 << level,
            error * 100.0
        );
        assert!(error.abs() < bound, "level {level}: {frequency} Hz");
    }
}

#[test]
fn tip_errors_grow_with_the_cell_and_do_not_lock() {
    // Same voxels, so that k alone changes: 4, 2 and 1 cells across; against beam theory with shear.
    println!("tip deflection against beam theory, h 5 mm:     k = 1      k = 2      k = 4");
    for (poisson, bounds) in [(0.3, [0.02, 0.04, 0.10]), (0.45, [0.03, 0.06, 0.14]), (0.49, [0.04, 0.08, 0.20])] {
        let errors = [0, 1, 2].map(|level| {
            let (deflection, expected) = beam(level, 0.005, poisson);
            deflection / expected - 1.0
        });
        println!(
            "  nu {poisson:4}                                   {:+7.2} %  {:+7.2} %  {:+7.2} %",
            errors[0] * 100.0,
            errors[1] * 100.0,
            errors[2] * 100.0
        );
        for (level, (error, bound)) in errors.iter().zip(bounds).enumerate() {
            assert!(error.abs() < bound, "nu {poisson}, level {level}: {error}");
        }
    }
}

#[test]
fn tracked_points_tell_of_the_rest_that_a_scene_was_taken_to() {
    let mut block = object([0.0; 3], [0.04; 3], 0.005, 1);
    block.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 0.005, 1.0] }];
    let mut scene = scene(vec![block]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    let object = scene.desc.objects[0].name.clone();
    scene.desc.tracked_points.push(TrackedPointDesc { name: "top".into(), object, position_m: [0.021, 0.039, 0.021] });
    let mut world = world_of(&scene);
    assert!(world.relax(&Workers::serial(), &mut |_| ()).converged);
    let relaxed = world.output().tracked_displacement_m[0];
    assert!(relaxed.y < 0.0);
    let stepped = world.step(&Workers::serial(), &NoClock, &StepInputs::default()).tracked_displacement_m[0];
    assert!((stepped - relaxed).norm() < 1e-3 * relaxed.norm(), "{relaxed:?} m and, a step later, {stepped:?} m");
}
