//! Pieces of a body that a step has lost, and the way back to where they were.

use super::{Body, Nodal};
use crate::Vec3;
use crate::fault::FaultKind;
use crate::fem::block::LANES;
use crate::fem::viscosity::BranchState;
use crate::grid::levels::NONE;
use crate::grow::grow;
use crate::solve::vectors::NODE_GRAIN;
use crate::workers::Workers;
use serde::{Deserialize, Serialize};
use wide::f64x4;

/// Elastic energy of a piece over its Young's modulus times volume beyond which it counts as lost: a strain of
/// ten thousand. No start that anyone means is there, and no step leads back from it. How
/// sensitive that is has not been measured.
const MOST_ENERGY_OF_EV: f64 = 1e9;
/// A piece counts as lost, too, if a step leaves it this many times the energy that there was in all of the scene and
/// that tools and loads did work for. Ours: a step of implicit Euler loses energy, but for what linearising its forces
/// makes, which in random starts has not come to the double.
const MOST_ENERGY_OF_ALL: f64 = 10.0;
/// But not below this fraction of its Young's modulus times volume, J: contacts that come on deep, of a tool that is
/// put down in the tissue, bring energy that no tool did work for.
const LEAST_ENERGY_OF_EV: f64 = 1.0;
/// A piece that is lost again within so many steps goes back to its rest shape: from where it stood hardly a step was
/// possible, and it would be rolled back for ever.
const RELAPSE_STEPS: u32 = 2;

/// Copy of what a step changes.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct SavedState {
    pub(super) position_m: Nodal,
    rotation: Vec<[f64x4; 4]>,
    /// Empty where nothing relaxes.
    branch: Vec<Option<Box<BranchState>>>,
}

/// Pieces that a step has lost.
pub(crate) struct Lost {
    /// Whether each part is.
    parts: Vec<bool>,
    /// What gave it away.
    pub(crate) what: FaultKind,
}

impl Body {
    /// Whether every node's position and velocity is a number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let finite = |values: &[[f64; 3]]| values.iter().flatten().all(|x| x.is_finite());
        finite(&self.state.position_m) && finite(&self.state.velocity_m_per_s)
    }

    /// The pieces whose evaluated state is lost, where `available_j` is what there was of energy in the scene and what
    /// was worked in the step. A position that is finite but absurd shows in energies that are not.
    pub(crate) fn find_lost(&self, available_j: f64) -> Option<Lost> {
        let (all, least_j) = (self.energy(), self.state.rigid.least_stiff_j());
        let is_allowed =
            all.total_j() <= MOST_ENERGY_OF_ALL * available_j || all.total_j() <= LEAST_ENERGY_OF_EV * least_j;
        let is_finite = all.total_j().is_finite() && self.is_finite();
        if is_finite && is_allowed && all.elastic_j < MOST_ENERGY_OF_EV * least_j {
            return None;
        }
        let (elastic_j, kinetic_j) = (self.elastic_by_part_j(), self.kinetic_by_part_j());
        let mut what = FaultKind::Energy;
        let is_lost = |(part, stiff_j): (usize, &f64)| {
            let total_j = elastic_j[part] + kinetic_j[part];
            let from_nothing = total_j > MOST_ENERGY_OF_ALL * available_j && total_j > LEAST_ENERGY_OF_EV * stiff_j;
            if !total_j.is_finite() {
                what = FaultKind::NodeState;
            }
            from_nothing || !total_j.is_finite() || elastic_j[part] >= MOST_ENERGY_OF_EV * stiff_j
        };
        let mut parts: Vec<bool> = self.state.rigid.stiff_j.iter().enumerate().map(is_lost).collect();
        if !parts.contains(&true) && !all.total_j().is_finite() {
            // It is in no part, but in the room between them.
            parts.fill(true);
            what = FaultKind::NodeState;
        }
        parts.contains(&true).then_some(Lost { parts, what })
    }

    /// Whether a step has lost the part that a node belongs to.
    pub(crate) fn is_lost_at(&self, lost: &Lost, node: u32) -> bool {
        lost.parts.get(self.part_of_node(node) as usize).is_some_and(|lost| *lost)
    }

    fn elastic_by_part_j(&self) -> Vec<f64> {
        let mut by_part_j = vec![0.0; self.part_count() as usize];
        for element in 0..self.base().elements.len() {
            by_part_j[self.part_of_element(element) as usize] += self.elastic_energy_j(element);
        }
        by_part_j
    }

    fn kinetic_by_part_j(&self) -> Vec<f64> {
        let mut by_part_j = vec![0.0; self.part_count() as usize];
        for (element, data) in self.base().elements.iter().enumerate() {
            let at = |a: usize, of: &Nodal| Vec3::from(of[data.nodes[a] as usize]);
            let sum = &mut by_part_j[self.part_of_element(element) as usize];
            for a in 0..8 {
                let momentum: Vec3 =
                    (0..8).map(|b| at(b, &self.state.velocity_m_per_s) * self.mass_between_kg(element, a, b)).sum();
                *sum += 0.5 * momentum.dot(&at(a, &self.state.velocity_m_per_s));
            }
        }
        by_part_j
    }

    /// Remembers the evaluated state to go back to.
    pub(crate) fn save_state(&mut self, workers: &Workers<'_>) {
        let is_viscous = self.is_viscous();
        let SavedState { position_m, rotation, branch } = &mut self.state.saved;
        grow(position_m, self.state.position_m.len(), [0.0; 3]);
        grow(rotation, self.state.elements.len(), [f64x4::ZERO; 4]);
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
        self.state.rigid.steady_steps.iter_mut().for_each(|steps| *steps = steps.saturating_add(1));
    }

    /// Takes the pieces that are lost back to the remembered state, at rest, each by itself; topology is kept. One that
    /// was lost a moment ago goes back to its rest shape.
    pub(crate) fn restore_lost(&mut self, workers: &Workers<'_>, lost: &Lost) {
        for node in (0..self.node_count()).filter(|node| self.is_lost_at(lost, *node as u32)).collect::<Vec<_>>() {
            self.state.position_m[node] = self.state.saved.position_m[node];
            self.state.velocity_m_per_s[node] = [0.0; 3];
        }
        self.state.rigid.forget_turns();
        // Lanes without an element go along: what is no number in them would be added to the others.
        let elements = self.base().elements.len();
        for element in 0..LANES * self.state.elements.len() {
            if element >= elements || lost.parts[self.part_of_element(element) as usize] {
                self.restore_element(element);
            }
        }
        let relapsed = |(part, lost): (usize, &bool)| *lost && self.state.rigid.steady_steps[part] <= RELAPSE_STEPS;
        let relapsed: Vec<bool> = lost.parts.iter().enumerate().map(relapsed).collect();
        self.return_to_rest_shape(&relapsed);
        let steady = self.state.rigid.steady_steps.iter_mut().zip(&lost.parts);
        steady.filter(|(_, lost)| **lost).for_each(|(steps, _)| *steps = 0);
        self.evaluate(workers, 20);
    }

    /// Takes the body back to where the step that changed its velocities by `dv` began.
    pub(crate) fn take_back_step(&mut self, workers: &Workers<'_>, dv: &Nodal) {
        self.state.position_m.clone_from(&self.state.saved.position_m);
        for (v, dv) in self.state.velocity_m_per_s.iter_mut().zip(dv) {
            (0..3).for_each(|i| v[i] -= dv[i]);
        }
        (0..LANES * self.state.elements.len()).for_each(|element| self.restore_element(element));
        // With the rotations that the forces of the solve were found with, improved no more.
        self.evaluate(workers, 0);
    }

    fn restore_element(&mut self, element: usize) {
        let (block, lane) = (element / LANES, element % LANES);
        let state = &mut self.state.elements[block];
        for (rotation, saved) in state.rotation.iter_mut().zip(&self.state.saved.rotation[block]) {
            rotation.as_mut_array()[lane] = saved.as_array()[lane];
        }
        let saved = self.state.saved.branch.get(block).and_then(Option::as_deref);
        if let (Some(branch), Some(saved)) = (&mut state.branch, saved) {
            branch.copy_lane(lane, saved, lane);
        }
    }

    /// Takes `parts` to their rest shapes, relaxed: where they were built if they are held there, else about their
    /// middles.
    pub(super) fn return_to_rest_shape(&mut self, parts: &[bool]) {
        let mut shift: Vec<(Vec3, f64)> = vec![(Vec3::zeros(), 0.0); parts.len()];
        for (node, x) in self.state.position_m.iter().enumerate() {
            if let Some(sum) = self.state.rigid.loose_part(node).and_then(|part| shift.get_mut(part)) {
                *sum = (sum.0 + Vec3::from(*x) - self.rest_position_m(node), sum.1 + 1.0);
            }
        }
        for node in 0..self.node_count() {
            let part = self.part_of_node(node as u32);
            if part != NONE && parts[part as usize] {
                let loose = self.state.rigid.loose_part(node);
                let moved = loose.map_or(Vec3::zeros(), |part| shift[part].0 / shift[part].1);
                self.state.position_m[node] = (self.rest_position_m(node) + moved).into();
            }
        }
        let relaxed = BranchState::default();
        for element in 0..self.base().elements.len() {
            if parts[self.part_of_element(element) as usize] {
                let (state, lane) = (&mut self.state.elements[element / LANES], element % LANES);
                let unturned = [0.0, 0.0, 0.0, 1.0];
                state.rotation.iter_mut().zip(unturned).for_each(|(q, one)| q.as_mut_array()[lane] = one);
                state.branch.iter_mut().for_each(|branch| branch.copy_lane(lane, &relaxed, lane));
            }
        }
    }
}
