//! A body at rest sleeps: no step is taken of it until something wakes it, and it misses no more than the solver does.

use super::support::press::LAWS;
use super::support::{object, scene, world_beyond_limits, world_of};
use kerf_physics::scene::{BladeDesc, CapsuleDesc, MaterialDesc, Scene, ShapeDesc, ToolDesc};
use kerf_physics::step_io::{StepOutput, ToolMotion};
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};

const TOLERANCE: f64 = 1e-3;
const RADIUS_M: f64 = 0.02;
const TOP_M: f64 = 0.04;
const DEPTH_M: f64 = 1.5e-3;
/// A probe and a blade.
const PROBE: usize = 0;
const BLADE: usize = 1;

/// A block of 40 mm that stands on its held foot under a spherical probe and a blade.
fn block(change: fn(&mut MaterialDesc)) -> Scene {
    let (half, h) = (0.02, 0.0025);
    let mut block = object([-half, 0.0, -half], [half, TOP_M, half], h, 1);
    block.material.young_modulus_pa = 1e5;
    block.material.poisson_ratio = 0.3;
    block.material.rayleigh_beta_s = 2e-3;
    block.material.fracture_energy_j_per_m2 = Some(100.0);
    change(&mut block.material);
    block.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.01 * h, 1.0] }];
    let mut scene = scene(vec![block]);
    scene.desc.solver.relative_tolerance = Some(TOLERANCE);
    let capsule = CapsuleDesc { radius_m: RADIUS_M, length_m: 0.0 };
    scene.desc.tools =
        vec![ToolDesc::probe("probe", capsule), ToolDesc::blade("blade", BladeDesc::straight(0.06, 0.05))];
    scene
}

fn at(y_m: f64) -> ToolMotion {
    ToolMotion::move_to(Pose { position_m: Vec3::new(0.0, y_m, 0.0), orientation: Quat::identity() })
}

/// The probe this deep in the undeformed block.
fn pressed_by(depth_m: f64) -> ToolMotion {
    at(TOP_M + RADIUS_M - depth_m)
}

fn step_with<'w>(world: &'w mut World, workers: &Workers<'_>, tool: usize, motion: ToolMotion) -> &'w StepOutput {
    let output = world.step(workers, &NoClock, &StepInputs::of(&[ToolInput { tool, motion }]));
    assert!(output.fault.is_none(), "{:?}", output.fault);
    output
}

fn step(world: &mut World, tool: usize, motion: ToolMotion) -> &StepOutput {
    step_with(world, &Workers::serial(), tool, motion)
}

fn wait(world: &mut World) -> &StepOutput {
    world.step(&Workers::serial(), &NoClock, &StepInputs::default())
}

/// Presses the probe in within 30 ms, then holds it until the block sleeps; the number of steps that took.
fn press_until_asleep(world: &mut World) -> u32 {
    (1..=30).for_each(|i| _ = step(world, PROBE, pressed_by(DEPTH_M * f64::from(i) / 30.0)));
    until_asleep(world, 3000)
}

fn until_asleep(world: &mut World, most: u32) -> u32 {
    let mut steps = 0;
    while !(0..world.bodies().len()).all(|object| world.is_asleep(object)) {
        wait(world);
        steps += 1;
        assert!(steps < most, "{steps} steps, kinetic energy {} J", world.output().energy.kinetic_j);
    }
    steps
}

/// Largest distance between the nodes of two worlds' first bodies, m.
fn apart_m(a: &World, b: &World) -> f64 {
    let (a, b) = (a.bodies()[0], b.bodies()[0]);
    a.state
        .position_m
        .iter()
        .zip(&b.state.position_m)
        .map(|(a, b)| (Vec3::from(*a) - Vec3::from(*b)).norm())
        .fold(0.0, f64::max)
}

#[test]
fn a_pressed_body_falls_asleep_and_no_step_is_taken_of_it() {
    let mut world = world_of(&block(|_| ()));
    let steps = press_until_asleep(&mut world);
    let before = world.output().clone();
    let positions_m = world.bodies()[0].state.position_m.clone();
    assert!(before.solve.solves > 0);
    assert_eq!(before.energy.kinetic_j, 0.0);
    assert!(before.energy.residual_j.abs() < 1e-6 * before.energy.elastic_j, "{:?}", before.energy);
    let force_n = before.tools[PROBE].wrench.force_n;
    println!("asleep {steps} steps after the press, {:.3} N on the probe", force_n.y);
    for _ in 0..50 {
        let output = wait(&mut world);
        assert_eq!((output.solve.solves, output.solve.iterations), (0, 0));
        assert!((output.tools[PROBE].wrench.force_n - force_n).norm() < TOLERANCE * force_n.norm());
        assert!(output.tools[PROBE].touches);
        assert!((output.energy.elastic_j / before.energy.elastic_j - 1.0).abs() < 1e-9);
        assert!(output.energy.residual_j.abs() < 1e-12 * before.energy.elastic_j, "{:?}", output.energy);
        assert_eq!((output.energy.tool_work_j, output.energy.damping_j), (0.0, 0.0));
    }
    assert_eq!(world.bodies()[0].state.position_m, positions_m);
    // A tool that moves out of reach of it does not wake it.
    step(&mut world, BLADE, at(0.2));
    assert_eq!(step(&mut world, BLADE, at(0.15)).solve.solves, 0);
}

#[test]
fn a_body_that_carries_nothing_comes_to_rest_after_a_press() {
    let mut world = world_of(&block(|_| ()));
    assert_eq!(until_asleep(&mut world, 200), 100, "undisturbed it sleeps after 0.1 s");
    press_until_asleep(&mut world);
    step(&mut world, PROBE, ToolMotion::Lift);
    assert!(!world.is_asleep(0), "let go");
    let steps = until_asleep(&mut world, 3000);
    let body = world.bodies()[0];
    let off_m = (0..body.node_count()).map(|n| (Vec3::from(body.state.position_m[n]) - body.rest_position_m(n)).norm());
    let off_m = off_m.fold(0.0, f64::max);
    println!("asleep {steps} steps after it was let go, {off_m:.1e} m from its shape");
    assert!(off_m < 1e-4 * DEPTH_M, "{off_m} m");
}

#[test]
fn it_misses_no_more_than_the_solver_does() {
    let scene = block(|_| ());
    let mut sleeping = world_of(&scene);
    let mut awake = world_of(&scene);
    let steps = press_until_asleep(&mut sleeping);
    (1..=30).for_each(|i| _ = step(&mut awake, PROBE, pressed_by(DEPTH_M * f64::from(i) / 30.0)));
    // A tenth of a nanometre up and down: it moves.
    let keep_awake = |world: &mut World, i: u32| _ = step(world, PROBE, pressed_by(DEPTH_M + 1e-10 * f64::from(i % 2)));
    for i in 0..steps + 1000 {
        keep_awake(&mut awake, i);
    }
    (0..1000).for_each(|_| _ = wait(&mut sleeping));
    assert!(sleeping.is_asleep(0) && !awake.is_asleep(0));
    let force = |world: &World| world.output().tools[PROBE].wrench.force_n;
    let force_off = (force(&sleeping) - force(&awake)).norm() / force(&awake).norm();
    println!("{:.1e} of the press apart, {force_off:.1e} of the force", apart_m(&sleeping, &awake) / DEPTH_M);
    assert!(apart_m(&sleeping, &awake) < TOLERANCE * DEPTH_M);
    assert!(force_off < TOLERANCE);
    // Woken it goes on like the other.
    for i in 0..40 {
        let depth_m = DEPTH_M * (1.0 + 0.01 * f64::from(i));
        for world in [&mut sleeping, &mut awake] {
            assert!(step(world, PROBE, pressed_by(depth_m)).solve.solves > 0 || i == 0, "step {i}");
        }
    }
    assert!(apart_m(&sleeping, &awake) < TOLERANCE * DEPTH_M, "{}", apart_m(&sleeping, &awake));
    assert!((force(&sleeping) - force(&awake)).norm() < TOLERANCE * force(&awake).norm());
}

#[test]
fn what_touches_changes_or_restores_a_body_wakes_it() {
    let mut world = world_of(&block(|_| ()));
    press_until_asleep(&mut world);
    let asleep = world.snapshot();
    let wakes = |world: &mut World, how: &str, wake: &mut dyn FnMut(&mut World)| {
        world.restore(&asleep);
        assert_eq!(wait(world).solve.solves, 0, "{how}: restored it sleeps");
        wake(world);
        assert!(!world.is_asleep(0), "{how}");
        assert!(world.output().solve.solves > 0, "{how}");
    };
    wakes(&mut world, "the probe moves", &mut |world| _ = step(world, PROBE, pressed_by(1.01 * DEPTH_M)));
    wakes(&mut world, "the probe is lifted", &mut |world| _ = step(world, PROBE, ToolMotion::Lift));
    wakes(&mut world, "a blade touches", &mut |world| {
        step(world, BLADE, at(TOP_M + 0.02));
        assert!(world.is_asleep(0));
        step(world, BLADE, at(TOP_M - 1e-3));
    });
    wakes(&mut world, "it is set", &mut |world| {
        world.body_mut(0).state.velocity_m_per_s[0] = [0.0, 1e-3, 0.0];
        wait(world);
    });
}

#[test]
fn a_body_that_falls_on_one_that_sleeps_wakes_it_and_they_fall_asleep_together() {
    let (half, h) = (0.02, 0.0025);
    let box_at = |name: &str, foot_m: f64| {
        let mut desc = object([-half, foot_m, -half], [half, foot_m + 0.02, half], h, 2);
        desc.name = name.into();
        desc.material.young_modulus_pa = 1e5;
        desc.material.poisson_ratio = 0.3;
        desc.material.rayleigh_beta_s = 5e-3;
        // Without friction it would go on sliding.
        desc.material.friction_coefficient = 0.3;
        desc
    };
    let mut lower = box_at("lower", 0.0);
    lower.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.01 * h, 1.0] }];
    // 0.4 s above it.
    let mut scene = scene(vec![lower, box_at("upper", 0.02 + 0.5 * 9.81 * 0.4 * 0.4)]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    scene.desc.solver.relative_tolerance = Some(TOLERANCE);
    let mut world = world_of(&scene);
    let mut slept = 0;
    let mut met = None;
    for i in 0..500 {
        wait(&mut world);
        assert!(!world.is_asleep(1), "what falls does not sleep");
        slept += u32::from(world.is_asleep(0));
        if world.tissue_springs().iter().any(|spring| spring.force_n > 0.0) {
            met.get_or_insert(i);
        }
        assert!(met.is_none() || !world.is_asleep(0), "step {i}");
    }
    println!("the lower one slept {slept} steps, they met at step {met:?}");
    assert!(slept > 100, "{slept}");
    let met = met.expect("they met");
    assert!((met - 400i32).abs() < 20, "met at step {met}");
    let steps = until_asleep(&mut world, 10_000);
    let weight_n = 9.81 * world.bodies()[1].mass_kg();
    wait(&mut world);
    let up_n: f64 = world
        .tissue_springs()
        .iter()
        .map(|s| s.direction.y * s.force_n * if s.ends.ends[0].body == 1 { 1.0 } else { -1.0 })
        .sum();
    println!("both asleep {steps} steps later, the upper one carried by {:.5} of its weight", up_n / weight_n);
    assert!((up_n / weight_n - 1.0).abs() < 1e-2);
}

#[test]
fn what_creeps_does_not_sleep_before_it_has_relaxed() {
    // What relaxes of the force on a probe held still does so as exp(-t / tau) says.
    let tau_s = 0.3;
    let mut world = world_of(&block(|material| material.viscosity = super::support::viscosity(0.3, 1.0)));
    let steps = press_until_asleep(&mut world);
    let time_s = 1e-3 * f64::from(steps);
    println!("asleep {time_s} s after the press");
    // It carries a part that falls to a thousandth, the tolerance, in 6.9 tau.
    assert!(time_s > 0.8 * tau_s * TOLERANCE.recip().ln(), "{time_s} s");
}

#[test]
fn what_falls_slowly_does_not_sleep() {
    // Free, and so damped that it falls at g / alpha = 0.1 mm/s.
    let (half, h) = (0.01, 0.0025);
    let mut desc = object([-half; 3], [half; 3], h, 2);
    desc.material.rayleigh_alpha_per_s = 1e5;
    let mut scene = scene(vec![desc]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    scene.desc.solver.relative_tolerance = Some(TOLERANCE);
    let mut world = world_beyond_limits(&scene);
    (0..1000).for_each(|_| _ = wait(&mut world));
    let body = world.bodies()[0];
    let fallen_m = body.rest_position_m(0).y - body.state.position_m[0][1];
    println!("fell by {:.4} of g t / alpha", fallen_m / 9.81e-5);
    assert!((fallen_m / 9.81e-5 - 1.0).abs() < 0.01, "{fallen_m}");
}

#[test]
fn sleep_is_the_same_on_any_number_of_threads_and_from_a_snapshot() {
    for law in LAWS {
        let scene = block(law);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        let hashes = |workers: &Workers<'_>, restores: bool| -> Vec<u64> {
            let mut world = world_of(&scene);
            let mut hashes = Vec::new();
            for i in 0..700u32 {
                let depth_m = DEPTH_M * f64::from(i.min(20) + i.saturating_sub(600)) / 20.0;
                step_with(&mut world, workers, PROBE, pressed_by(depth_m));
                if i % 50 == 0 {
                    hashes.push(world.state_hash());
                    if restores {
                        let snapshot = world.snapshot();
                        world.restore(&snapshot);
                    }
                }
            }
            hashes
        };
        let alone = hashes(&Workers::serial(), false);
        assert_eq!(alone, hashes(&Workers::of(&pool), false), "two threads");
        assert_eq!(alone, hashes(&Workers::serial(), true), "from snapshots");
    }
}
