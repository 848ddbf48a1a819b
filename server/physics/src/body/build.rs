//! How a body's solver is made of its description and its state, and made anew where these have changed.

use super::parts::RigidParts;
use super::{Body, Solver};
use crate::Mat3;
use crate::boundary::{Boundary, Solid};
use crate::fem::block::{ElementBlock, ElementLaw, ElementState, LANES, SharedByBlocks};
use crate::fem::matrices::GROUND;
use crate::grid::VoxelId;
use crate::grid::levels::LevelChange;
use crate::grow::grow;
use crate::solve::assembly::{CHUNK_ELEMENTS, LANES as OPERATOR_LANES};
use crate::solve::multigrid::Multigrid;
use crate::walk::WalkError;
use crate::workers::Workers;
use std::sync::Arc;
use wide::f64x4;

impl Body {
    /// Recomputes the matrices and the loads of an element from its voxels.
    pub(super) fn rebuild_element(&mut self, element: usize) {
        let voxels = self.voxels_of(element);
        self.make_matrices(element, &voxels);
        let (block, state) = (&self.solver.blocks[element / LANES], &mut self.state.elements[element / LANES]);
        if block.viscosity.is_some() {
            state.branch.get_or_insert_default();
        }
        state.ground_force_n = block.ground.as_ref().map(|_| Box::new([f64x4::ZERO; GROUND]));
        self.begin_geometric_stiffness(element, &voxels);
    }

    /// The solver's part of it.
    fn make_matrices(&mut self, element: usize, voxels: &[VoxelId]) {
        self.solver.element_loads_n[element] = self.element_loads(voxels);
        let plain = self.element_matrices(element, voxels);
        let matrices = self.held_matrices(element, voxels, plain);
        let law = self.mean_law(voxels);
        let [low_m, ..] = self.cell_corners_m(element);
        let cell = (low_m.into(), self.element_edge_m(element));
        let block = &mut self.solver.blocks[element / LANES];
        block.set_matrices(element % LANES, cell, &matrices, law, self.solver.params.dt_s);
    }

    /// Damping and stiffening of an element: means over its voxels; what relaxes of it and what it is strained by in life.
    fn mean_law(&self, voxels: &[VoxelId]) -> ElementLaw {
        let (viscosity, free_stretch) = (self.mean_viscosity(voxels), self.mean_free_stretch(voxels));
        let mut mean =
            ElementLaw { alpha_per_s: 0.0, beta_s: 0.0, stiffening_rate_per_pa: 0.0, viscosity, free_stretch };
        let weight = 1.0 / voxels.len() as f64;
        for &voxel in voxels {
            let law = self.material_of(voxel).law;
            mean.alpha_per_s += weight * law.alpha_per_s;
            mean.beta_s += weight * law.beta_s;
            mean.stiffening_rate_per_pa += weight * law.stiffening_rate_per_pa;
        }
        mean
    }

    /// Mean over an element's voxels of what they would stretch by if they were free, as stiff as they are: under it
    /// their stresses add up to none. `None` where no voxel is strained in life.
    fn mean_free_stretch(&self, voxels: &[VoxelId]) -> Option<Mat3> {
        let materials = || voxels.iter().map(|v| self.material_of(*v));
        materials().find(|material| material.law.free_stretch.is_some())?;
        let (mut sum, mut stiffness) = (Mat3::zeros(), 0.0);
        for material in materials() {
            sum += material.young_modulus_pa * material.law.free_stretch.unwrap_or_else(Mat3::identity);
            stiffness += material.young_modulus_pa;
        }
        Some(sum / stiffness)
    }

    /// Builds every matrix from scratch and evaluates forces at the current state.
    pub(super) fn rebuild_all(&mut self, workers: &Workers<'_>) {
        self.resize_blocks();
        let all: Vec<u32> = (0..self.base().elements.len() as u32).collect();
        self.find_held(&all);
        self.make_blocks(Self::rebuild_element);
        self.number_nodes(None);
        self.state.boundary = Boundary::of(self.solid());
        self.state.rigid = RigidParts::new(self);
        self.rebuild_external_forces();
        self.evaluate(workers, 20);
        self.write_all_matrices();
        self.write_rotations(workers);
        self.solver.multigrid.rebuild(workers, &self.state.levels);
        self.share_system_matrices();
        self.save_state(workers);
    }

    /// Has every element's matrices made by `make`. What blocks have in common is stored once from the first: a fine body is
    /// never larger than it is in the end.
    fn make_blocks(&mut self, make: impl Fn(&mut Self, usize)) {
        let (elements, mut shared) = (self.base().elements.len(), SharedByBlocks::default());
        for first in (0..elements).step_by(LANES) {
            (first..elements.min(first + LANES)).for_each(|element| make(self, element));
            self.solver.blocks[first / LANES].share_matrices(&mut shared);
        }
    }

    /// Writes every element's matrix of the system, stored as [`Self::make_blocks`] stores the elements' own.
    fn write_all_matrices(&mut self) {
        let (elements, stiffens, mut shared) = (self.base().elements.len(), self.stiffens(), Vec::new());
        for first in (0..elements).step_by(OPERATOR_LANES) {
            (first..elements.min(first + OPERATOR_LANES)).for_each(|element| self.write_matrix(element));
            if !stiffens {
                self.solver.multigrid.operator_mut().share_matrix(first, &mut shared);
            }
        }
    }

    /// Stores once what blocks of the system's matrices have in common.
    pub(super) fn share_system_matrices(&mut self) {
        if !self.stiffens() {
            self.solver.multigrid.share_matrices();
        }
    }

    /// Whether any element stiffens: the system's matrices of such come and go with their strain.
    pub(super) fn stiffens(&self) -> bool {
        self.solver.blocks.iter().any(|b| b.stiffening.is_some())
    }

    /// Stores anew once what the blocks of these elements have in common, whatever they had before: how a matrix is
    /// stored follows from what it is.
    pub(super) fn share_matrices_of(&mut self, elements: &[u32]) {
        let stiffens = self.stiffens();
        for &element in elements {
            self.solver.blocks[element as usize / LANES].share_matrices(&mut SharedByBlocks::default());
            if !stiffens {
                self.solver.multigrid.operator_mut().share_matrix(element as usize, &mut Vec::new());
            }
        }
    }

    /// Completes a body that was read from a file by what follows from what was read, and by what never changes of one
    /// like it: of the same scene.
    ///
    /// # Errors
    /// What was read does not fit together, or not to the scene.
    pub(crate) fn complete(&mut self, like: &Self, workers: &Workers<'_>) -> Result<(), WalkError> {
        self.description = Arc::clone(&like.description);
        self.state.grid.complete(&like.state.grid)?;
        self.state.check(&like.state)?;
        let solid = Solid { grid: &self.state.grid, level: &self.state.levels[0] };
        self.state.boundary.complete(solid, &like.state.boundary);
        self.solver.multigrid.complete(&self.state.levels)?;
        let (buffer, elements) = (self.solver.multigrid.operator().assembly().buffer_len(), self.base().elements.len());
        let Solver { applied_stiffening, coarse_stiffening, .. } = &self.solver;
        let fits = self.state.balance_n.len() == buffer
            && [applied_stiffening, coarse_stiffening].into_iter().all(|values| values.len() == elements);
        if !fits {
            return Err(WalkError::new("the solver is not of the body's elements".into()));
        }
        self.make_solver(workers);
        Ok(())
    }

    /// What of the solver follows from the state without a lag.
    fn make_solver(&mut self, workers: &Workers<'_>) {
        self.resize_blocks();
        self.make_blocks(|body, element| body.make_matrices(element, &body.voxels_of(element)));
        for (block, state) in self.solver.blocks.iter_mut().zip(&self.state.elements) {
            if state.branch.is_some() {
                block.viscosity.get_or_insert_default();
            }
        }
        self.number_slots(&(0..self.state.chunks.len()).collect::<Vec<_>>());
        self.rebuild_external_forces();
        let applied_stiffening = self.solver.applied_stiffening.clone();
        self.write_all_matrices();
        self.solver.applied_stiffening = applied_stiffening;
        self.write_rotations(workers);
        self.solver.multigrid.update_rotations(workers);
        self.solver.multigrid.invert_diagonals(workers);
    }

    /// Takes the numbering of the nodes of these chunks into their elements.
    fn number_slots(&mut self, chunks: &[usize]) {
        let assembly = self.solver.multigrid.operator().assembly();
        let elements = self.state.levels[0].elements.len();
        for &index in chunks {
            let (chunk, first) = (&assembly.chunks()[index], index * CHUNK_ELEMENTS);
            for element in first..elements.min(first + CHUNK_ELEMENTS) {
                self.solver.blocks[element / LANES].set_slots(element % LANES, chunk.corners(element - first));
            }
        }
        self.scratch.fit(&self.state.levels[0], assembly);
    }

    /// Takes the levels' nodes into the solver and into the blocks, changed as `changes` of each level say;
    /// `None`: all of them. Returns the chunks of elements whose numbering changed.
    pub(super) fn number_nodes(&mut self, changes: Option<&[LevelChange]>) -> Vec<usize> {
        let places = |multigrid: &Multigrid| -> Vec<std::ops::Range<usize>> {
            let assembly = multigrid.operator().assembly();
            (0..assembly.chunks().len()).map(|chunk| assembly.buffer_of(chunk)).collect()
        };
        let before = places(&self.solver.multigrid);
        let renumbered = self.solver.multigrid.set_topology(&self.state.levels, changes);
        let assembly = self.solver.multigrid.operator().assembly();
        let mut balance_n = std::mem::take(&mut self.scratch.balance_n);
        balance_n.clear();
        grow(&mut balance_n, assembly.buffer_len(), f64x4::ZERO);
        for (chunk, (from, to)) in before.into_iter().zip(places(&self.solver.multigrid)).enumerate() {
            if renumbered.binary_search(&chunk).is_err() {
                balance_n[to].copy_from_slice(&self.state.balance_n[from]);
            }
        }
        self.scratch.balance_n = std::mem::replace(&mut self.state.balance_n, balance_n);
        self.state.chunks.resize_with(assembly.chunks().len(), Default::default);
        self.number_slots(&renumbered);
        self.bound_held();
        renumbered
    }

    pub(super) fn resize_blocks(&mut self) {
        let elements = self.base().elements.len();
        let blocks = elements.div_ceil(LANES);
        grow(&mut self.solver.blocks, blocks, ElementBlock::default());
        grow(&mut self.state.elements, blocks, ElementState::default());
        grow(&mut self.solver.element_loads_n, elements, Default::default());
        self.state.held.resize(elements);
        grow(&mut self.solver.applied_stiffening, elements, 1.0);
        grow(&mut self.solver.coarse_stiffening, elements, 1.0);
    }
}
