//! Forces and energies of the elements at the current state.

use super::{Body, Nodal};
use crate::Vec3;
use crate::fem::block::{ElementBlock, ElementState, Evaluation, LANES, ModelFit, NodalBuffers, StepTerms};
use crate::math::Aabb;
use crate::solve::assembly::{CHUNK_ELEMENTS, Chunk};
use crate::workers::{Grain, Groups, Workers};
use serde::{Deserialize, Serialize};
use wide::f64x4;

/// Blocks per chunk of elements.
pub(super) const BLOCKS_PER_CHUNK: usize = CHUNK_ELEMENTS / LANES;
/// Of the evaluation of chunks of elements: 40 us a chunk.
const EVALUATION_GRAIN: Grain = Grain { chunk: 1, least: 1 };

/// What a step did to a body's energies, J.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct StepEnergies {
    /// Sums over the elements.
    pub elements: StepTerms<f64>,
    /// `1/2 dv^T M dv`.
    pub inertial_j: f64,
    /// `dx^T T dx` of the geometric stiffness.
    pub geometric_j: f64,
}

/// Energies of a body, J.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BodyEnergy {
    /// Elastic, of relaxing branches too.
    pub elastic_j: f64,
    /// Kinetic.
    pub kinetic_j: f64,
}

impl BodyEnergy {
    /// All of it.
    #[must_use]
    pub fn total_j(&self) -> f64 {
        self.elastic_j + self.kinetic_j
    }
}

/// What an evaluation found of the elements of a chunk.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct ChunkSums {
    /// Sums over the elements, one to a lane.
    pub(super) found: Evaluation,
    /// Corners of the box around the nodes, m, scene frame, xyz0.
    low_m: f64x4,
    high_m: f64x4,
}

impl ChunkSums {
    fn bounds(&self) -> Aabb {
        let point = |v: f64x4| {
            let [x, y, z, _] = v.to_array();
            Vec3::new(x, y, z)
        };
        Aabb { min_m: point(self.low_m), max_m: point(self.high_m) }
    }

    fn of(
        nodal: &NodalBuffers,
        blocks: &[ElementBlock],
        states: &mut [ElementState],
        (balance_n, fits): (&mut [f64x4], &mut [ModelFit]),
        dt_s: f64,
        rotation_iterations: u32,
    ) -> Self {
        let (low, high) = (f64x4::splat(f64::INFINITY), f64x4::splat(f64::NEG_INFINITY));
        let mut sums = Self {
            found: Evaluation::default(),
            low_m: nodal.position_m.iter().fold(low, |low, x| low.fast_min(*x)),
            high_m: nodal.position_m.iter().fold(high, |high, x| high.fast_max(*x)),
        };
        balance_n.fill(f64x4::ZERO);
        for ((block, state), fit) in blocks.iter().zip(states).zip(fits) {
            let before_j = block.elastic_j(state);
            let found = block.evaluate(state, nodal, balance_n, dt_s, rotation_iterations);
            *fit = found.model_fit(before_j);
            sums.found.join(&found);
        }
        sums
    }
}

/// Reads what the elements of a chunk see of the nodes.
fn gather(
    nodal: &mut NodalBuffers,
    chunk: &Chunk,
    position_m: &Nodal,
    velocity_m_per_s: &Nodal,
    change: Option<&Nodal>,
) {
    let read = |v: [f64; 3]| f64x4::new([v[0], v[1], v[2], 0.0]);
    chunk.load(position_m, read, &mut nodal.position_m);
    chunk.load(velocity_m_per_s, read, &mut nodal.velocity_m_per_s);
    nodal.velocity_change.resize(change.map_or(0, |_| chunk.len()), f64x4::ZERO);
    if let Some(change) = change {
        chunk.load(change, read, &mut nodal.velocity_change);
    }
}

impl Body {
    /// Rotations, forces, energies and velocity terms of every element at the current state.
    pub(crate) fn evaluate(&mut self, workers: &Workers<'_>, rotation_iterations: u32) {
        self.evaluate_chunks(workers, |_| true, None, rotation_iterations);
    }

    /// The same at the end of a step that changed the velocities by `velocity_change`; returns what the
    /// step did to the energies.
    pub(crate) fn evaluate_step(&mut self, workers: &Workers<'_>, velocity_change: &Nodal) -> StepEnergies {
        let before_j = self.energy().kinetic_j;
        self.evaluate_chunks(workers, |_| true, Some(velocity_change), 2);
        let mut sum = StepEnergies::default();
        for step in self.state.chunks.iter().map(|chunk| &chunk.found.step) {
            sum.elements.inertial_work_j += step.inertial_work_j.reduce_add();
            sum.elements.elastic_j += step.elastic_j.reduce_add();
            sum.elements.force_work_j += step.force_work_j.reduce_add();
            sum.elements.damping_j += step.damping_j.reduce_add();
            sum.elements.viscous_j += step.viscous_j.reduce_add();
        }
        sum.inertial_j = sum.elements.inertial_work_j - (self.energy().kinetic_j - before_j);
        self.geometric_work_j().for_each(|(_, work_j)| sum.geometric_j += work_j);
        sum
    }

    /// Evaluates the chunks that are `among` those that may have changed.
    pub(super) fn evaluate_chunks(
        &mut self,
        workers: &Workers<'_>,
        among: impl Fn(usize) -> bool + Sync,
        velocity_change: Option<&Nodal>,
        rotation_iterations: u32,
    ) {
        let (assembly, blocks) = (self.solver.multigrid.operator().assembly(), &self.solver.blocks);
        let (x, v, dt) = (&self.state.position_m, &self.state.velocity_m_per_s, self.solver.params.dt_s);
        let states = Groups { entries: &mut self.state.elements, size: BLOCKS_PER_CHUNK };
        let balance_n = assembly.by_chunk(&mut self.state.balance_n);
        let fits = Groups { entries: &mut self.scratch.fits[..], size: BLOCKS_PER_CHUNK };
        workers.for_chunks(
            (states, &mut self.state.chunks[..], &mut self.scratch.nodal[..], balance_n, fits),
            EVALUATION_GRAIN,
            |index, (states, sums, nodal, balance_n, fits)| {
                if among(index) {
                    let (chunk, blocks) = (&assembly.chunks()[index], &blocks[index * BLOCKS_PER_CHUNK..]);
                    gather(&mut nodal[0], chunk, x, v, velocity_change);
                    let (states, balance_n) = (states.entries, balance_n.entries);
                    let found = (&mut *balance_n, fits.entries);
                    sums[0] = ChunkSums::of(&nodal[0], blocks, states, found, dt, rotation_iterations);
                    chunk.hand_over(balance_n, |w| w);
                }
            },
        );
        let turned_rad2 = |chunk: &ChunkSums| chunk.found.turned_rad2.to_array().into_iter().fold(0.0, f64::max);
        self.solver.turned_rad += self.state.chunks.iter().map(turned_rad2).fold(0.0, f64::max).sqrt();
    }

    /// Elements whose boxes may meet `near`, ascending: those of the chunks whose boxes do.
    pub(crate) fn elements_near<const N: usize>(&self, near: [Aabb; N]) -> impl Iterator<Item = usize> + '_ {
        let is_met = move |bounds: &Aabb| near.iter().any(|near| near.meets(bounds));
        let met = self.chunk_boxes().enumerate().filter(move |(_, bounds)| is_met(bounds));
        let elements = self.base().elements.len();
        met.flat_map(move |(index, _)| index * CHUNK_ELEMENTS..elements.min((index + 1) * CHUNK_ELEMENTS))
    }

    /// The box around the body at the state that was last evaluated.
    #[must_use]
    pub(crate) fn bounds(&self) -> Aabb {
        Aabb::around(self.chunk_boxes().flat_map(|b| [b.min_m, b.max_m]))
    }

    /// Boxes around the chunks of elements. What is held is where it was, whatever the nodes around it do.
    pub(crate) fn chunk_boxes(&self) -> impl Iterator<Item = Aabb> + '_ {
        let bounds = self.state.chunks.iter().map(ChunkSums::bounds).zip(self.state.held.boxes());
        bounds.map(|(chunk, held)| chunk.with(held))
    }

    /// Energies at the state that was last evaluated.
    #[must_use]
    pub(crate) fn energy(&self) -> BodyEnergy {
        let mut energy = BodyEnergy::default();
        // Lanes without an element have zero matrices and add nothing.
        for chunk in &self.state.chunks {
            energy.elastic_j += chunk.found.elastic_j.reduce_add();
            energy.kinetic_j += chunk.found.kinetic_j.reduce_add();
        }
        energy
    }
}
