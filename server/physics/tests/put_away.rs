//! What falls out of the scene's reach is put away.

use super::rollback::is_upper;
use super::support::{object, scene, world_of};
use kerf_physics::scene::ShapeDesc;
use kerf_physics::{Crossing, LinkId, NoClock, StepInputs, Vec3, Workers, World};

const RATE_HZ: f64 = 250.0;
const GRAVITY_M_PER_S2: f64 = 9.81;
/// What a scene reaches beyond its objects, in diagonals of the box around them.
const REACH_DIAGONALS: f64 = 10.0;

/// A bar that is held at one end and has just been cut through its middle.
fn cut_bar() -> World {
    let mut bar = object([0.0; 3], [0.08, 0.02, 0.02], 0.005, 1);
    bar.material.rayleigh_alpha_per_s = 5.0;
    bar.material.rayleigh_beta_s = 2e-3;
    bar.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [0.011, 1.0, 1.0] }];
    let mut scene = scene(vec![bar]);
    scene.desc.rate_hz = RATE_HZ;
    scene.desc.solver.relative_tolerance = Some(1e-3);
    scene.desc.gravity_m_per_s2 = [0.0, -GRAVITY_M_PER_S2, 0.0];
    let mut world = world_of(&scene);
    let crossing = Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] };
    let cells = (0..4).flat_map(|y| (0..4).map(move |z| [7, y, z]));
    let links: Vec<_> = cells.map(|cell| (LinkId { cell, axis: 0 }, crossing)).collect();
    let body = world.body_mut(0);
    let parted = body.part_links(&links).parted;
    body.update_topology(&Workers::serial(), &parted);
    world
}

/// Where the middle of the piece is that was cut off, from where it was built, m.
fn fallen_m(world: &World) -> Vec3 {
    let body = world.bodies()[0];
    let nodes: Vec<usize> = (0..body.node_count()).filter(|node| is_upper(body, *node)).collect();
    let moved = nodes.iter().map(|n| Vec3::from(body.state.position_m[*n]) - body.rest_position_m(*n));
    moved.sum::<Vec3>() / nodes.len() as f64
}

#[test]
fn what_falls_out_of_reach_is_put_away_and_the_body_sleeps() {
    let mut world = cut_bar();
    let reach_m = REACH_DIAGONALS * (0.08f64.powi(2) + 2.0 * 0.02f64.powi(2)).sqrt();
    let mut steps = 0;
    let (mut worked_j, mut residual_j) = (0.0, 0.0);
    loop {
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::default());
        steps += 1;
        worked_j += output.energy.load_work_j.abs();
        residual_j += output.energy.residual_j.abs();
        if output.put_away > 0 {
            assert_eq!((output.put_away, output.energy.kinetic_j < 1e-3 * worked_j), (1, true));
            break;
        }
        assert!(steps < 1000, "it is {:?} away", fallen_m(&world));
    }
    // Free fall, a node's height more or less; alpha takes a part of the speed: 5/s over 0.4 s.
    let away_m = -fallen_m(&world).y;
    assert!((reach_m..1.1 * reach_m).contains(&away_m), "put away {away_m} m below, not {reach_m}");
    assert!(residual_j < 1e-2 * worked_j, "{residual_j} J of {worked_j} J");
    while !world.is_asleep(0) {
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::default());
        steps += 1;
        assert!(output.put_away == 0 && steps < 2000, "kinetic energy {} J", output.energy.kinetic_j);
    }
    assert!((fallen_m(&world).y + away_m).abs() < 1e-6, "it has fallen on");
}
