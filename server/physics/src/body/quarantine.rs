//! The last finite state of a body, and the way back to it.

use super::{Body, Nodal};
use crate::workers::Workers;
use wide::f64x4;

/// Copy of what a step changes.
#[derive(Default)]
pub(super) struct FiniteState {
    position_m: Nodal,
    velocity_m_per_s: Nodal,
    rotation: Vec<[f64x4; 4]>,
}

impl Body {
    /// Whether every node's position and velocity is a number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let finite = |values: &[[f64; 3]]| values.iter().flatten().all(|x| x.is_finite());
        finite(&self.position_m) && finite(&self.velocity_m_per_s)
    }

    /// Remembers the evaluated state if its forces are finite too: a position that is finite but
    /// absurd overflows in them first. Returns whether they were.
    pub fn save_finite_state(&mut self) -> bool {
        let energy: f64 = self.chunks.iter().map(|c| c.energies.elastic_j.reduce_add()).sum();
        // An energy that `f32` cannot hold is beyond what the solver can take a step from.
        let finite = energy.is_finite() && energy < f64::from(f32::MAX) && self.is_finite();
        if finite {
            self.saved.position_m.clone_from(&self.position_m);
            self.saved.velocity_m_per_s.clone_from(&self.velocity_m_per_s);
            self.saved.rotation.clear();
            self.saved.rotation.extend(self.states.iter().map(|s| s.rotation));
        }
        finite
    }

    /// Goes back to the remembered state at rest; topology is kept.
    pub fn restore_finite_state(&mut self, workers: &Workers<'_>) {
        self.position_m.clone_from(&self.saved.position_m);
        self.velocity_m_per_s.iter_mut().for_each(|v| *v = [0.0; 3]);
        for (state, rotation) in self.states.iter_mut().zip(&self.saved.rotation) {
            state.rotation = *rotation;
        }
        self.evaluate(workers, 2);
    }
}
