//! Materials that relax in time, against the standard linear solid solved by hand.

use std::f64::consts::{PI, TAU};

use super::support::{Lcg, body, object, params, run, scene, viscosity, world_of};
use kerf_physics::scene::{Face, LoadDesc, ObjectDesc, RegionDesc, ShapeDesc, ViscosityDesc};
use kerf_physics::{Body, Crossing, LinkId, Mat3, Quat, Vec3, Workers};

const YOUNG_PA: f64 = 1e6;
const EVERYWHERE: ShapeDesc = ShapeDesc::Box { min_m: [-10.0; 3], max_m: [10.0; 3] };

/// A free bar of 80 x 40 x 40 mm, some of its cells partly filled.
fn bar(viscosity: Option<ViscosityDesc>) -> ObjectDesc {
    let mut desc = object([0.0; 3], [0.08, 0.04, 0.05], 0.01, 1);
    desc.material.young_modulus_pa = YOUNG_PA;
    desc.material.poisson_ratio = 0.3;
    desc.material.viscosity = viscosity;
    desc
}

const BAR_SECTION_M2: f64 = 0.04 * 0.05;

/// Stretches the bar along x by a uniaxial stress.
fn stretch(body: &mut Body, strain: f64) {
    for node in 0..body.node_count() {
        let x = body.rest_position_m(node);
        body.state.position_m[node] = [x.x * (1.0 + strain), x.y * (1.0 - 0.3 * strain), x.z * (1.0 - 0.3 * strain)];
    }
}

/// Force on the nodes of the bar's far end, N; against the stretch where positive.
fn end_force_n(body: &Body) -> f64 {
    let forces = body.elastic_forces_n();
    -(0..body.node_count()).filter(|n| body.rest_position_m(*n).x > 0.079).map(|n| forces[n][0]).sum::<f64>()
}

/// A step in which the body is where it was put; what its dashpots dissipated, J.
fn let_time_pass(body: &mut Body) -> f64 {
    let still = vec![[0.0; 3]; body.node_count()];
    body.evaluate_step(&Workers::serial(), &still).elements.viscous_j
}

#[test]
fn the_stress_of_a_held_strain_relaxes_exactly_at_every_step() {
    let (tau, s, strain) = (0.1, 0.5, 1e-6);
    for dt in [0.05, 0.01] {
        let mut body = body(&bar(viscosity(tau, s)), params(dt));
        stretch(&mut body, strain);
        body.evaluate(&Workers::serial(), 30);
        let mut worst = 0.0f64;
        for step in 0..(0.5 / dt) as u32 {
            let t = dt * f64::from(step);
            let expected = YOUNG_PA * strain * BAR_SECTION_M2 * (1.0 + s * (-t / tau).exp());
            worst = worst.max((end_force_n(&body) / expected - 1.0).abs());
            let_time_pass(&mut body);
        }
        println!("dt {dt} s: sigma / (E eps (1 + s exp(-t / tau))) off by at most {worst:.1e}");
        assert!(worst < 1e-5, "dt {dt}: {worst}");
    }
}

/// Storage and loss modulus over E, and energy dissipated in a cycle over E eps^2 V, of a bar that is
/// stretched to and fro `steps` times a period.
fn driven(s: f64, omega_tau: f64, steps: u32) -> [f64; 3] {
    let (tau, strain) = (0.1, 1e-6);
    let period = TAU * tau / omega_tau;
    let mut body = body(&bar(viscosity(tau, s)), params(period / f64::from(steps)));
    let (mut storage, mut loss, mut dissipated) = (0.0, 0.0, 0.0);
    // What the start left has died away by exp(-20) when the last period begins.
    let periods = 1 + (20.0 * tau / period).ceil() as u32;
    for step in 1..=periods * steps {
        let phase = TAU * f64::from(step) / f64::from(steps);
        stretch(&mut body, strain * phase.sin());
        let lost = let_time_pass(&mut body);
        if step > (periods - 1) * steps {
            let stress = end_force_n(&body) / (YOUNG_PA * strain * BAR_SECTION_M2);
            storage += stress * phase.sin() * 2.0 / f64::from(steps);
            loss += stress * phase.cos() * 2.0 / f64::from(steps);
            dissipated += lost / (YOUNG_PA * strain * strain * BAR_SECTION_M2 * 0.08);
        }
    }
    [storage, loss, dissipated]
}

#[test]
fn a_harmonic_strain_meets_the_complex_modulus_of_the_standard_linear_solid() {
    let s = 0.8;
    for x in [0.2f64, 1.0, 5.0] {
        // E* / E = 1 + s i x / (1 + i x) with x = omega tau.
        let (storage, loss) = (1.0 + s * x * x / (1.0 + x * x), s * x / (1.0 + x * x));
        let tangent = s * x / (1.0 + (1.0 + s) * x * x);
        let errors = [40, 80].map(|steps| {
            let [e1, e2, cycle] = driven(s, x, steps);
            let errors = [e1 / storage - 1.0, e2 / loss - 1.0, e2 / e1 / tangent - 1.0, cycle / (PI * loss) - 1.0];
            println!(
                "omega tau {x}, {steps} steps a period: off by {:+.1e} E', {:+.1e} E'', {:+.1e} loss tangent, {:+.1e} \
                 dissipation",
                errors[0], errors[1], errors[2], errors[3]
            );
            errors
        });
        for (coarse, fine) in errors[0].iter().zip(&errors[1]) {
            assert!(fine.abs() < 5e-3, "omega tau {x}: {errors:?}");
            let order = (coarse / fine).abs().log2();
            assert!((order - 2.0).abs() < 0.2 || fine.abs() < 1e-5, "omega tau {x}: order {order}");
        }
    }
}

/// Largest error of the creep strain over the last strain, of a bar that is held at one end, that a dead
/// traction has stretched at once and that stretches on.
fn creep_error(dt_over_tau: f64) -> f64 {
    let (tau, s, traction) = (0.1, 1.0, 10.0);
    let mut desc = bar(viscosity(tau, s));
    desc.material.poisson_ratio = 0.0;
    // Waves run through it in a tenth of a millisecond.
    desc.material.density_kg_per_m3 = 1.0;
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [0.01, 1.0, 1.0] }];
    let traction_pa = [traction, 0.0, 0.0];
    desc.loads = vec![LoadDesc::Traction { region: EVERYWHERE, face: Face::MaxX, traction_pa }];
    let mut scene = scene(vec![desc]);
    scene.desc.rate_hz = 1.0 / (dt_over_tau * tau);
    let mut world = world_of(&scene);
    let end = traction / YOUNG_PA;
    // At once it is stretched like a bar of E (1 + s), beyond the layer that is held.
    let body = world.body_mut(0);
    for node in 0..body.node_count() {
        let x = body.rest_position_m(node);
        body.state.position_m[node] = [x.x + end / (1.0 + s) * (x.x - 0.01).max(0.0), x.y, x.z];
    }
    let mut worst = 0.0f64;
    for step in 1..=(10.0 / dt_over_tau) as u32 {
        run(&mut world, 1);
        let body = world.bodies()[0];
        let mean = |at: f64| {
            let nodes: Vec<usize> =
                (0..body.node_count()).filter(|n| (body.rest_position_m(*n).x - at).abs() < 1e-9).collect();
            nodes.iter().map(|&n| body.state.position_m[n][0] - at).sum::<f64>() / nodes.len() as f64
        };
        let strain = (mean(0.08) - mean(0.04)) / 0.04;
        let t = dt_over_tau * f64::from(step);
        let expected = end * (1.0 - s / (1.0 + s) * (-t / (1.0 + s)).exp());
        worst = worst.max((strain - expected).abs() / end);
    }
    worst
}

#[test]
fn a_dead_traction_makes_the_bar_creep_as_the_solution_says_to_second_order() {
    let errors = [0.8, 0.4].map(creep_error);
    let order = (errors[0] / errors[1]).log2();
    println!("creep strain off by {:.1e} at dt 0.8 tau, {:.1e} at 0.4 tau: order {order:.2}", errors[0], errors[1]);
    assert!(errors[1] < 2e-3, "{errors:?}");
    assert!((1.8..2.2).contains(&order), "order {order}");
}

/// A block strained at random whose memory differs from its strain.
fn strained_at_random() -> Body {
    let mut body = body(&bar(viscosity(0.1, 2.0)), params(0.05));
    let mut rng = Lcg(7);
    for _ in 0..2 {
        for node in 0..body.node_count() {
            let noise = Vec3::new(rng.unit(), rng.unit(), rng.unit()) * 0.006;
            body.state.position_m[node] = (body.rest_position_m(node) + noise).into();
        }
        body.evaluate(&Workers::serial(), 60);
        let_time_pass(&mut body);
    }
    body.evaluate(&Workers::serial(), 60);
    body
}

#[test]
fn a_rotation_turns_the_forces_along_and_no_net_torque_appears() {
    let mut body = strained_at_random();
    let (forces, energy) = (body.elastic_forces_n(), body.energy().elastic_j);
    let largest = forces.iter().flatten().fold(0.0f64, |m, f| m.max(f.abs()));
    let turn = Quat::from_euler_angles(0.4, -1.1, 2.0);
    for x in &mut body.state.position_m {
        *x = (turn * Vec3::from(*x) + Vec3::new(0.3, -0.2, 0.1)).into();
    }
    body.evaluate(&Workers::serial(), 60);
    let turned = body.elastic_forces_n();
    let worst = forces.iter().zip(&turned).map(|(f, g)| (turn * Vec3::from(*f) - Vec3::from(*g)).amax());
    let worst = worst.fold(0.0, f64::max) / largest;
    let (mut force, mut torque) = (Vec3::zeros(), Vec3::zeros());
    for (x, f) in body.state.position_m.iter().zip(&turned) {
        force += Vec3::from(*f);
        torque += Vec3::from(*x).cross(&Vec3::from(*f));
    }
    println!(
        "forces off by {worst:.1e}, net force {:.1e}, torque {:.1e} m",
        force.norm() / largest,
        torque.norm() / largest
    );
    assert!(worst < 1e-9 && (body.energy().elastic_j / energy - 1.0).abs() < 1e-12);
    assert!(force.norm() < 1e-12 * largest && torque.norm() < 1e-13 * largest, "{force} N, {torque} N m");
}

#[test]
fn the_force_of_a_sudden_motion_is_the_negative_gradient_of_the_energy() {
    let mut body = strained_at_random();
    super::support::assert_forces_are_the_energys_slope(&mut body);
}

#[test]
fn a_split_element_hands_its_memory_to_its_parts() {
    let (tau, s, dt) = (0.1, 2.0, 0.05);
    let mut desc = object([0.0; 3], [0.08, 0.04, 0.04], 0.01, 2);
    desc.material.viscosity = viscosity(tau, s);
    let mut body = body(&desc, params(dt));
    let f = Mat3::identity() + 1e-6 * Mat3::new(2.0, 0.5, -1.0, 1.5, -1.5, 2.0, 1.0, -2.0, 2.5);
    for node in 0..body.node_count() {
        body.state.position_m[node] = (f * body.rest_position_m(node)).into();
    }
    body.evaluate(&Workers::serial(), 30);
    let at_once = body.energy().elastic_j;
    let_time_pass(&mut body);
    let before = body.energy().elastic_j;
    // Of the branch's energy exp(-2 dt / tau) is left.
    let expected = at_once * (1.0 + s * (-2.0 * dt / tau).exp()) / (1.0 + s);
    assert!((before / expected - 1.0).abs() < 1e-6, "{before} J against {expected} J");
    let plane =
        (0..16).map(|n| (LinkId { cell: [1, n % 4, n / 4], axis: 0 }, Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] }));
    let parted = body.part_links(&plane.collect::<Vec<_>>()).parted;
    body.update_topology(&Workers::serial(), &parted);
    assert_eq!(body.base().elements.len(), 3);
    // A uniform strain stores the same energy in the parts as in the whole.
    let after = body.energy().elastic_j;
    assert!((after / before - 1.0).abs() < 1e-6, "{after} J after the cut, {before} J before");
}

#[test]
fn relaxing_a_body_leaves_it_at_rest_where_the_elastic_law_does() {
    let mut strains = [0.0; 2];
    for (strain, viscosity) in strains.iter_mut().zip([None, viscosity(0.1, 2.0)]) {
        let mut desc = bar(viscosity);
        let pull =
            |face, sign: f64| LoadDesc::Traction { region: EVERYWHERE, face, traction_pa: [sign * 1e3, 0.0, 0.0] };
        desc.loads = vec![pull(Face::MaxX, 1.0), pull(Face::MinX, -1.0)];
        let mut world = world_of(&scene(vec![desc]));
        assert!(world.relax(&Workers::serial(), &mut |_| ()).converged);
        let at_rest = world.bodies()[0].energy();
        run(&mut world, 50);
        let later = world.bodies()[0].energy();
        assert!((later.elastic_j / at_rest.elastic_j - 1.0).abs() < 1e-5, "{later:?} after {at_rest:?}");
        assert!(later.kinetic_j < 1e-9 * at_rest.elastic_j, "{later:?}");
        *strain = at_rest.elastic_j;
    }
    assert!((strains[1] / strains[0] - 1.0).abs() < 1e-9, "{strains:?} J");
}

#[test]
fn going_back_to_the_last_state_takes_the_memory_back() {
    let mut body = strained_at_random();
    let workers = Workers::serial();
    let (forces, energy) = (body.elastic_forces_n(), body.energy().elastic_j);
    let scale = forces.iter().flatten().fold(0.0f64, |m, f| m.max(f.abs()));
    body.save_state(&workers);
    stretch(&mut body, 0.1);
    let_time_pass(&mut body);
    let lose = |body: &mut Body| {
        body.state.velocity_m_per_s[0][0] = f64::NAN;
        let lost = body.find_lost(f64::INFINITY).expect("not a number");
        body.restore_lost(&workers, &lost);
    };
    lose(&mut body);
    let off = |(a, b): (&[f64; 3], &[f64; 3])| (Vec3::from(*a) - Vec3::from(*b)).amax();
    let worst = forces.iter().zip(&body.elastic_forces_n()).map(off).fold(0.0, f64::max);
    assert!(worst < 1e-9 * scale && (body.energy().elastic_j / energy - 1.0).abs() < 1e-9, "{worst} of {scale} N");
    // Going back at once is giving up: the rest shape, without memory.
    lose(&mut body);
    assert!(body.energy().elastic_j < 1e-20 * energy, "{} J", body.energy().elastic_j);
}

#[test]
fn an_element_of_several_materials_relaxes_as_they_do_side_by_side() {
    let (dt, strain) = (0.01, 1e-6);
    let of = |young_pa: f64, viscosity: Option<ViscosityDesc>| {
        let mut material = bar(viscosity).material;
        (material.young_modulus_pa, material.poisson_ratio) = (young_pa, 0.0);
        material
    };
    let cases = [
        // E, s, tau of two layers in each element; the law of both together, worked by hand.
        ([(1e6, 0.0, 1.0), (3e6, 1.0, 0.05)], (2e6, 0.75, 0.05)),
        ([(1e6, 2.0, 0.3), (3e6, 1.0, 0.05)], (2e6, 1.25, 0.15)),
    ];
    for ([lower, upper], (young, s, tau)) in cases {
        let material = |(e, s, tau): (f64, f64, f64)| of(e, (s > 0.0).then_some(()).and_then(|()| viscosity(tau, s)));
        let mut desc = object([0.0; 3], [0.08, 0.02, 0.04], 0.01, 1);
        desc.material = material(lower);
        let shape = ShapeDesc::Box { min_m: [-1.0, 0.01, -1.0], max_m: [1.0, 0.02, 1.0] };
        desc.regions = vec![RegionDesc { name: "upper".into(), shape, material: material(upper) }];
        let mut body = body(&desc, params(dt));
        for node in 0..body.node_count() {
            let x = body.rest_position_m(node);
            body.state.position_m[node] = [x.x * (1.0 + strain), x.y, x.z];
        }
        body.evaluate(&Workers::serial(), 30);
        for step in 0..20 {
            let t = dt * f64::from(step);
            let expected = young * strain * 0.02 * 0.04 * (1.0 + s * (-t / tau).exp());
            let ratio = end_force_n(&body) / expected;
            assert!((ratio - 1.0).abs() < 1e-5, "t {t}: {ratio}");
            let_time_pass(&mut body);
        }
    }
}
