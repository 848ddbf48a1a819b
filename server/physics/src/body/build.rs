//! How a body's solver is made of its description and its state, and made anew where these have changed.

use super::{Body, rigid};
use crate::boundary::Boundary;
use crate::fem::block::{ElementBlock, ElementLaw, ElementState, LANES, SharedByBlocks};
use crate::fem::held::GROUND;
use crate::grid::VoxelId;
use crate::grid::levels::LevelChange;
use crate::solve::assembly::CHUNK_ELEMENTS;
use crate::solve::multigrid::Multigrid;
use crate::workers::Workers;
use wide::f64x4;

impl Body {
    /// Recomputes the matrices and the loads of an element from its voxels.
    pub(super) fn rebuild_element(&mut self, element: usize) {
        let voxels = self.voxels_of(element);
        self.solver.element_loads_n[element] = self.element_loads(&voxels);
        let plain = self.element_matrices(element, &voxels);
        let matrices = self.held_matrices(element, &voxels, plain);
        let law = self.mean_law(&voxels);
        let [low_m, ..] = self.cell_corners_m(element);
        let cell = (low_m.into(), self.element_edge_m(element));
        let (block, state) = (&mut self.solver.blocks[element / LANES], &mut self.state.elements[element / LANES]);
        block.set_matrices(element % LANES, cell, &matrices, law, self.solver.params.dt_s);
        if block.viscosity.is_some() {
            state.branch.get_or_insert_default();
        }
        state.ground_force_n = block.ground.as_ref().map(|_| Box::new([f64x4::ZERO; GROUND]));
        self.begin_geometric_stiffness(element, &voxels);
    }

    /// Damping and stiffening of an element: means over its voxels; and what relaxes of it.
    fn mean_law(&self, voxels: &[VoxelId]) -> ElementLaw {
        let viscosity = self.mean_viscosity(voxels);
        let mut mean = ElementLaw { alpha_per_s: 0.0, beta_s: 0.0, stiffening_rate_per_pa: 0.0, viscosity };
        let weight = 1.0 / voxels.len() as f64;
        for &voxel in voxels {
            let law = self.material_of(voxel).law;
            mean.alpha_per_s += weight * law.alpha_per_s;
            mean.beta_s += weight * law.beta_s;
            mean.stiffening_rate_per_pa += weight * law.stiffening_rate_per_pa;
        }
        mean
    }

    /// Builds every matrix from scratch and evaluates forces at the current state.
    pub(super) fn rebuild_all(&mut self, workers: &Workers<'_>) {
        self.resize_blocks();
        let all: Vec<u32> = (0..self.base().elements.len() as u32).collect();
        self.find_held(&all);
        for element in 0..all.len() {
            self.rebuild_element(element);
        }
        self.number_nodes(None);
        self.state.boundary = Boundary::of(self.solid());
        self.state.rigid = rigid::RigidParts::new(self);
        self.rebuild_external_forces();
        self.evaluate(workers, 20);
        for element in 0..self.base().elements.len() {
            self.write_matrix(element);
        }
        self.write_rotations(workers);
        self.solver.multigrid.rebuild(workers, &self.state.levels);
        let mut shared = SharedByBlocks::default();
        self.solver.blocks.iter_mut().for_each(|b| b.share_matrices(&mut shared));
        self.share_system_matrices();
        self.save_state(workers);
    }

    /// The system's matrices of elements that stiffen come and go with their strain.
    pub(super) fn share_system_matrices(&mut self) {
        if self.solver.blocks.iter().all(|b| b.stiffening.is_none()) {
            self.solver.multigrid.share_matrices();
        }
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
        let mut balance_n = vec![f64x4::ZERO; assembly.buffer_len()];
        for (chunk, (from, to)) in before.into_iter().zip(places(&self.solver.multigrid)).enumerate() {
            if renumbered.binary_search(&chunk).is_err() {
                balance_n[to].copy_from_slice(&self.state.balance_n[from]);
            }
        }
        self.state.balance_n = balance_n;
        self.state.chunks.resize_with(assembly.chunks().len(), Default::default);
        let elements = self.state.levels[0].elements.len();
        for &index in &renumbered {
            let (chunk, first) = (&assembly.chunks()[index], index * CHUNK_ELEMENTS);
            for element in first..elements.min(first + CHUNK_ELEMENTS) {
                self.solver.blocks[element / LANES].set_slots(element % LANES, chunk.corners(element - first));
            }
        }
        self.scratch.fit(&self.state.levels[0], assembly);
        self.bound_held();
        renumbered
    }

    pub(super) fn resize_blocks(&mut self) {
        let elements = self.base().elements.len();
        let blocks = elements.div_ceil(LANES);
        self.solver.blocks.resize_with(blocks, ElementBlock::default);
        self.state.elements.resize_with(blocks, ElementState::default);
        self.solver.element_loads_n.resize(elements, [[0.0; 3]; 8]);
        self.state.held.resize(elements);
        self.solver.applied_stiffening.resize(elements, 1.0);
        self.solver.coarse_stiffening.resize(elements, 1.0);
    }
}
