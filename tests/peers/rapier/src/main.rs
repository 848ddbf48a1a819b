//! Steps a soft block in Rapier, its finite element solver first, and prints a line of JSON a run.

use rapier3d::prelude::*;
use std::time::Instant;

const NODES: usize = 10;
const SIDE_M: f32 = 0.09;

const YOUNG_MODULUS_PA: f32 = 1.5e6;
/// What is simulated, s.
const DURATION_S: f32 = 0.5;

fn run(solver: SoftBodySolver, rate_hz: f32, substeps: usize) {
    let half = SIDE_M / 2.0;
    let material = SoftBodyMaterial {
        young_modulus: YOUNG_MODULUS_PA,
        poisson_ratio: 0.4,
        elastic_damping_ratio: 0.0,
        ..SoftBodyMaterial::default()
    };
    let block = SoftBodyBuilder::cuboid(Vector::new(half, half, half), Vector::new(half, half, half), NODES, NODES, NODES)
        .mass(1000.0 * SIDE_M * SIDE_M * SIDE_M)
        .cell_model(SoftBodyCellModel::Corotational)
        .solver(solver)
        .material(material)
        .no_surface_collider()
        .self_contacts(false)
        .can_sleep(false);
    let at = |keep: fn(f32) -> bool| -> Vec<u32> {
        let kept = block.particle_positions().iter().enumerate().filter(|(_, p)| keep(p.y));
        kept.map(|(index, _)| index as u32).collect()
    };
    let (foot, top) = (at(|y| y < 1e-4), at(|y| y > SIDE_M - 1e-4));
    let mut world = PhysicsWorld::new();
    world.gravity = Vector::new(0.0, -9.81, 0.0);
    world.integration_parameters.dt = 1.0 / rate_hz;
    world.integration_parameters.soft_bodies.fem.linear_tolerance = 1e-3;
    world.integration_parameters.soft_bodies.fem.max_linear_iterations = 1000;
    world.integration_parameters.num_solver_iterations = substeps;
    let handle = world.insert_soft_body(block.pinned_particles(foot));
    let mut times_ms: Vec<f64> = Vec::new();
    for _ in 0..(DURATION_S * rate_hz) as usize {
        let start = Instant::now();
        world.step();
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times_ms.sort_by(f64::total_cmp);
    let body = &world.soft_bodies[handle];
    let sag_m = top.iter().map(|&p| SIDE_M - body.particle_position(p as usize).y).sum::<f32>() / top.len() as f32;
    println!(
        "{{\"peer\": \"Rapier 0.36.1, {solver:?}, substeps: {substeps}\", \"rate_hz\": {rate_hz}, \"elements\": {}, \
         \"step_ms\": {:.4}, \"sag_m\": {sag_m:e}}}",
        body.cells().len(),
        times_ms[times_ms.len() / 2],
    );
}

fn main() {
    for rate_hz in [1000.0, 60.0] {
        // The finite elements are implicit; the constraints converge by substeps, of which 4 are Rapier's default.
        run(SoftBodySolver::Fem, rate_hz, 1);
        run(SoftBodySolver::Constraints, rate_hz, 4);
    }
}
