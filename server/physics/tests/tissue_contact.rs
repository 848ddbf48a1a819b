//! Tissue against tissue: bodies, parts and flaps press on each other and do not pass through.

use super::support::{object, scene, world_beyond_limits, world_of};
use kerf_physics::scene::{Face, LoadDesc, ObjectDesc, ShapeDesc};
use kerf_physics::{Body, Crossing, LinkId, MaterialPoint, NoClock, StepInputs, Vec3, Workers, World};

const H_M: f64 = 0.0025;
const SIDE_M: f64 = 0.04;
const YOUNG_PA: f64 = 1e5;

fn everywhere_below(y: f64) -> ShapeDesc {
    ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, y, 1.0] }
}

/// A block of 40 x `height` x 40 mm with its foot at `foot`.
fn block(name: &str, foot_m: f64, height_m: f64, level: u8) -> ObjectDesc {
    let half = 0.5 * SIDE_M;
    let mut desc = object([-half, foot_m, -half], [half, foot_m + height_m, half], H_M, level);
    desc.name = name.into();
    desc.material.young_modulus_pa = YOUNG_PA;
    desc.material.poisson_ratio = 0.3;
    desc.material.rayleigh_beta_s = 1e-3;
    desc
}

/// What a run booked, J.
#[derive(Default)]
struct Booked {
    load_work_j: f64,
    friction_j: f64,
    residual_j: f64,
}

/// Steps without input.
fn run(world: &mut World, steps: usize) -> Booked {
    let mut booked = Booked::default();
    for _ in 0..steps {
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::default());
        assert!(output.fault.is_none(), "{:?}", output.fault);
        booked.load_work_j += output.energy.load_work_j;
        booked.friction_j += output.energy.friction_j;
        booked.residual_j += output.energy.residual_j.abs();
    }
    booked
}

/// Force of the springs between bodies on the first one, N.
fn force_on_first_n(world: &World) -> Vec3 {
    let on_first = |body: u32| if body == 0 { 1.0 } else { -1.0 };
    world.tissue_springs().iter().map(|s| s.direction * (s.force_n * on_first(s.ends.ends[0].body))).sum()
}

fn deepest_m(world: &World) -> f64 {
    world.tissue_springs().iter().map(|s| s.gap_m).fold(0.0, f64::max)
}

/// Linear momentum, N s, and angular momentum about the origin, N m s.
fn momentum(world: &World) -> (Vec3, Vec3) {
    let (mut linear, mut angular) = (Vec3::zeros(), Vec3::zeros());
    for body in world.bodies() {
        for (p, x) in body.nodal_momentum().iter().zip(&body.state.position_m) {
            linear += Vec3::from(*p);
            angular += Vec3::from(*x).cross(&Vec3::from(*p));
        }
    }
    (linear, angular)
}

fn velocity_m_per_s(body: &Body) -> Vec3 {
    body.nodal_momentum().iter().map(|p| Vec3::from(*p)).sum::<Vec3>() / body.mass_kg()
}

/// Displacements along y of the middles of the uppermost faces of a body, m.
fn top_m(body: &Body, top_m: f64) -> Vec<f64> {
    let grid = &body.state.grid;
    let rows = grid.dims()[1] - 1;
    let faces = (0..grid.voxels().len() as u32).map(kerf_physics::VoxelId);
    let upper = faces.filter(|v| grid.voxels()[v.index()].ijk[1] == rows);
    upper
        .map(|voxel| {
            let mut position_m = grid.centre_m(grid.voxels()[voxel.index()].ijk);
            position_m.y = top_m;
            body.current_m(&MaterialPoint { position_m, voxel }).y - top_m
        })
        .collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn a_block_rests_on_another_and_presses_with_its_weight() {
    let mut lower = block("lower", 0.0, 0.02, 2);
    lower.fixed = vec![everywhere_below(1.01 * H_M)];
    let upper = block("upper", 0.02, 0.02, 2);
    let mut scene = scene(vec![upper, lower]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    let mut world = world_of(&scene);
    let booked = run(&mut world, 200);
    let weight_n = 9.81 * world.bodies()[0].mass_kg();
    let force_n = force_on_first_n(&world);
    println!("presses with {:.5} of its weight, residual {:.1e} J", force_n.y / weight_n, booked.residual_j);
    assert!((force_n - Vec3::new(0.0, weight_n, 0.0)).norm() < 1e-3 * weight_n, "{force_n:?} of {weight_n}");
    assert!(deepest_m(&world) < 0.01 * H_M, "{} m deep", deepest_m(&world));
    assert!(booked.residual_j < 1e-4 * world.output().energy.elastic_j, "{} J", booked.residual_j);
}

#[test]
fn bodies_that_collide_askew_keep_linear_and_angular_momentum_and_rebound() {
    let mut a = block("a", 0.0, 0.03, 2);
    let half = 0.5 * SIDE_M;
    // Of another mesh, off the other's middle.
    let mut b = object([0.01 - half, 0.031, 0.005 - half], [0.01 + half, 0.061, 0.005 + half], 0.002, 2);
    b.name = "b".into();
    a.material.rayleigh_beta_s = 0.0;
    b.material = a.material.clone();
    let mut world = world_of(&scene(vec![a, b]));
    world.body_mut(0).state.velocity_m_per_s.iter_mut().for_each(|v| *v = [0.0, 0.5, 0.0]);
    world.body_mut(1).state.velocity_m_per_s.iter_mut().for_each(|v| *v = [0.1, -0.5, 0.0]);
    run(&mut world, 1);
    let (linear, angular) = momentum(&world);
    let before_j = world.output().energy.kinetic_j;
    let (mut deepest, mut hardest, mut residual_j) = (0.0f64, 0.0f64, 0.0);
    for _ in 0..80 {
        residual_j += run(&mut world, 1).residual_j;
        deepest = deepest.max(deepest_m(&world));
        hardest = hardest.max(force_on_first_n(&world).norm());
    }
    let (linear_after, angular_after) = momentum(&world);
    let apart = velocity_m_per_s(world.bodies()[1]).y - velocity_m_per_s(world.bodies()[0]).y;
    let mass = world.bodies()[0].mass_kg();
    let off = [(linear_after - linear).norm() / (0.5 * mass), (angular_after - angular).norm() / (0.5 * mass * 0.03)];
    println!("at most {hardest:.1} N, {:.4} h deep; apart at {apart:.3} m/s; momenta off by {off:?}", deepest / H_M);
    assert!(hardest > 1.0 && force_on_first_n(&world) == Vec3::zeros(), "they met and parted");
    assert!((0.1..1.0).contains(&apart), "apart at {apart} m/s");
    assert!(off.iter().all(|off| *off < 1e-10), "{off:?}");
    assert!(deepest < 0.1 * H_M, "{deepest} m deep");
    assert!(residual_j < 1e-3 * before_j, "{residual_j} of {before_j} J");
    let after = world.output().energy;
    assert!(after.kinetic_j + after.elastic_j < before_j);
}

/// Parts the links across the plane y = row + `t` for the columns that `keep` accepts.
fn cut(world: &mut World, row: i32, t: f32, keep: impl Fn([i32; 3]) -> bool) -> Vec<LinkId> {
    let body = world.body_mut(0);
    let [nx, _, nz] = body.state.grid.dims();
    let cells = (0..nz).flat_map(|z| (0..nx).map(move |x| [x, row, z])).filter(|cell| keep(*cell));
    let crossing = Crossing { t, normal: [0.0, 1.0, 0.0] };
    let links: Vec<_> = cells.map(|cell| (LinkId { cell, axis: 1 }, crossing)).collect();
    let parted = body.part_links(&links).parted;
    assert_eq!(parted.len(), links.len());
    body.update_topology(&Workers::serial(), &parted);
    parted
}

/// A block of 40 x 60 x 40 mm that stands on its foot with a traction on its top.
fn pressed_block(traction_pa: f64) -> World {
    let mut desc = block("block", 0.0, 0.06, 2);
    desc.material.rayleigh_alpha_per_s = 60.0;
    desc.fixed = vec![everywhere_below(1.01 * H_M)];
    let region = ShapeDesc::Box { min_m: [-1.0, 0.0575, -1.0], max_m: [1.0; 3] };
    desc.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa: [0.0, traction_pa, 0.0] }];
    world_of(&scene(vec![desc]))
}

#[test]
fn a_closed_cut_carries_pressure_like_the_uncut_block_and_opens_freely_under_tension() {
    let sunk = |world: &World| mean(&top_m(world.bodies()[0], 0.06));
    let [pressed, drawn] = [-2e3, 2e3].map(|traction_pa| {
        let mut whole = pressed_block(traction_pa);
        run(&mut whole, 300);
        sunk(&whole)
    });
    // On a face of the elements, and through their middles; half through, and all through.
    for (row, t) in [(11, 0.5), (13, 0.4)] {
        for columns in [8, 16] {
            let mut world = pressed_block(-2e3);
            cut(&mut world, row, t, |cell| cell[0] < columns);
            let booked = run(&mut world, 300);
            let ratio = sunk(&world) / pressed;
            println!("row {row}, {columns} columns: sinks {ratio:.4} of the uncut, residual {:.1e}", booked.residual_j);
            assert!((0.999..1.03).contains(&ratio), "row {row}, {columns} columns: {ratio} of the uncut");
            assert!(booked.residual_j < 1e-5 * world.output().energy.elastic_j, "{} J", booked.residual_j);
            let mut world = pressed_block(2e3);
            cut(&mut world, row, t, |cell| cell[0] < columns);
            run(&mut world, 40);
            assert!(world.tissue_springs().iter().all(|s| s.force_n == 0.0), "nothing holds an open cut together");
            assert!(sunk(&world) > 1.3 * drawn, "{} of {drawn}", sunk(&world));
        }
    }
}

#[test]
fn blocks_of_different_meshes_pressed_together_yield_evenly_like_one() {
    let traction_pa = -2e3;
    let mut lower = block("lower", 0.0, 0.03, 2);
    lower.fixed = vec![everywhere_below(1.01 * H_M)];
    let half = 0.5 * SIDE_M;
    let mut upper = object([-half, 0.03, -half], [half, 0.06, half], 0.002, 2);
    upper.name = "upper".into();
    upper.material = lower.material.clone();
    let region = ShapeDesc::Box { min_m: [-1.0, 0.0575, -1.0], max_m: [1.0; 3] };
    upper.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa: [0.0, traction_pa, 0.0] }];
    for object in [&mut lower, &mut upper] {
        object.material.poisson_ratio = 0.0;
        object.material.rayleigh_alpha_per_s = 60.0;
    }
    let (lower_material, loads) = (lower.material.clone(), upper.loads.clone());
    let mut world = world_of(&scene(vec![upper, lower]));
    run(&mut world, 300);
    let mut whole = block("whole", 0.0, 0.06, 2);
    whole.material = lower_material;
    whole.fixed = vec![everywhere_below(1.01 * H_M)];
    whole.loads = loads;
    let mut whole = world_of(&scene(vec![whole]));
    run(&mut whole, 300);
    let expected_m = mean(&top_m(whole.bodies()[0], 0.06));
    let top: Vec<f64> = top_m(world.bodies()[0], 0.06).iter().map(|d| d / expected_m).collect();
    let (low, high) = top.iter().fold((f64::MAX, f64::MIN), |(low, high), d| (low.min(*d), high.max(*d)));
    let force_n = force_on_first_n(&world);
    println!("sinks by {:.4} of the solid block, {low:.4} to {high:.4}; force {force_n:?} N", mean(&top));
    assert!((0.99..1.03).contains(&mean(&top)), "{} of the solid block", mean(&top));
    assert!(high - low < 0.03, "{low} to {high}");
    assert!((force_n.y / (-traction_pa * SIDE_M * SIDE_M) - 1.0).abs() < 1e-3, "{force_n:?}");
}

/// A block of 40 x 10 x 20 mm on a long slab, drawn along it by `pull` of its weight; its speed after 50
/// steps, what it gained in 50 more over g, and what these booked.
fn drawn_along(pull: f64, mu: f64) -> (f64, f64, Booked) {
    let (g, half) = (9.81, 0.5 * SIDE_M);
    let mut slab = object([-0.06, 0.0, -half], [0.06, 0.01, half], H_M, 2);
    slab.name = "slab".into();
    slab.fixed = vec![everywhere_below(1.01 * H_M)];
    let mut upper = object([-0.02, 0.01, -0.01], [0.02, 0.02, 0.01], H_M, 2);
    for object in [&mut slab, &mut upper] {
        object.material.young_modulus_pa = YOUNG_PA;
        object.material.rayleigh_beta_s = 1e-3;
        object.material.friction_coefficient = mu;
    }
    let region = ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0; 3] };
    upper.loads = vec![LoadDesc::BodyForce { region, force_n_per_m3: [pull * g * 1000.0, 0.0, 0.0] }];
    let mut scene = scene(vec![upper, slab]);
    scene.desc.gravity_m_per_s2 = [0.0, -g, 0.0];
    let mut world = world_of(&scene);
    run(&mut world, 50);
    let before = velocity_m_per_s(world.bodies()[0]).x;
    let booked = run(&mut world, 50);
    (before, (velocity_m_per_s(world.bodies()[0]).x - before) / (0.05 * g), booked)
}

#[test]
fn friction_holds_below_mu_n_and_slides_above() {
    for pull in [0.3, 0.45] {
        let (speed, gained, _) = drawn_along(pull, 0.5);
        assert!(speed < 1e-4 && gained.abs() < 1e-4, "held at {pull}: {speed} m/s, {gained} g");
    }
    for pull in [0.55, 0.8] {
        let (speed, gained, booked) = drawn_along(pull, 0.5);
        let share = booked.friction_j / booked.load_work_j;
        println!("{pull}: {speed:.3} m/s and gains {gained:.4} g; friction takes {share:.3} of the work");
        assert!((gained - (pull - 0.5)).abs() < 0.02 * pull, "{pull}: gains {gained} g");
        assert!(share > 0.5 && booked.residual_j < 1e-3 * booked.load_work_j, "{} J", booked.residual_j);
    }
    let (_, gained, booked) = drawn_along(0.3, 0.0);
    assert!((gained - 0.3).abs() < 1e-3 && booked.friction_j == 0.0, "without friction it gains {gained} g");
}

/// Largest penetration of the walls at parted links, m, from the crossings themselves.
fn penetration_m(body: &Body, links: &[LinkId], t: f32) -> f64 {
    let h = body.state.grid.voxel_size_m();
    let depth = |link: &LinkId| {
        let mut position_m = body.state.grid.centre_m(link.cell);
        position_m[link.axis as usize] += f64::from(t) * h;
        let [lower, upper] = [link.cell, link.upper()].map(|cell| {
            let voxel = body.state.grid.voxel_at(cell).expect("a parted link has two voxels");
            MaterialPoint { position_m, voxel }
        });
        let gradient = body.deformation_gradient(&lower);
        let normal = gradient.try_inverse().expect("a bed that is whole").transpose() * Vec3::y();
        (body.current_m(&lower) - body.current_m(&upper)).dot(&normal.normalize())
    };
    links.iter().map(depth).fold(f64::MIN, f64::max)
}

/// A flap of two voxels that hangs on at x = 45 mm, thrown open, its tip at 1 m/s; the links of the cut.
fn thrown_flap(level: u8, rate_hz: f64, t: f32) -> (World, Vec<LinkId>) {
    let mut desc = object([0.0, 0.0, 0.0], [0.06, 0.02, 0.03], H_M, level);
    desc.material.young_modulus_pa = YOUNG_PA;
    desc.material.rayleigh_beta_s = 1e-3;
    desc.fixed = vec![everywhere_below(1.01 * H_M)];
    let mut scene = scene(vec![desc]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    scene.desc.rate_hz = rate_hz;
    let mut world = world_of(&scene);
    let links = cut(&mut world, 5, t, |cell| cell[0] < 18);
    let body = world.body_mut(0);
    for n in 0..body.node_count() {
        let rest = body.rest_position_m(n);
        if rest.y > 0.0151 {
            body.state.velocity_m_per_s[n][1] = (1.0 - rest.x / 0.045).max(0.0);
        }
    }
    (world, links)
}

#[test]
fn a_flap_that_swings_back_stays_on_its_bed() {
    for (level, rate_hz) in [(1, 1000.0), (2, 1000.0), (2, 60.0)] {
        let t = 0.5;
        let (mut world, links) = thrown_flap(level, rate_hz, t);
        let (mut opened_m, mut deepest_m) = (0.0f64, f64::MIN);
        for _ in 0..(0.4 * rate_hz) as usize {
            run(&mut world, 1);
            deepest_m = deepest_m.max(penetration_m(world.bodies()[0], &links, t));
            opened_m = opened_m.max(-penetration_m(world.bodies()[0], &links[..1], t));
        }
        let rests_m = penetration_m(world.bodies()[0], &links[..1], t);
        println!(
            "level {level}, {rate_hz} Hz: opened {:.2} mm, at most {:.4} h deep, rests {:.4} h deep",
            1e3 * opened_m,
            deepest_m / H_M,
            rests_m / H_M
        );
        assert!(deepest_m < 0.1 * H_M, "{deepest_m} m deep");
        assert!(rests_m > -0.1 * H_M, "the flap hangs {} m above its bed", -rests_m);
        assert!(opened_m > 5e-3 || rate_hz < 100.0, "opened by {opened_m} m");
    }
}

/// A world that went back to a snapshot looks among all patches; otherwise that is done now and then.
#[test]
fn what_meets_does_not_depend_on_when_it_was_last_looked_for_among_all() {
    let [(mut now_and_then, _), (mut always, _)] = [(), ()].map(|()| thrown_flap(2, 1000.0, 0.5));
    let mut met = 0;
    for step in 0..400 {
        run(&mut now_and_then, 1);
        let snapshot = always.snapshot();
        always.restore(&snapshot);
        run(&mut always, 1);
        assert_eq!(now_and_then.state_hash(), always.state_hash(), "step {step}");
        met += always.tissue_springs().len();
    }
    assert!(met > 1000, "{met} springs");
}

#[test]
fn a_block_at_a_metre_per_second_does_not_pass_through_a_thin_sheet() {
    for (rate_hz, level) in [(1000.0, 0), (60.0, 0), (60.0, 1), (60.0, 2)] {
        let mut sheet = object([-0.04, 0.0, -0.02], [0.04, 0.005, 0.02], H_M, level);
        sheet.name = "sheet".into();
        sheet.material.young_modulus_pa = 1e6;
        let ends = |x: f64| ShapeDesc::Box { min_m: [x - 0.0051, -1.0, -1.0], max_m: [x + 0.0051, 1.0, 1.0] };
        sheet.fixed = vec![ends(-0.04), ends(0.04)];
        let mut falling = object([-0.01, 0.013, -0.01], [0.01, 0.033, 0.01], H_M, 2);
        falling.material.young_modulus_pa = YOUNG_PA;
        let mut scene = scene(vec![falling, sheet]);
        scene.desc.rate_hz = rate_hz;
        let mut world = world_beyond_limits(&scene);
        world.body_mut(0).state.velocity_m_per_s.iter_mut().for_each(|v| *v = [0.0, -1.0, 0.0]);
        let mut deepest = 0.0f64;
        for _ in 0..(0.1 * rate_hz) as usize {
            run(&mut world, 1);
            deepest = deepest.max(deepest_m(&world));
        }
        let lowest = |body: &Body| body.state.position_m.iter().map(|x| x[1]).fold(f64::MAX, f64::min);
        let feet = [0, 1].map(|body| lowest(world.bodies()[body]));
        let speed = velocity_m_per_s(world.bodies()[0]).y;
        println!("{rate_hz} Hz, level {level}: at {speed:.3} m/s, at most {:.4} h deep", deepest / H_M);
        assert!(speed > -0.05 && feet[0] > feet[1], "{rate_hz} Hz, level {level}: {speed} m/s at {feet:?}");
        assert!(deepest < 0.1 * H_M, "{deepest} m deep");
    }
}

#[test]
fn bodies_that_fail_together_are_rolled_back_alike_whatever_fails_in_them() {
    // A position that is no number, and one that is but leaves no energy that is.
    for position_m in [f64::NAN, 1e12] {
        let mut lower = block("lower", 0.0, 0.02, 2);
        lower.fixed = vec![everywhere_below(1.01 * H_M)];
        let mut scene = scene(vec![block("upper", 0.02, 0.02, 2), lower]);
        scene.desc.gravity_m_per_s2 = [0.0, -98.1, 0.0];
        let mut world = world_of(&scene);
        run(&mut world, 100);
        let carried_m = deepest_m(&world);
        [0, 1].into_iter().for_each(|index| world.body_mut(index).state.position_m[40][1] = position_m);
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::default());
        assert_eq!(output.fault.as_ref().map(|fault| fault.object.as_str()), Some("upper"), "{position_m}");
        assert!(output.energy.residual_j.abs() < 1e-12, "{position_m}: {:?}", output.energy);
        assert!(world.tissue_springs().is_empty(), "{position_m}");
        // They press on each other anew, no faster than surfaces come up: 1 voxel a second.
        run(&mut world, 1);
        let most_m = world.tissue_springs().iter().map(|spring| spring.gap_before_m).fold(0.0, f64::max);
        assert!(most_m <= 1.001e-3 * H_M && most_m < 0.5 * carried_m, "{position_m}: {most_m} m of {carried_m}");
    }
}

#[test]
fn one_and_two_threads_give_the_same_bits() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    let hashes = |workers: &Workers<'_>| {
        // 1,024 elements each: enough to be shared out.
        let mut lower = block("lower", 0.0, 0.02, 0);
        lower.fixed = vec![everywhere_below(1.01 * H_M)];
        let mut upper = block("upper", 0.02, 0.01, 0);
        upper.material.friction_coefficient = 0.4;
        lower.material.friction_coefficient = 0.4;
        let mut scene = scene(vec![upper, lower]);
        scene.desc.gravity_m_per_s2 = [3.0, -9.81, 0.0];
        let mut world = world_of(&scene);
        let step = |_| {
            world.step(workers, &NoClock, &StepInputs::default());
            assert!(!world.tissue_springs().is_empty());
            world.state_hash()
        };
        (0..10).map(step).collect::<Vec<_>>()
    };
    assert_eq!(hashes(&Workers::serial()), hashes(&Workers::of(&pool)));
}

/// Relative speed after two cubes have met over that before, at a rate.
fn restitution(rate_hz: f64) -> f64 {
    let speed_m_per_s = 0.1;
    let mut cubes = [-0.0405, 0.0005].map(|x| object([x, 0.0, 0.0], [x + 0.04, 0.04, 0.04], 5e-3, 1));
    for (cube, name) in cubes.iter_mut().zip(["left", "right"]) {
        cube.name = name.into();
        cube.material.young_modulus_pa = 1e5;
    }
    let mut scene = scene(cubes.to_vec());
    scene.desc.rate_hz = rate_hz;
    let mut world = world_of(&scene);
    for (index, way) in [1.0, -1.0].into_iter().enumerate() {
        world.body_mut(index).state.velocity_m_per_s.fill([way * speed_m_per_s, 0.0, 0.0]);
    }
    let momentum =
        |world: &World, index: usize| -> f64 { world.bodies()[index].nodal_momentum().iter().map(|p| p[0]).sum() };
    let before = momentum(&world, 0) - momentum(&world, 1);
    super::support::run(&mut world, (0.08 * rate_hz) as usize);
    (momentum(&world, 1) - momentum(&world, 0)) / before
}

#[test]
fn what_bounces_back_depends_on_the_step_as_the_method_says() {
    let found = [500.0, 2e3, 1e4].map(restitution);
    println!("restitution at 0.5, 2 and 10 kHz: {found:.2?}");
    let as_documented = |(found, told): (&f64, f64)| (found - told).abs() < 0.03;
    assert!(found.iter().zip([0.25, 0.55, 0.68]).all(as_documented), "{found:.2?}");
}
