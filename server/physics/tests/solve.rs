//! The velocity solve, and what is told of it.

use super::support::{object, scene, world_of};
use kerf_physics::scene::ShapeDesc;
use kerf_physics::step_io::SolveReport;
use kerf_physics::{NoClock, StepInputs, Workers};

/// The first step of a held block under gravity.
fn first_solve(max_iterations: u32) -> SolveReport {
    let mut block = object([0.0; 3], [0.06, 0.04, 0.04], 0.005, 1);
    block.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 0.006, 1.0] }];
    let mut scene = scene(vec![block]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    scene.desc.solver.max_iterations = max_iterations;
    let mut world = world_of(&scene);
    world.step(&Workers::serial(), &NoClock, &StepInputs::default()).solve
}

#[test]
fn a_solve_that_falls_short_is_taken_up_again_and_told() {
    let enough = first_solve(500);
    assert!(!enough.is_unconverged && enough.retries == 0 && enough.relative_residual <= 1e-6, "{enough:?}");
    let short = first_solve(enough.iterations / 4);
    assert!(short.is_unconverged && short.relative_residual > 1e-6, "{short:?}");
    assert_eq!((short.retries, short.solves), (1, 2));
    // Together they have as many as it takes.
    let just = first_solve(enough.iterations - 2);
    assert!(!just.is_unconverged && just.retries == 1, "{just:?}");
}
