//! What verification needs of the inside of a world, and nothing else may use.

pub use crate::body::{BodyEnergy, State};
pub use crate::grid::levels::{Element, Level};
pub use crate::math::Nodal;
pub use crate::params::StepParams;
pub use crate::validate::unjudged;

use crate::body::Body;
use crate::grid::{Crossing, LinkId};
use crate::math::Mat3;
use crate::scene::{Scene, SceneError};
use crate::workers::Workers;
use crate::world::World;

/// The first object of a scene at rest, without a world.
///
/// # Errors
/// What is wrong with the object's shape.
pub fn body(scene: &Scene, params: StepParams) -> Result<Body, SceneError> {
    Body::new(scene, 0, params, &Workers::serial())
}

/// A body of a world, to start from a state that is not at rest.
pub fn body_mut(world: &mut World, index: usize) -> &mut Body {
    world.body_mut(index)
}

/// Sets a factor on the stiffness of every blade contact that is a penalty, of the springs that hold the tissue beside
/// an edge and of those between flanks and walls, so as to tell what of a cut depends on it. The spring ahead of an
/// edge is not one of them: it is the compliance of the continuum between an element and the edge's half-width. No
/// scene has this.
pub fn scale_blade_penalties(world: &mut World, factor: f64) {
    world.scale_blade_penalties(factor);
}

/// The elements of a body.
#[must_use]
pub fn base(body: &Body) -> &Level {
    body.base()
}

/// Where the nodes of a body are and how fast.
#[must_use]
pub fn state(body: &Body) -> &State {
    &body.state
}

/// The same, to be set; [`evaluate`] takes it.
pub fn state_mut(body: &mut Body) -> &mut State {
    &mut body.state
}

/// Rotations, forces and energies of every element at the state as it is.
pub fn evaluate(body: &mut Body, rotation_iterations: u32) {
    body.evaluate(&Workers::serial(), rotation_iterations);
}

/// Brings the matrices to the evaluated state.
pub fn refresh_operator(body: &mut Body) {
    body.refresh_operator(&Workers::serial());
}

/// How far a solve at the state as it is would move the nodes, m.
pub fn correction_m(body: &mut Body) -> Nodal {
    let workers = Workers::serial();
    body.evaluate(&workers, 20);
    body.refresh_operator(&workers);
    body.assemble_right_side(&workers);
    let mut change = vec![[0.0; 3]; body.node_count()];
    body.solve_velocity_change(&workers, &[], 0.0, &mut change);
    // Free bodies do not drift by what the solve leaves.
    if body.sum_missing_momentum(std::iter::empty(), &change) {
        body.add_missing_motion(&mut change);
    }
    let dt_s = body.dt_s();
    change.iter_mut().flatten().for_each(|v| *v *= dt_s);
    change
}

/// Parts links, but for those that would set free too small a piece. Returns how many it parts.
pub fn part(body: &mut Body, links: &[(LinkId, Crossing)]) -> usize {
    let parted = body.part_links(links).parted;
    body.update_topology(&Workers::serial(), &parted);
    parted.len()
}

/// Elastic force on each node as last evaluated, N; hanging nodes hand theirs to their masters.
#[must_use]
pub fn elastic_forces_n(body: &Body) -> Nodal {
    body.elastic_forces_n()
}

/// What the nodes carry under a constant stress, N: the reference of the patch test.
#[must_use]
pub fn constant_stress_forces_n(body: &Body, stress_pa: &Mat3) -> Nodal {
    body.constant_stress_forces_n(stress_pa)
}

/// Momentum of each node's part of the mass, N s.
#[must_use]
pub fn nodal_momentum(body: &Body) -> Nodal {
    body.nodal_momentum()
}

/// Energies as last evaluated.
#[must_use]
pub fn energy(body: &Body) -> BodyEnergy {
    body.energy()
}

/// Work of the loads, gravity included, over displacements of the nodes, J.
#[must_use]
pub fn external_work_j(body: &Body, displacement_m: impl Iterator<Item = [f64; 3]>) -> f64 {
    body.external_work_j(displacement_m)
}
