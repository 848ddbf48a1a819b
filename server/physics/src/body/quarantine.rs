//! The last finite state of a body, and the way back to it.

use super::{Body, Nodal};
use crate::solve::operator::NODES_PER_CHUNK;
use crate::workers::Workers;
use wide::f64x4;

/// Copy of what a step changes.
#[derive(Default)]
pub(super) struct FiniteState {
    position_m: Nodal,
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
    pub fn save_finite_state(&mut self, workers: &Workers<'_>) -> bool {
        let energy: f64 = self.chunks.iter().map(|c| c.found.elastic_j.reduce_add()).sum();
        // An energy that `f32` cannot hold is beyond what the solver can take a step from.
        let finite = energy.is_finite() && energy < f64::from(f32::MAX) && self.is_finite();
        if finite {
            let FiniteState { position_m, rotation } = &mut self.saved;
            position_m.resize(self.position_m.len(), [0.0; 3]);
            rotation.resize(self.states.len(), [f64x4::ZERO; 4]);
            workers.for_chunks((&mut position_m[..], &self.position_m[..]), NODES_PER_CHUNK, |_, (saved, x)| {
                saved.copy_from_slice(x);
            });
            workers.for_chunks((&mut rotation[..], &self.states[..]), NODES_PER_CHUNK, |_, (saved, states)| {
                saved.iter_mut().zip(states).for_each(|(saved, state)| *saved = state.rotation);
            });
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
