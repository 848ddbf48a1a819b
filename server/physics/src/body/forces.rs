//! The body's part of a step: forces at the current state, the system matrix, the right side and the new
//! state.

use super::Body;
use crate::Vec3;
use crate::fem::composite::corner_pair;
use crate::fem::corotation::{ElementBlock, ElementState, Evaluation, LANES, NodalBuffers, StepTerms};
use crate::fem::lanes::for_packed;
use crate::math::Aabb;
use crate::solve::assembly::{CHUNK_ELEMENTS, Chunk};
use crate::solve::operator::{LANES as OPERATOR_LANES, NODE_GRAIN, NODES_PER_CHUNK};
use crate::workers::{Grain, Groups, Workers};
use wide::f64x4;

/// Blocks per chunk of elements.
const BLOCKS_PER_CHUNK: usize = CHUNK_ELEMENTS / LANES;
/// Of the evaluation of chunks of elements: 40 us a chunk.
const EVALUATION_GRAIN: Grain = Grain { chunk: 1, least: 1 };
/// Of copies of rotations: 3 us a chunk.
const ROTATION_GRAIN: Grain = Grain { chunk: BLOCKS_PER_CHUNK, least: 8 };
/// Elements whose stiffening factor is within this of 1 keep the matrix of the rest state.
const STIFFENING_THRESHOLD: f64 = 0.02;
/// The smoothers' diagonal blocks stay until some element may have turned by this since: inside a body of
/// one material they hardly depend on rotations.
const MOST_TURNED_RAD: f64 = 0.1;
/// They stay until some element's geometric stiffness may have changed since by this fraction of `V E`: as much of the stress is
/// less than half as much of the diagonal, where the stiffness against volume change stands too.
const MOST_UNSMOOTHED: f64 = 0.5;
/// Coarse matrices follow an element's stiffening only when it has changed by this factor: they
/// precondition, and a spectrally close matrix does as well.
const COARSE_STIFFENING_FACTOR: f64 = 1.5;

/// What a step did to a body's energies, J.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StepEnergies {
    /// Sums over the elements.
    pub elements: StepTerms<f64>,
    /// `1/2 dx^T H dx` of held voxels.
    pub hold_j: f64,
    /// `dx^T T dx` of the geometric stiffness.
    pub geometric_j: f64,
}

/// Energies of a body, J.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyEnergy {
    /// Elastic, of relaxing branches too.
    pub elastic_j: f64,
    /// In the springs of held voxels.
    pub hold_j: f64,
    /// Kinetic.
    pub kinetic_j: f64,
}

impl BodyEnergy {
    /// All of it.
    #[must_use]
    pub fn total_j(&self) -> f64 {
        self.elastic_j + self.hold_j + self.kinetic_j
    }
}

/// What the elements of a chunk work on, and what they add up to.
#[derive(Clone, Default)]
pub(super) struct ElementChunk {
    pub(super) nodal: NodalBuffers,
    pub(super) found: Evaluation,
    /// Corners of the box around the nodes, m, xyz0.
    low_m: f64x4,
    high_m: f64x4,
}

impl ElementChunk {
    fn bounds(&self) -> Aabb {
        let point = |v: f64x4| {
            let [x, y, z, _] = v.to_array();
            crate::Vec3::new(x, y, z)
        };
        Aabb { min_m: point(self.low_m), max_m: point(self.high_m) }
    }

    /// Makes the buffers fit a chunk.
    pub(super) fn resize(&mut self, chunk: &Chunk) {
        let nodal = &mut self.nodal;
        for v in [&mut nodal.position_m, &mut nodal.velocity_m_per_s, &mut nodal.velocity_change] {
            v.resize(chunk.len(), f64x4::ZERO);
        }
    }

    fn load(
        &mut self,
        chunk: &Chunk,
        position_m: &super::Nodal,
        velocity_m_per_s: &super::Nodal,
        velocity_change: Option<&super::Nodal>,
    ) {
        let read = |v: [f64; 3]| f64x4::new([v[0], v[1], v[2], 0.0]);
        let nodal = &mut self.nodal;
        chunk.load(position_m, read, &mut nodal.position_m);
        let (low, high) = (f64x4::splat(f64::INFINITY), f64x4::splat(f64::NEG_INFINITY));
        self.low_m = nodal.position_m.iter().fold(low, |low, x| low.fast_min(*x));
        self.high_m = nodal.position_m.iter().fold(high, |high, x| high.fast_max(*x));
        chunk.load(velocity_m_per_s, read, &mut nodal.velocity_m_per_s);
        nodal.velocity_change.resize(velocity_change.map_or(0, |_| chunk.len()), f64x4::ZERO);
        if let Some(change) = velocity_change {
            chunk.load(change, read, &mut nodal.velocity_change);
        }
    }

    fn evaluate(
        &mut self,
        chunk: &Chunk,
        blocks: &[ElementBlock],
        states: &mut [ElementState],
        balance_n: &mut [f64x4],
        dt_s: f64,
        rotation_iterations: u32,
    ) {
        balance_n.fill(f64x4::ZERO);
        self.found = Evaluation::default();
        for (block, state) in blocks.iter().zip(states) {
            let found = block.evaluate(state, &self.nodal, balance_n, dt_s, rotation_iterations);
            self.found.join(&found);
        }
        chunk.hand_over(balance_n, |w| w);
    }
}

impl Body {
    /// Rotations, forces, energies and velocity terms of every element at the current state.
    pub fn evaluate(&mut self, workers: &Workers<'_>, rotation_iterations: u32) {
        self.evaluate_chunks(workers, |_| true, None, rotation_iterations);
    }

    /// The same at the end of a step that changed the velocities by `velocity_change`; returns what the
    /// step did to the energies.
    pub(crate) fn evaluate_step(&mut self, workers: &Workers<'_>, velocity_change: &super::Nodal) -> StepEnergies {
        self.evaluate_chunks(workers, |_| true, Some(velocity_change), 2);
        let mut sum = StepEnergies::default();
        for step in self.chunks.iter().map(|chunk| &chunk.found.step) {
            sum.elements.inertial_j += step.inertial_j.reduce_add();
            sum.elements.elastic_j += step.elastic_j.reduce_add();
            sum.elements.force_work_j += step.force_work_j.reduce_add();
            sum.elements.damping_j += step.damping_j.reduce_add();
            sum.elements.viscous_j += step.viscous_j.reduce_add();
        }
        let dt = self.params.dt_s;
        for (element, hold) in &self.holds {
            let v = self.corner_velocities(*element as usize);
            sum.hold_j += 0.5 * dt * dt * dot(&v, &hold_times(hold, &v));
        }
        for (nodes, pulls) in self.geometric_pulls() {
            let v = nodes.map(|n| Vec3::from(self.velocity_m_per_s[n]));
            sum.geometric_j += dt * dt * v.iter().zip(pulls).map(|(v, pull)| v.dot(&pull)).sum::<f64>();
        }
        sum
    }

    /// Evaluates the chunks that are `among` those that may have changed.
    pub(super) fn evaluate_chunks(
        &mut self,
        workers: &Workers<'_>,
        among: impl Fn(usize) -> bool + Sync,
        velocity_change: Option<&super::Nodal>,
        rotation_iterations: u32,
    ) {
        let (assembly, blocks) = (self.multigrid.operator().assembly(), &self.blocks);
        let (x, v, dt) = (&self.position_m, &self.velocity_m_per_s, self.params.dt_s);
        let states = Groups { entries: &mut self.states, size: BLOCKS_PER_CHUNK };
        let balance_n = assembly.by_chunk(&mut self.balance_n);
        workers.for_chunks(
            (states, &mut self.chunks[..], balance_n),
            EVALUATION_GRAIN,
            |index, (states, chunks, balance_n)| {
                if among(index) {
                    let (chunk, blocks) = (&mut chunks[0], &blocks[index * BLOCKS_PER_CHUNK..]);
                    chunk.load(&assembly.chunks()[index], x, v, velocity_change);
                    let (nodes, states, balance_n) = (&assembly.chunks()[index], states.entries, balance_n.entries);
                    chunk.evaluate(nodes, blocks, states, balance_n, dt, rotation_iterations);
                }
            },
        );
        let turned_rad2 = |chunk: &ElementChunk| chunk.found.turned_rad2.to_array().into_iter().fold(0.0, f64::max);
        self.turned_rad += self.chunks.iter().map(turned_rad2).fold(0.0, f64::max).sqrt();
    }

    /// Elements whose boxes may meet `near`, ascending: those of the chunks whose boxes do.
    pub(crate) fn elements_near(&self, near: &Aabb) -> impl Iterator<Item = usize> + '_ {
        let near = *near;
        let met = self.chunks.iter().enumerate().filter(move |(_, chunk)| near.meets(&chunk.bounds()));
        let elements = self.base().elements.len();
        met.flat_map(move |(index, _)| index * CHUNK_ELEMENTS..elements.min((index + 1) * CHUNK_ELEMENTS))
    }

    /// The box around the nodes at the state that was last evaluated.
    #[must_use]
    pub fn bounds(&self) -> Aabb {
        Aabb::around(self.chunks.iter().map(ElementChunk::bounds).flat_map(|b| [b.min_m, b.max_m]))
    }

    /// Energies at the state that was last evaluated.
    #[must_use]
    pub fn energy(&self) -> BodyEnergy {
        let mut energy = BodyEnergy::default();
        // Lanes without an element have zero matrices and add nothing.
        for chunk in &self.chunks {
            energy.elastic_j += chunk.found.elastic_j.reduce_add();
            energy.kinetic_j += chunk.found.kinetic_j.reduce_add();
        }
        for (element, hold) in &self.holds {
            let u = self.corner_displacements(*element as usize);
            energy.hold_j += 0.5 * dot(&u, &hold_times(hold, &u));
        }
        energy
    }

    /// Sum of the elastic force at each node, N; what internal forces alone do. Forces on hanging nodes
    /// are handed to their masters.
    #[must_use]
    pub fn elastic_forces_n(&self) -> super::Nodal {
        let mut forces = vec![[0.0; 3]; self.node_count()];
        self.for_each_corner(|state, lane, corner, node| {
            (0..3).for_each(|i| forces[node][i] += state.force_n[3 * corner + i].as_array()[lane]);
        });
        self.gather_hanging(&mut forces);
        forces
    }

    /// Sum of the elastic force and the loads at each node, N.
    #[must_use]
    pub fn pull_n(&self) -> super::Nodal {
        let mut pull_n = self.elastic_forces_n();
        pull_n.iter_mut().zip(&self.external_n).for_each(|(f, load)| (0..3).for_each(|i| f[i] += load[i]));
        pull_n
    }

    /// What the elements' nodes carry under a constant stress, `-sum_e V sigma d_a`, N: the reference
    /// of the patch test.
    #[must_use]
    pub fn constant_stress_forces_n(&self, stress_pa: &crate::Mat3) -> super::Nodal {
        let mut forces = vec![[0.0; 3]; self.node_count()];
        for (element, data) in self.base().elements.iter().enumerate() {
            let (block, lane) = (&self.blocks[element / LANES], element % LANES);
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
    pub fn nodal_momentum(&self) -> super::Nodal {
        let mut momentum = vec![[0.0; 3]; self.node_count()];
        for (element, data) in self.base().elements.iter().enumerate() {
            for (a, &node) in data.nodes.iter().enumerate() {
                for (b, &other) in data.nodes.iter().enumerate() {
                    let mass = self.mass_between_kg(element, a, b);
                    let v = self.velocity_m_per_s[other as usize];
                    (0..3).for_each(|i| momentum[node as usize][i] += mass * v[i]);
                }
            }
        }
        momentum
    }

    /// Entry of an element's mass between two corners, kg.
    pub(super) fn mass_between_kg(&self, element: usize, a: usize, b: usize) -> f64 {
        self.blocks[element / LANES].shapes.mass_kg[corner_pair(a, b)].as_array()[element % LANES]
    }

    fn for_each_corner(&self, mut visit: impl FnMut(&crate::fem::corotation::ElementState, usize, usize, usize)) {
        for (element, data) in self.base().elements.iter().enumerate() {
            for (corner, &node) in data.nodes.iter().enumerate() {
                visit(&self.states[element / LANES], element % LANES, corner, node as usize);
            }
        }
    }

    /// What holds an element's voxels does at its corners, N.
    pub(super) fn hold_forces_n(&self, element: usize) -> [crate::Vec3; 8] {
        let Ok(found) = self.holds.binary_search_by_key(&(element as u32), |h| h.0) else {
            return Default::default();
        };
        hold_times(&self.holds[found].1, &self.corner_displacements(element)).map(|force| {
            let [x, y, z, _] = force.to_array();
            -Vec3::new(x, y, z)
        })
    }

    /// Displacements of an element's corners, m, xyz0.
    fn corner_displacements(&self, element: usize) -> [f64x4; 8] {
        self.base().elements[element].nodes.map(|n| {
            let u = Vec3::from(self.position_m[n as usize]) - self.rest_position_m(n as usize);
            f64x4::new([u.x, u.y, u.z, 0.0])
        })
    }

    /// Velocities of an element's corners, m/s, xyz0.
    fn corner_velocities(&self, element: usize) -> [f64x4; 8] {
        self.base().elements[element].nodes.map(|n| {
            let [x, y, z] = self.velocity_m_per_s[n as usize];
            f64x4::new([x, y, z, 0.0])
        })
    }

    /// `A_e = (1 + alpha dt) M + (dt^2 + beta dt) K' + dt^2 (s g K + H + T)` of one element, with the tangent
    /// `K' = K + (psi' - 1) K_G + psi'' / V f_G f_G^T`, into the solver's operator.
    pub(super) fn write_matrix(&mut self, element: usize) {
        let (block, state, lane) = (&self.blocks[element / LANES], &self.states[element / LANES], element % LANES);
        let dt = self.params.dt_s;
        let at = |v: &wide::f64x4| v.as_array()[lane];
        let mass_factor = 1.0 + dt * at(&block.alpha_per_s);
        let stiffness_factor = dt * (dt + at(&block.beta_s));
        let stiffening = at(&state.stiffening) - 1.0;
        let active = stiffening > STIFFENING_THRESHOLD;
        let curvature = if active { at(&state.curvature) } else { 0.0 };
        let branch_factor = block.viscosity.as_ref().map(|v| dt * dt * at(&v.tangent()));
        let hold = self.holds.binary_search_by_key(&(element as u32), |h| h.0).ok().map(|i| &self.holds[i].1);
        let geometric = self.geometric_stiffness(element);
        let mut packed = [0.0; crate::fem::lanes::PACKED];
        for_packed(|index, row, column| {
            let mut k = block.stiffness.at(index, lane);
            if active && let Some(data) = &block.stiffening {
                k += stiffening * data.galerkin.at(index, lane)
                    + curvature * at(&state.galerkin_force_n[row]) * at(&state.galerkin_force_n[column]);
            }
            packed[index] = stiffness_factor * k;
            if let Some(factor) = branch_factor {
                packed[index] += factor * block.stiffness.at(index, lane);
            }
            if row % 3 == column % 3 {
                let (a, b) = (row / 3, column / 3);
                let entry = a * (a + 1) / 2 + b;
                packed[index] += mass_factor * at(&block.shapes.mass_kg[entry]);
                packed[index] += hold.map_or(0.0, |h| dt * dt * h[entry]);
                packed[index] += geometric.map_or(0.0, |s| dt * dt * s.stiffness_n_per_m(a, b));
            }
        });
        self.applied_stiffening[element] = if active { 1.0 + stiffening } else { 1.0 };
        self.multigrid.operator_mut().set_matrix(element, &packed);
    }

    /// Rotations of all elements into the solver's operator.
    pub(super) fn write_rotations(&mut self, workers: &Workers<'_>) {
        const { assert!(OPERATOR_LANES == 2 * LANES) };
        let states = &self.states;
        workers.for_chunks(&mut self.multigrid.operator_mut().blocks[..], ROTATION_GRAIN, |first, blocks| {
            for (block, states) in blocks.iter_mut().zip(states[2 * first * BLOCKS_PER_CHUNK..].chunks(2)) {
                let (low, high) = (&states[0].rotation_matrix, &states[states.len() - 1].rotation_matrix);
                block.rotation = std::array::from_fn(|i| bytemuck::cast([low[i], high[i]]));
            }
        });
    }

    /// Brings the solver's operator and its preconditioner to the evaluated state.
    pub fn refresh_operator(&mut self, workers: &Workers<'_>) {
        self.scratch.stale_parents.clear();
        let mut rewritten = false;
        self.unsmoothed += self.follow_stress();
        if self.blocks.iter().any(|b| b.stiffening.is_some()) {
            for element in 0..self.base().elements.len() {
                let stiffening = self.states[element / LANES].stiffening.as_array()[element % LANES];
                let active = stiffening - 1.0 > STIFFENING_THRESHOLD;
                if active || self.applied_stiffening[element] != 1.0 {
                    self.write_matrix(element);
                    rewritten = true;
                }
                let ratio = self.applied_stiffening[element] / self.coarse_stiffening[element];
                if !(1.0 / COARSE_STIFFENING_FACTOR..=COARSE_STIFFENING_FACTOR).contains(&ratio) {
                    self.coarse_stiffening[element] = self.applied_stiffening[element];
                    if let Some(above) = self.levels.get(1) {
                        self.scratch.stale_parents.push(above.owner[element]);
                    }
                }
            }
        }
        if !self.scratch.stale_parents.is_empty() {
            let parents = &mut self.scratch.stale_parents;
            parents.sort_unstable();
            parents.dedup();
            self.multigrid.rebuild_coarse(parents);
        }
        self.write_rotations(workers);
        self.multigrid.update_rotations(workers);
        if rewritten || self.turned_rad > MOST_TURNED_RAD || self.unsmoothed > MOST_UNSMOOTHED {
            self.multigrid.update_diagonals(workers);
            (self.turned_rad, self.unsmoothed) = (0.0, 0.0);
        }
    }

    /// Writes `dt (f_elastic + f_external + f_hold - drag)` at every node: the right side but for
    /// contact.
    pub fn assemble_right_side(&mut self, workers: &Workers<'_>) {
        let dt = self.params.dt_s;
        let mut b = std::mem::take(&mut self.scratch.right_side);
        let (assembly, external_n) = (self.multigrid.operator().assembly(), &self.external_n);
        let balance_n = &self.balance_n;
        workers.for_chunks(&mut b[..], NODE_GRAIN, |first, b| {
            for (node, b) in (first * NODES_PER_CHUNK..).zip(b) {
                let entries = assembly.entries(node).iter();
                let sum = entries.fold(f64x4::ZERO, |sum, entry| sum + balance_n[*entry as usize]).to_array();
                *b = [0, 1, 2].map(|i| dt * (sum[i] + external_n[node][i]));
            }
        });
        for (element, hold) in &self.holds {
            // The hold acts at the end of the step: its displacement includes dt v.
            let (u, v) = (self.corner_displacements(*element as usize), self.corner_velocities(*element as usize));
            let ahead = std::array::from_fn(|a| f64x4::splat(dt).mul_add(v[a], u[a]));
            let nodes = self.base().elements[*element as usize].nodes;
            for (node, force) in nodes.into_iter().zip(hold_times(hold, &ahead)) {
                let force = force.to_array();
                (0..3).for_each(|i| b[node as usize][i] -= dt * force[i]);
            }
        }
        for (nodes, pulls) in self.geometric_pulls() {
            for (node, pull) in nodes.into_iter().zip(pulls) {
                (0..3).for_each(|i| b[node][i] -= dt * dt * pull[i]);
            }
        }
        self.gather_hanging(&mut b);
        self.scratch.right_side = b;
    }

    /// Hands what acts on hanging nodes to their masters.
    pub(super) fn gather_hanging(&self, forces: &mut super::Nodal) {
        for hanging in self.multigrid.operator().hanging() {
            let force = std::mem::take(&mut forces[hanging.node as usize]);
            for (master, w) in hanging.masters {
                (0..3).for_each(|i| forces[master as usize][i] += f64::from(w) * force[i]);
            }
        }
    }

    /// Takes the step with a change of velocity: `v += dv`, `x += dt v`, and what turns freely turns. Returns the
    /// work of the external loads, gravity included, J.
    pub fn integrate(&mut self, workers: &Workers<'_>, velocity_change: &super::Nodal) -> f64 {
        let dt = self.params.dt_s;
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
        let (x, v) = (&mut self.position_m[..], &mut self.velocity_m_per_s[..]);
        let data = (x, v, &velocity_change[..], &self.external_n[..]);
        let work_j = workers.reduce_chunks(data, NODE_GRAIN, integrate, |a, b| a + b);
        self.turn_positions();
        work_j
    }

    /// Work of the external loads, gravity included, over nodal displacements, J.
    #[must_use]
    pub fn external_work_j(&self, displacement_m: impl Iterator<Item = [f64; 3]>) -> f64 {
        self.external_n.iter().zip(displacement_m).map(|(f, u)| (0..3).map(|i| f[i] * u[i]).sum::<f64>()).sum()
    }
}

/// `H u` on each axis, for the 8x8 matrix of what holds an element.
fn hold_times(hold: &[f64; 36], u: &[f64x4; 8]) -> [f64x4; 8] {
    let mut pull = [f64x4::ZERO; 8];
    for a in 0..8 {
        let row = &hold[a * (a + 1) / 2..=a * (a + 3) / 2];
        for b in 0..a {
            let entry = f64x4::splat(row[b]);
            pull[a] = entry.mul_add(u[b], pull[a]);
            pull[b] = entry.mul_add(u[a], pull[b]);
        }
        pull[a] = f64x4::splat(row[a]).mul_add(u[a], pull[a]);
    }
    pull
}

fn dot(a: &[f64x4; 8], b: &[f64x4; 8]) -> f64 {
    a.iter().zip(b).fold(f64x4::ZERO, |sum, (a, b)| a.mul_add(*b, sum)).reduce_add()
}
