//! Tissue against tissue: bodies, parts and flaps press on each other and do not pass through.
#![allow(unused_imports)]

mod support;

use kerf_physics::grid::{Crossing, LinkId};
use kerf_physics::scene::{Face, LoadDesc, ObjectDesc, Scene, ShapeDesc};
use kerf_physics::{NoClock, StepInputs, StepOutput, Vec3, Workers, World};
use support::{object, scene};

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

/// Steps without input; the sum of |residual| over the steps, J.
fn run(world: &mut World, steps: usize) -> f64 {
    let mut residual_j = 0.0;
    for _ in 0..steps {
        let output: &StepOutput = world.step(&Workers::serial(), &NoClock, &StepInputs::default());
        assert!(output.fault.is_none(), "{:?}", output.fault);
        residual_j += output.energy.residual_j.abs();
    }
    residual_j
}

/// Sum of the normal forces of springs whose point is in `body`, N: of both passes together.
fn force_n(world: &World) -> Vec3 {
    let on_first = |body: u32| if body == 0 { 1.0 } else { -1.0 };
    world.tissue_springs().iter().map(|s| s.normal * (s.force_n * on_first(s.ends[0].body))).sum()
}

fn deepest_m(world: &World) -> f64 {
    world.tissue_springs().iter().map(|s| s.depth_m).fold(0.0, f64::max)
}

fn momentum(world: &World) -> (Vec3, Vec3) {
    let (mut linear, mut angular) = (Vec3::zeros(), Vec3::zeros());
    for body in world.bodies() {
        for (p, x) in body.nodal_momentum().iter().zip(&body.position_m) {
            linear += Vec3::from(*p);
            angular += Vec3::from(*x).cross(&Vec3::from(*p));
        }
    }
    (linear, angular)
}

#[test]
fn a_block_rests_on_another_and_presses_with_its_weight() {
    let mut lower = block("lower", 0.0, 0.02, 2);
    lower.fixed = vec![everywhere_below(1.01 * H_M)];
    let upper = block("upper", 0.02, 0.02, 2);
    let mut scene = scene(vec![upper, lower]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    let mut world = World::new(&scene).unwrap();
    for i in 0..10 {
        let residual = run(&mut world, 50);
        let weight = 9.81 * world.bodies()[0].mass_kg();
        println!("{i}: force {:?} of {weight}, deepest {:.4} h, residual {residual:.1e}, solve {:?}, E {:?}", force_n(&world), deepest_m(&world) / H_M, world.output().solve, world.output().energy);
    }
}

#[test]
fn blocks_collide_and_keep_their_momentum() {
    let mut a = block("a", 0.0, 0.03, 2);
    a.material.rayleigh_beta_s = 0.0;
    let mut b = block("b", 0.032, 0.03, 2);
    b.material.rayleigh_beta_s = 0.0;
    let mut world = World::new(&scene(vec![a, b])).unwrap();
    world.body_mut(0).velocity_m_per_s.iter_mut().for_each(|v| *v = [0.0, 0.5, 0.0]);
    world.body_mut(1).velocity_m_per_s.iter_mut().for_each(|v| *v = [0.0, -0.5, 0.0]);
    for i in 0..30 {
        let residual = run(&mut world, 2);
        let (p, l) = momentum(&world);
        println!("{i}: p {p:?} L {l:?} force {:?}, deepest {:.4} h, residual {residual:.1e}, solve {:?} Ekin {:e} Eel {:e}", force_n(&world), deepest_m(&world) / H_M, world.output().solve, world.output().energy.kinetic_j, world.output().energy.elastic_j);
    }
}

/// Parts the links across the plane y = row + `t` for the columns that `keep` accepts.
fn cut(world: &mut World, row: i32, t: f32, keep: impl Fn([i32; 3]) -> bool) {
    let body = world.body_mut(0);
    let [nx, _, nz] = body.grid.dims();
    let cells = (0..nz).flat_map(|z| (0..nx).map(move |x| [x, row, z])).filter(|cell| keep(*cell));
    let crossing = Crossing { t, normal: [0.0, 1.0, 0.0] };
    let links: Vec<_> = cells.map(|cell| (LinkId { cell, axis: 1 }, crossing)).collect();
    let parted = body.part_links(&links).parted;
    assert_eq!(parted.len(), links.len());
    body.update_topology(&Workers::serial(), &parted);
}

/// A block of 40 x 60 x 40 mm that stands on its foot with a traction on its top.
fn pressed_block(traction_pa: f64, level: u8) -> Scene {
    let mut desc = block("block", 0.0, 0.06, level);
    desc.material.rayleigh_alpha_per_s = 60.0;
    desc.fixed = vec![everywhere_below(1.01 * H_M)];
    let region = ShapeDesc::Box { min_m: [-1.0, 0.0575, -1.0], max_m: [1.0; 3] };
    desc.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa: [0.0, traction_pa, 0.0] }];
    scene(vec![desc])
}

fn top_m(world: &World) -> f64 {
    let body = world.bodies()[0];
    let top: Vec<f64> = (0..body.node_count())
        .filter(|n| (body.rest_position_m(*n).y - 0.06).abs() < 1e-9)
        .map(|n| body.position_m[n][1] - 0.06)
        .collect();
    top.iter().sum::<f64>() / top.len() as f64
}

#[test]
fn a_closed_cut_carries_pressure_like_the_uncut_block_and_opens_under_tension() {
    for level in [1, 2] {
        for traction in [-2e3, 2e3] {
            let mut whole = World::new(&pressed_block(traction, level)).unwrap();
            run(&mut whole, 400);
            for (row, t) in [(11, 0.5), (12, 0.4)] {
                for depth in [8, 16] {
                    let mut world = World::new(&pressed_block(traction, level)).unwrap();
                    cut(&mut world, row, t, |cell| cell[0] < depth);
                    let residual = run(&mut world, if traction > 0.0 && depth == 16 { 20 } else { 400 });
                    println!(
                        "level {level} {traction} row {row} depth {depth}: top {:.5} of {:.5} mm, force {:?}, deepest {:.4} h, residual {residual:.1e} of {:.1e}, springs {}, {:?}",
                        top_m(&world) * 1e3, top_m(&whole) * 1e3, force_n(&world).y, deepest_m(&world) / H_M, world.output().energy.elastic_j, world.tissue_springs().len(), world.output().solve,
                    );
                }
            }
        }
    }
}

#[test]
fn two_blocks_of_different_meshes_pressed_together_yield_like_one() {
    let traction_pa = -2e3;
    for level in [1, 2] {
        let mut lower = block("lower", 0.0, 0.03, level);
        lower.fixed = vec![everywhere_below(1.01 * H_M)];
        let half = 0.5 * SIDE_M;
        let mut upper = object([-half, 0.03, -half], [half, 0.06, half], 0.002, level);
        upper.name = "upper".into();
        upper.material = lower.material.clone();
        let region = ShapeDesc::Box { min_m: [-1.0, 0.058, -1.0], max_m: [1.0; 3] };
        upper.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa: [0.0, traction_pa, 0.0] }];
        for object in [&mut lower, &mut upper] {
            object.material.poisson_ratio = 0.0;
            object.material.rayleigh_alpha_per_s = 60.0;
        }
        let mut world = World::new(&scene(vec![upper, lower])).unwrap();
        run(&mut world, 400);
        // Held in the middle of the lowest layer of voxels.
        let expected_m = traction_pa / YOUNG_PA * (0.06 - 0.5 * H_M);
        let body = world.bodies()[0];
        let top: Vec<f64> = (0..body.node_count())
            .filter(|n| (body.rest_position_m(*n).y - 0.06).abs() < 1e-9)
            .map(|n| (body.position_m[n][1] - 0.06) / expected_m)
            .collect();
        let (low, high) = top.iter().fold((f64::MAX, f64::MIN), |(low, high), d| (low.min(*d), high.max(*d)));
        println!("level {level}: top {low:.4} to {high:.4} of {:.3} mm, force {:?} of {}, {:?}", 1e3 * expected_m, force_n(&world), traction_pa * SIDE_M * SIDE_M, world.output().solve);
    }
}

#[test]
fn friction_holds_below_mu_n_and_slides_above() {
    let (g, mu) = (9.81, 0.5);
    for pull in [0.3, 0.45, 0.55, 0.8] {
        let half = 0.5 * SIDE_M;
        let mut lower = object([-0.06, 0.0, -half], [0.06, 0.01, half], H_M, 2);
        lower.name = "lower".into();
        lower.fixed = vec![everywhere_below(1.01 * H_M)];
        let mut upper = object([-0.02, 0.01, -0.01], [0.02, 0.02, 0.01], H_M, 2);
        upper.name = "upper".into();
        for object in [&mut lower, &mut upper] {
            object.material.young_modulus_pa = YOUNG_PA;
            object.material.rayleigh_beta_s = 1e-3;
            object.material.friction_coefficient = mu;
        }
        let region = ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0; 3] };
        upper.loads = vec![LoadDesc::BodyForce { region, force_n_per_m3: [pull * g * 1000.0, 0.0, 0.0] }];
        let mut scene = scene(vec![upper, lower]);
        scene.desc.gravity_m_per_s2 = [0.0, -g, 0.0];
        let mut world = World::new(&scene).unwrap();
        run(&mut world, 50);
        let speed = |world: &World| momentum(world).0.x / world.bodies()[0].mass_kg();
        let before = speed(&world);
        let (mut friction_j, mut residual_j, mut work_j) = (0.0, 0.0, 0.0);
        for _ in 0..50 {
            residual_j += run(&mut world, 1);
            friction_j += world.output().energy.friction_j;
            work_j += world.output().energy.load_work_j;
        }
        let gained = (speed(&world) - before) / (0.05 * g);
        println!("pull {pull}: speed {:.3e}, gained {gained:.4} g, friction {friction_j:.3e} of {work_j:.3e} J, residual {residual_j:.1e}, {:?}", speed(&world), world.output().solve);
    }
}

/// Largest penetration of the walls of a cut, m, from the crossings themselves.
fn penetration_m(world: &World, links: &[LinkId], t: f32) -> f64 {
    use kerf_physics::body::MaterialPoint;
    let body = world.bodies()[0];
    let h = body.grid.voxel_size_m();
    links
        .iter()
        .map(|link| {
            let mut position_m = body.grid.centre_m(link.cell);
            position_m[link.axis as usize] += f64::from(t) * h;
            let at = |cell| {
                let voxel = body.grid.voxel_at(cell).expect("a parted link has two voxels");
                body.current_m(&MaterialPoint { position_m, voxel })
            };
            let point = MaterialPoint { position_m, voxel: body.grid.voxel_at(link.cell).unwrap() };
            let normal = body.deformation_gradient(&point).try_inverse().unwrap().transpose() * Vec3::y();
            -(at(link.upper()) - at(link.cell)).dot(&normal.normalize())
        })
        .fold(f64::MIN, f64::max)
}

#[test]
fn a_flap_that_swings_back_stays_on_its_bed() {
    for (level, rate_hz) in [(1, 1000.0), (2, 1000.0), (2, 60.0)] {
        let mut desc = object([0.0, 0.0, 0.0], [0.06, 0.02, 0.03], H_M, level);
        desc.material.young_modulus_pa = YOUNG_PA;
        desc.material.rayleigh_beta_s = 1e-3;
        desc.fixed = vec![everywhere_below(1.01 * H_M)];
        let mut scene = scene(vec![desc]);
        scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
        scene.desc.rate_hz = rate_hz;
        let mut world = World::new(&scene).unwrap();
        // A flap of two voxels that hangs on at x = 60 mm.
        let (row, t, long) = (5, 0.5, 18);
        cut(&mut world, row, t, |cell| cell[0] < long);
        let links: Vec<_> =
            (0..12).flat_map(|z| (0..long).map(move |x| LinkId { cell: [x, row, z], axis: 1 })).collect();
        // It is thrown open, its tip at 1 m/s.
        let body = world.body_mut(0);
        for n in 0..body.node_count() {
            let rest = body.rest_position_m(n);
            // Of two nodes at one place the later one is the flap's, if it is carried by the flap.
            if rest.y > 0.0151 {
                body.velocity_m_per_s[n][1] = 1.0 * (1.0 - rest.x / 0.045).max(0.0);
            }
        }
        let (mut opened, mut deepest, mut residual_j) = (0.0f64, f64::MIN, 0.0);
        for _ in 0..(0.6 * rate_hz) as usize {
            residual_j += run(&mut world, 1);
            let now = penetration_m(&world, &links, t);
            deepest = deepest.max(now);
            opened = opened.max(-penetration_m(&world, &links[..1], t));
        }
        println!("level {level} {rate_hz}: opened {:.2} mm, deepest {:.4} h, at rest {:.4} h, residual {residual_j:.1e}, E {:?}", 1e3 * opened, deepest / H_M, penetration_m(&world, &links, t) / H_M, world.output().energy.elastic_j);
    }
}

#[test]
fn a_block_at_one_metre_per_second_does_not_pass_through_a_thin_sheet() {
    for (rate_hz, level) in [(1000.0, 0), (60.0, 0), (60.0, 1), (60.0, 2)] {
        let mut sheet = object([-0.04, 0.0, -0.02], [0.04, 0.005, 0.02], H_M, level);
        sheet.name = "sheet".into();
        sheet.material.young_modulus_pa = 1e6;
        sheet.material.rayleigh_beta_s = 1e-3;
        let ends = |x: f64| ShapeDesc::Box { min_m: [x - 0.0051, -1.0, -1.0], max_m: [x + 0.0051, 1.0, 1.0] };
        sheet.fixed = vec![ends(-0.04), ends(0.04)];
        let mut falling = object([-0.01, 0.013, -0.01], [0.01, 0.033, 0.01], H_M, 2);
        falling.name = "block".into();
        falling.material.young_modulus_pa = YOUNG_PA;
        falling.material.rayleigh_beta_s = 1e-3;
        let mut scene = scene(vec![falling, sheet]);
        scene.desc.rate_hz = rate_hz;
        let mut world = World::new(&scene).unwrap();
        world.body_mut(0).velocity_m_per_s.iter_mut().for_each(|v| *v = [0.0, -1.0, 0.0]);
        let (mut deepest, mut residual_j) = (0.0f64, 0.0);
        let mean = |world: &World, i: usize| {
            let body = world.bodies()[i];
            body.position_m.iter().map(|x| x[1]).sum::<f64>() / body.node_count() as f64
        };
        let mut lowest = f64::MAX;
        for _ in 0..(0.2 * rate_hz) as usize {
            residual_j += run(&mut world, 1);
            deepest = deepest.max(deepest_m(&world));
            lowest = lowest.min(mean(&world, 0));
        }
        println!("{rate_hz} Hz level {level}: block ends at {:.4} m, lowest {lowest:.4}, deepest {:.3} h, residual {residual_j:.1e}, v {:?}", mean(&world, 0), deepest / H_M, world.bodies()[0].velocity_m_per_s[0]);
    }
}
