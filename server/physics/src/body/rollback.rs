//! The last finite state of a body, and the way back to it.

use super::{Body, Nodal};
use crate::Vec3;
use crate::fem::viscosity::BranchState;
use crate::grid::VoxelId;
use crate::solve::vectors::NODE_GRAIN;
use crate::workers::Workers;
use wide::f64x4;

/// Elastic energy over Young's modulus times volume beyond which a state counts as lost: a strain of
/// ten thousand. No start that anyone means is there, and no step leads back from it. How
/// sensitive that is has not been measured.
const MOST_ENERGY_OF_EV: f64 = 1e9;

/// Copy of what a step changes.
#[derive(Clone, Default)]
pub(super) struct FiniteState {
    position_m: Nodal,
    rotation: Vec<[f64x4; 4]>,
    /// Empty where nothing relaxes.
    branch: Vec<Option<Box<BranchState>>>,
    /// Times that a state was remembered since the body last went back to one.
    saves: u32,
    /// Young's modulus times volume, J; parting links changes neither.
    stiff_j: f64,
}

impl Body {
    /// Whether every node's position and velocity is a number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let finite = |values: &[[f64; 3]]| values.iter().flatten().all(|x| x.is_finite());
        finite(&self.state.position_m) && finite(&self.state.velocity_m_per_s)
    }

    /// Remembers the evaluated state if its forces are finite too: a position that is finite but
    /// absurd overflows in them first. Returns whether they were.
    pub(crate) fn save_finite_state(&mut self, workers: &Workers<'_>) -> bool {
        let energy: f64 = self.state.chunks.iter().map(|c| c.found.elastic_j.reduce_add()).sum();
        if self.state.saved.stiff_j == 0.0 {
            self.state.saved.stiff_j = self.sum_stiff_j();
        }
        let finite = energy.is_finite() && energy < MOST_ENERGY_OF_EV * self.stiff_j() && self.is_finite();
        if finite {
            let is_viscous = self.is_viscous();
            let FiniteState { position_m, rotation, branch, saves, .. } = &mut self.state.saved;
            *saves = saves.saturating_add(1);
            position_m.resize(self.state.position_m.len(), [0.0; 3]);
            rotation.resize(self.state.elements.len(), [f64x4::ZERO; 4]);
            workers.for_chunks((&mut position_m[..], &self.state.position_m[..]), NODE_GRAIN, |_, (saved, x)| {
                saved.copy_from_slice(x);
            });
            workers.for_chunks((&mut rotation[..], &self.state.elements[..]), NODE_GRAIN, |_, (saved, states)| {
                saved.iter_mut().zip(states).for_each(|(saved, state)| *saved = state.rotation);
            });
            if is_viscous {
                branch.resize_with(self.state.elements.len(), || None);
                workers.for_chunks((&mut branch[..], &self.state.elements[..]), NODE_GRAIN, |_, (saved, states)| {
                    saved.iter_mut().zip(states).for_each(|(saved, state)| saved.clone_from(&state.branch));
                });
            }
        }
        finite
    }

    /// Goes back to the remembered state at rest; topology is kept. Where that state is so bad that
    /// hardly a step was possible from it, every piece goes back to its rest shape: otherwise it would
    /// be rolled back for ever.
    pub(crate) fn restore_finite_state(&mut self, workers: &Workers<'_>) {
        self.state.position_m.clone_from(&self.state.saved.position_m);
        self.state.velocity_m_per_s.iter_mut().for_each(|v| *v = [0.0; 3]);
        self.state.rigid.forget_turns();
        for (state, rotation) in self.state.elements.iter_mut().zip(&self.state.saved.rotation) {
            state.rotation = *rotation;
        }
        for (state, branch) in self.state.elements.iter_mut().zip(&self.state.saved.branch) {
            state.branch.clone_from(branch);
        }
        if self.state.saved.saves <= 1 {
            self.return_to_rest_shape();
        }
        self.state.saved.saves = 0;
        self.evaluate(workers, 20);
    }

    /// Every piece in its rest shape, relaxed: where it was built if it is held there, else about its middle.
    fn return_to_rest_shape(&mut self) {
        let mut shift: Vec<(Vec3, f64)> = vec![(Vec3::zeros(), 0.0); self.part_count() as usize];
        for (node, x) in self.state.position_m.iter().enumerate() {
            if let Some(sum) = self.state.rigid.loose_part(node).and_then(|part| shift.get_mut(part)) {
                *sum = (sum.0 + Vec3::from(*x) - self.rest_position_m(node), sum.1 + 1.0);
            }
        }
        for node in 0..self.node_count() {
            let moved = self.state.rigid.loose_part(node).map_or(Vec3::zeros(), |part| shift[part].0 / shift[part].1);
            self.state.position_m[node] = (self.rest_position_m(node) + moved).into();
        }
        let [zero, one] = [f64x4::ZERO, f64x4::ONE];
        self.state.elements.iter_mut().for_each(|state| state.rotation = [zero, zero, zero, one]);
        self.state
            .elements
            .iter_mut()
            .filter_map(|state| state.branch.as_mut())
            .for_each(|branch| **branch = Default::default());
    }

    /// Young's modulus times volume, J.
    pub(super) fn stiff_j(&self) -> f64 {
        self.state.saved.stiff_j
    }

    fn sum_stiff_j(&self) -> f64 {
        let voxels = (0..self.state.grid.voxels().len() as u32).map(VoxelId);
        self.state.grid.voxel_size_m().powi(3) * voxels.map(|v| self.material_of(v).young_modulus_pa).sum::<f64>()
    }
}
