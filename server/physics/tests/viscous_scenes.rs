//! Materials that relax in time in whole scenes: under a blade, at every step and from violent starts.

use std::f64::consts::PI;

use super::support::press::{cutting_scene, press};
use super::support::{Lcg, motion_hash, object, run, scene, viscosity, world_of};
use kerf_physics::scene::{RegionDesc, ShapeDesc, ViscosityDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, StepInputs, ToolInput, Vec3, Workers};

/// A block pressed by a blade that cannot cut it, at 1 kHz / `finer`; the energies booked over the tool's
/// work: damping, numerical, and the residuals' magnitudes.
fn pressed_and_released(finer: u32) -> [f64; 3] {
    let mut scene = cutting_scene();
    let material = &mut scene.desc.objects[0].material;
    material.fracture_energy_j_per_m2 = None;
    material.rayleigh_beta_s = 0.0;
    material.viscosity = viscosity(0.02, 1.0);
    scene.desc.rate_hz = 1000.0 * f64::from(finer);
    let mut world = world_of(&scene);
    let (mut work, mut damping, mut numerical, mut residual, mut highest) = (0.0, 0.0, 0.0, 0.0, 0.0f64);
    let steps = 60 * finer;
    for i in 0..steps {
        // 3 mm down and up again.
        let depth = 3e-3 * (PI * f64::from(i) / f64::from(steps)).sin();
        let e = press(&mut world, 0.04 - depth).energy;
        work += e.tool_work_j.abs();
        damping += e.damping_j;
        numerical += e.numerical_j;
        residual += e.residual_j.abs();
        highest = highest.max(e.elastic_j);
    }
    // Nothing but what is stored moves it from here on.
    let lift = ToolInput { tool: 0, motion: ToolMotion::Lift };
    let mut before = f64::INFINITY;
    for _ in 0..400 * finer {
        let e = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[lift])).energy;
        let total = e.elastic_j + e.kinetic_j + e.contact_j;
        assert!(total <= before + 1e-9 * highest, "energy grew from {before} to {total} J");
        residual += e.residual_j.abs();
        before = total;
    }
    assert!(before < 1e-6 * highest, "{before} J of {highest} J are left");
    [damping / work, numerical / work, residual / work]
}

#[test]
fn a_pressed_block_books_what_it_dissipates_and_comes_back() {
    let runs = [1, 2, 4].map(|finer| {
        let [damping, numerical, residual] = pressed_and_released(finer);
        println!(
            "dt 1/{finer} ms: of the tool's work {damping:.4} in the dashpots, {numerical:+.4} numerical, {residual:.1e} unexplained"
        );
        assert!(residual < 1e-3, "residual {residual}");
        [damping, numerical]
    });
    // Were the dissipation booked wrongly, what is numerical would not vanish with the step.
    assert!(runs[0][0] > 0.03, "{runs:?}");
    for pair in runs.windows(2) {
        let order = (pair[0][1] / pair[1][1]).log2();
        assert!((order - 1.0).abs() < 0.1, "numerical share falls with order {order}: {runs:?}");
    }
    assert!((runs[1][0] / runs[2][0] - 1.0).abs() < 0.02, "{runs:?}");
}

/// What a blade met on its way into a block.
struct Cut {
    /// Force at a depth of 1 mm, N.
    shallow_n: f64,
    /// Depth at which the first links parted, m, and the highest force until then, N.
    first_m: f64,
    peak_n: f64,
    /// Magnitudes of the residuals over the tool's work.
    residual: f64,
}

const RELAXES_IN_S: f64 = 0.03;

/// A stroke of 15 mm into a block at a speed.
fn cut(viscosity: Option<ViscosityDesc>, speed_m_per_s: f64) -> Cut {
    let mut scene = cutting_scene();
    scene.desc.objects[0].material.viscosity = viscosity;
    let mut world = world_of(&scene);
    let mut cut = Cut { shallow_n: 0.0, first_m: 0.0, peak_n: 0.0, residual: 0.0 };
    let (mut work, mut residual) = (0.0, 0.0);
    for step in -2..=(15.0 / speed_m_per_s) as i32 {
        let depth = 1e-3 * speed_m_per_s * f64::from(step);
        let output = press(&mut world, 0.04 - depth);
        assert!(output.fault.is_none(), "{:?}", output.fault);
        work += output.energy.tool_work_j.abs();
        residual += output.energy.residual_j.abs();
        let force = output.tools[0].wrench.force_n.y;
        if (depth - 1e-3).abs() < 1e-6 {
            cut.shallow_n = force;
        }
        if cut.first_m == 0.0 {
            cut.peak_n = cut.peak_n.max(force);
            cut.first_m = if output.fracture.parted_links > 0 { depth } else { 0.0 };
        }
    }
    cut.residual = residual / work;
    cut
}

#[test]
fn a_fast_blade_meets_more_resistance_and_cuts_at_a_smaller_dent_and_the_same_force() {
    let s = 1.0;
    let mut dents = Vec::new();
    for speed in [0.02, 0.1, 0.5] {
        let (elastic, cut) = (cut(None, speed), cut(viscosity(RELAXES_IN_S, s), speed));
        // Driven at a steady speed the dent is a ramp: F = F_E (1 + s (1 - exp(-t/tau)) tau/t).
        let a = 1e-3 / speed / RELAXES_IN_S;
        let expected = 1.0 + s * (1.0 - (-a).exp()) / a;
        let ratio = cut.shallow_n / elastic.shallow_n;
        println!(
            "{speed} m/s: at 1 mm {ratio:.3} of the elastic force, {expected:.3} expected; parts at {:.2} mm ({:.2} mm) \
             and {:.1} N ({:.1} N); {:.1e} of the work unexplained",
            cut.first_m * 1e3,
            elastic.first_m * 1e3,
            cut.peak_n,
            elastic.peak_n,
            cut.residual
        );
        assert!((ratio / expected - 1.0).abs() < 0.03, "{speed} m/s: {ratio}, not {expected}");
        // What the edge bears is a matter of Gc alone.
        assert!((cut.peak_n / elastic.peak_n - 1.0).abs() < 0.1, "{speed} m/s: {} N", cut.peak_n);
        assert!(cut.residual < 1e-4, "{speed} m/s: {}", cut.residual);
        // Known to the way that the blade goes in a step.
        dents.push((cut.first_m / elastic.first_m, 1e-3 * speed / elastic.first_m));
    }
    let smaller = |slower: &(f64, f64), faster: &(f64, f64)| faster.0 - faster.1 < slower.0;
    assert!(dents.iter().all(|dent| dent.0 < 0.97) && dents.is_sorted_by(smaller), "{dents:?}");
}

#[test]
fn a_relaxing_material_that_no_voxel_is_made_of_changes_no_bit_of_the_state() {
    let hashes = [false, true].map(|named| {
        let mut scene = cutting_scene();
        let object = &mut scene.desc.objects[0];
        let mut material = object.material.clone();
        material.viscosity = named.then_some(()).and_then(|()| viscosity(0.1, 1.0));
        let shape = ShapeDesc::Sphere { center_m: [5.0; 3], radius_m: 0.1 };
        object.regions = vec![RegionDesc { name: "nowhere".into(), shape, material }];
        let mut world = world_of(&scene);
        let mut parted = 0;
        for i in 0..60 {
            parted += press(&mut world, 0.041 - 4e-4 * f64::from(i)).fracture.parted_links;
        }
        assert!(parted > 30, "{parted}");
        motion_hash(&world)
    });
    assert_eq!(hashes[0], hashes[1]);
}

#[test]
fn any_relaxation_time_at_any_step_stays_finite_and_bounded() {
    for dt in [1e-4, 1e-3, 1e-2, 0.1] {
        for tau in [1e-4, 1e-2, 1.0, 1e4] {
            for s in [1e-6, 1.0, 100.0] {
                let mut desc = object([0.0; 3], [0.08, 0.04, 0.04], 0.01, 1);
                desc.material.viscosity = viscosity(tau, s);
                desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [0.01, 1.0, 1.0] }];
                let mut scene = scene(vec![desc]);
                scene.desc.rate_hz = 1.0 / dt;
                assert_eq!(scene.problems(), []);
                let mut world = world_of(&scene);
                let body = world.body_mut(0);
                for node in 0..body.node_count() {
                    let x = body.rest_position_m(node);
                    let out = (x.x - 0.01).max(0.0);
                    body.state.position_m[node] = [x.x + 0.3 * out, x.y - 0.4 * out, x.z * (1.0 - out)];
                }
                body.evaluate(&Workers::serial(), 30);
                let first = body.energy().total_j();
                let mut highest = 0.0f64;
                for _ in 0..60 {
                    run(&mut world, 1);
                    assert!(world.output().fault.is_none(), "dt {dt}, tau {tau}, s {s}: {:?}", world.output().fault);
                    highest = highest.max(world.bodies()[0].energy().total_j());
                }
                assert!(highest < 1.02 * first, "dt {dt}, tau {tau}, s {s}: energy {highest} J, {first} J at first");
            }
        }
    }
}

#[test]
fn violent_starts_gain_no_energy_and_come_to_rest() {
    type Start = fn(Vec3, &mut Lcg) -> Vec3;
    // Of random nodes some elements stay inverted, whether they relax or not.
    let middle = Vec3::new(0.04, 0.02, 0.02);
    let starts: [(&str, Start, f64); 4] = [
        ("stretched by 3", |x, _| x * 3.0, 1e-9),
        ("collapsed to a plane", |x, _| Vec3::new(x.x, 0.0, x.z), 1e-9),
        ("random nodes", |_, r| 0.08 * Vec3::new(r.unit() - 0.5, r.unit() - 0.5, r.unit() - 0.5), 2e-2),
        ("turned inside out", |x, r| Vec3::new(-x.x, x.y, x.z) + 1e-4 * Vec3::new(r.unit(), r.unit(), r.unit()), 1e-9),
    ];
    for (name, start, most_left) in starts {
        for (tau, s) in [(1e-3, 1.0), (0.05, 1.0), (0.05, 10.0), (0.5, 0.3)] {
            let mut desc = object([0.0; 3], [0.08, 0.04, 0.04], 0.005, 2);
            desc.material.young_modulus_pa = 1e4;
            desc.material.rayleigh_alpha_per_s = 4.0;
            desc.material.rayleigh_beta_s = 5e-3;
            desc.material.viscosity = viscosity(tau, s);
            let mut scene = scene(vec![desc]);
            scene.desc.solver.relative_tolerance = Some(1e-3);
            let mut world = world_of(&scene);
            let body = world.body_mut(0);
            let mut rng = Lcg(5);
            for node in 0..body.node_count() {
                body.state.position_m[node] = (middle + start(body.rest_position_m(node) - middle, &mut rng)).into();
            }
            body.evaluate(&Workers::serial(), 60);
            body.refresh_operator(&Workers::serial());
            let first = body.energy().elastic_j;
            let mut highest = 0.0f64;
            for _ in 0..4000 {
                run(&mut world, 1);
                assert!(world.output().fault.is_none(), "{name}: {:?}", world.output().fault);
                highest = highest.max(world.bodies()[0].energy().total_j());
            }
            let left = world.bodies()[0].energy().total_j() / first;
            println!("{name}, tau {tau}, s {s}: energy at most {:.4} of the first, {left:.1e} left", highest / first);
            assert!(highest <= first && left < most_left, "{name}, tau {tau}, s {s}: {highest}, {left} of {first} J");
        }
    }
}
