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
