//! The body's part of a step: forces at the current state, the system matrix, the right side and the new
//! state.

use super::evaluation::BLOCKS_PER_CHUNK;
use super::{Body, Nodal};
use crate::fem::block::LANES;
use crate::fem::composite::corner_pair;
use crate::fem::lanes::{PACKED, for_packed};
use crate::solve::assembly::LANES as OPERATOR_LANES;
use crate::solve::vectors::{NODE_GRAIN, NODES_PER_CHUNK};
use crate::workers::{Grain, Workers};
use wide::f64x4;

/// Of copies of rotations: 3 us a chunk.
const ROTATION_GRAIN: Grain = Grain { chunk: BLOCKS_PER_CHUNK, least: 8 };
/// The smoothers' diagonal blocks stay until some element may have turned by this since: inside a body of
/// one material they hardly depend on rotations.
const MOST_TURNED_RAD: f64 = 0.1;
/// They stay until some element's geometric stiffness may have changed since by this fraction of `V E`: as much of the stress is
/// less than half as much of the diagonal, where the stiffness against volume change stands too.
const MOST_UNSMOOTHED: f64 = 0.5;
/// Coarse matrices follow an element's stiffening only when it has changed by this factor: they
/// precondition, and a spectrally close matrix does as well.
const COARSE_STIFFENING_FACTOR: f64 = 1.5;

impl Body {
    /// Sum of the elastic force at each node, N; what internal forces alone do. Forces on hanging nodes
    /// are handed to their masters.
    #[must_use]
    pub(crate) fn elastic_forces_n(&self) -> Nodal {
        let mut forces = vec![[0.0; 3]; self.node_count()];
        self.for_each_corner(|state, lane, corner, node| {
            (0..3).for_each(|i| forces[node][i] += state.force_n[3 * corner + i].as_array()[lane]);
        });
        self.gather_hanging(&mut forces);
        forces
    }

    /// Sum of the elastic force and the loads at each node, N.
    #[must_use]
    pub(crate) fn pull_n(&self) -> Nodal {
        let mut pull_n = self.elastic_forces_n();
        pull_n.iter_mut().zip(&self.solver.external_n).for_each(|(f, load)| (0..3).for_each(|i| f[i] += load[i]));
        pull_n
    }

    /// What the elements' nodes carry under a constant stress, `-sum_e V sigma d_a`, N: the reference
    /// of the patch test.
    #[must_use]
    pub(crate) fn constant_stress_forces_n(&self, stress_pa: &crate::Mat3) -> Nodal {
        let mut forces = vec![[0.0; 3]; self.node_count()];
        for (element, data) in self.base().elements.iter().enumerate() {
            let (block, lane) = (&self.solver.blocks[element / LANES], element % LANES);
            for (corner, &node) in data.nodes.iter().enumerate() {
                let d = crate::Vec3::from(block.shapes.mean_gradient[corner].map(|g| g.as_array()[lane]));
                let f = stress_pa * d * block.shapes.volume_m3.as_array()[lane];
                (0..3).for_each(|i| forces[node as usize][i] -= f[i]);
            }
        }
        self.gather_hanging(&mut forces);
        forces
    }

    /// Momentum of each node's part of the mass, N s.
    #[must_use]
    pub(crate) fn nodal_momentum(&self) -> Nodal {
        let mut momentum = vec![[0.0; 3]; self.node_count()];
        for (element, data) in self.base().elements.iter().enumerate() {
            for (a, &node) in data.nodes.iter().enumerate() {
                for (b, &other) in data.nodes.iter().enumerate() {
                    let mass = self.mass_between_kg(element, a, b);
                    let v = self.state.velocity_m_per_s[other as usize];
                    (0..3).for_each(|i| momentum[node as usize][i] += mass * v[i]);
                }
            }
        }
        momentum
    }

    /// Entry of an element's mass between two corners, kg.
    pub(super) fn mass_between_kg(&self, element: usize, a: usize, b: usize) -> f64 {
        self.solver.blocks[element / LANES].shapes.mass_kg[corner_pair(a, b)].as_array()[element % LANES]
    }

    fn for_each_corner(&self, mut visit: impl FnMut(&crate::fem::block::ElementState, usize, usize, usize)) {
        for (element, data) in self.base().elements.iter().enumerate() {
            for (corner, &node) in data.nodes.iter().enumerate() {
                visit(&self.state.elements[element / LANES], element % LANES, corner, node as usize);
            }
        }
    }

    /// `A_e = (1 + alpha dt) M + (dt^2 + beta dt) K' + dt^2 (s g K + T)` of one element, with the tangent
    /// `K' = K + (psi' - 1) K_G + psi'' / V f_G f_G^T`, into the solver's operator.
    pub(super) fn write_matrix(&mut self, element: usize) {
        self.write_matrices(element / LANES, std::array::from_fn(|lane| lane == element % LANES));
    }

    /// The same of those elements of a block that are to be `written`.
    fn write_matrices(&mut self, of_block: usize, written: [bool; LANES]) {
        let (block, state, first) = (&self.solver.blocks[of_block], &self.state.elements[of_block], of_block * LANES);
        let dt_s = self.solver.params.dt_s;
        let dt = f64x4::splat(dt_s);
        let mass_factor = f64x4::ONE + dt * block.alpha_per_s;
        let stiffness_factor = dt * (dt + block.beta_s);
        let [rise, curvature] = state.stiffening_of_matrix();
        let branch_factor = block.viscosity.as_ref().map(|v| dt * dt * v.tangent());
        let geometric: [_; LANES] =
            std::array::from_fn(|lane| written[lane].then(|| self.geometric_stiffness(first + lane)).flatten());
        let mut packed = [f64x4::ZERO; PACKED];
        for_packed(|index, row, column| {
            let mut k = block.stiffness.entry(index);
            if let Some(data) = &block.stiffening {
                k += rise * data.galerkin.entry(index);
                k += curvature * state.galerkin_force_n[row] * state.galerkin_force_n[column];
            }
            packed[index] = stiffness_factor * k;
            if let Some(factor) = branch_factor {
                packed[index] += factor * block.stiffness.entry(index);
            }
            if row % 3 == column % 3 {
                let (a, b) = (row / 3, column / 3);
                packed[index] += mass_factor * block.shapes.mass_kg[corner_pair(a, b)];
                for (entry, geometric) in packed[index].as_mut_array().iter_mut().zip(&geometric) {
                    *entry += geometric.map_or(0.0, |s| dt_s * dt_s * s.stiffness_n_per_m(a, b));
                }
            }
        });
        let applied = (f64x4::ONE + rise).to_array();
        for lane in (0..LANES).filter(|lane| written[*lane]) {
            self.solver.applied_stiffening[first + lane] = applied[lane];
        }
        self.solver.multigrid.operator_mut().set_matrices(first, &packed, written);
    }

    /// Rotations of all elements into the solver's operator.
    pub(super) fn write_rotations(&mut self, workers: &Workers<'_>) {
        const { assert!(OPERATOR_LANES == 2 * LANES) };
        let states = &self.state.elements;
        workers.for_chunks(&mut self.solver.multigrid.operator_mut().blocks[..], ROTATION_GRAIN, |first, blocks| {
            for (block, states) in blocks.iter_mut().zip(states[2 * first * BLOCKS_PER_CHUNK..].chunks(2)) {
                let (low, high) = (&states[0].rotation_matrix, &states[states.len() - 1].rotation_matrix);
                block.rotation = std::array::from_fn(|i| bytemuck::cast([low[i], high[i]]));
            }
        });
    }

    /// Brings the solver's operator and its preconditioner to the evaluated state.
    pub(crate) fn refresh_operator(&mut self, workers: &Workers<'_>) {
        self.scratch.stale_parents.clear();
        let mut rewritten = false;
        self.solver.unsmoothed += self.follow_stress();
        if self.solver.blocks.iter().any(|b| b.stiffening.is_some()) {
            for block in 0..self.state.elements.len() {
                let rise = self.state.elements[block].stiffening_of_matrix()[0].to_array();
                let applied = self.solver.applied_stiffening[block * LANES..].iter().take(LANES);
                let mut written = [false; LANES];
                for (lane, applied) in applied.enumerate() {
                    written[lane] = rise[lane] > 0.0 || *applied != 1.0;
                }
                if written.contains(&true) {
                    self.write_matrices(block, written);
                    rewritten = true;
                }
            }
            for element in 0..self.base().elements.len() {
                let ratio = self.solver.applied_stiffening[element] / self.solver.coarse_stiffening[element];
                if !(1.0 / COARSE_STIFFENING_FACTOR..=COARSE_STIFFENING_FACTOR).contains(&ratio) {
                    self.solver.coarse_stiffening[element] = self.solver.applied_stiffening[element];
                    if let Some(above) = self.state.levels.get(1) {
                        self.scratch.stale_parents.push(above.owner[element]);
                    }
                }
            }
        }
        if !self.scratch.stale_parents.is_empty() {
            let parents = &mut self.scratch.stale_parents;
            parents.sort_unstable();
            parents.dedup();
            self.solver.multigrid.rebuild_coarse(parents);
        }
        self.write_rotations(workers);
        self.solver.multigrid.update_rotations(workers);
        if rewritten || self.solver.turned_rad > MOST_TURNED_RAD || self.solver.unsmoothed > MOST_UNSMOOTHED {
            self.solver.multigrid.update_diagonals(workers);
            (self.solver.turned_rad, self.solver.unsmoothed) = (0.0, 0.0);
        }
    }

    /// Writes `dt (f_elastic + f_external - drag)` and the impulses of turning at every node: the right side but for
    /// contact.
    pub(crate) fn assemble_right_side(&mut self, workers: &Workers<'_>) {
        let dt = self.solver.params.dt_s;
        let mut b = std::mem::take(&mut self.scratch.right_side);
        let (assembly, external_n) = (self.solver.multigrid.operator().assembly(), &self.solver.external_n);
        let balance_n = &self.state.balance_n;
        workers.for_chunks(&mut b[..], NODE_GRAIN, |first, b| {
            for (node, b) in (first * NODES_PER_CHUNK..).zip(b) {
                let entries = assembly.entries(node).iter();
                let sum = entries.fold(f64x4::ZERO, |sum, entry| sum + balance_n[*entry as usize]).to_array();
                *b = [0, 1, 2].map(|i| dt * (sum[i] + external_n[node][i]));
            }
        });
        for (nodes, pulls) in self.geometric_pulls() {
            for (node, pull) in nodes.into_iter().zip(pulls) {
                (0..3).for_each(|i| b[node][i] -= dt * dt * pull[i]);
            }
        }
        self.add_turning_impulses(&mut b);
        self.gather_hanging(&mut b);
        self.scratch.right_side = b;
    }

    /// Hands what acts on hanging nodes to their masters.
    pub(super) fn gather_hanging(&self, forces: &mut Nodal) {
        for hanging in self.solver.multigrid.operator().hanging() {
            let force = std::mem::take(&mut forces[hanging.node as usize]);
            for (master, w) in hanging.masters {
                (0..3).for_each(|i| forces[master as usize][i] += f64::from(w) * force[i]);
            }
        }
    }

    /// Takes the step with a change of velocity: `v += dv`, `x += dt v`, and what turns freely turns. Returns the
    /// work of the external loads, gravity included, J.
    pub(crate) fn integrate(&mut self, workers: &Workers<'_>, velocity_change: &Nodal) -> f64 {
        let dt = self.solver.params.dt_s;
        self.find_turns(velocity_change);
        type Data<'a> = (&'a mut [[f64; 3]], &'a mut [[f64; 3]], &'a [[f64; 3]], &'a [[f64; 3]]);
        let integrate = |_, (x, v, dv, f): Data<'_>| {
            let mut work = 0.0;
            for (((x, v), dv), f) in x.iter_mut().zip(v).zip(dv).zip(f) {
                for i in 0..3 {
                    v[i] += dv[i];
                    x[i] += dt * v[i];
                    work += f[i] * (dt * v[i]);
                }
            }
            work
        };
        let (x, v) = (&mut self.state.position_m[..], &mut self.state.velocity_m_per_s[..]);
        let data = (x, v, &velocity_change[..], &self.solver.external_n[..]);
        let work_j = workers.reduce_chunks(data, NODE_GRAIN, integrate, |a, b| a + b);
        self.turn_positions();
        work_j
    }

    /// Work of the external loads, gravity included, over nodal displacements, J.
    #[must_use]
    pub(crate) fn external_work_j(&self, displacement_m: impl Iterator<Item = [f64; 3]>) -> f64 {
        self.solver.external_n.iter().zip(displacement_m).map(|(f, u)| (0..3).map(|i| f[i] * u[i]).sum::<f64>()).sum()
    }
}
