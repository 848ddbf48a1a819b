//! One level of the cycle: its operator, its smoother, and the way to the level above it and back.
//!
//! The smoother is the 4th-kind Chebyshev iteration (Lottes 2023) with optimised weights on the
//! block-diagonal-scaled matrix.

use super::diagonal::Diagonal;
use super::lists::Lists;
use super::operator::{Operator, masters_of};
use super::vectors::{NODE_GRAIN, NODES_PER_CHUNK, NodeVector, dot};
use crate::fem::composite::shape_functions;
use crate::fem::packed::PackedMatrix;
use crate::grid::levels::{Element, HangingNode, Level};
use crate::grow::grow;
use crate::walk::Kept;
use crate::workers::Workers;
use wide::{f32x4, f32x8};

/// Optimised weights of the 4th-kind Chebyshev smoother of degree 2 (Lottes, Numer. Linear Algebra Appl. 30, 2023,
/// e2518).
const CHEBYSHEV_BETA: [f32; 2] = [1.023_872_9, 1.264_089_1];
/// Safety on the estimated largest eigenvalue, which the power iteration approaches from below. Below 1 the cycle may
/// turn indefinite, which [`super::pcg`] mends by widening the spectrum; above it smooths less. Only iterations
/// depend on it.
const EIGENVALUE_MARGIN: f32 = 1.12;
/// Power iterations of the estimate, which is made once per level and topology: with 20 it is within the margin
/// above.
const POWER_ITERATIONS: u32 = 20;

/// Interpolation of one node from the level above.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Prolongation {
    nodes: [u32; 8],
    weights: [f32; 8],
    count: u8,
}

/// One level of the cycle.
#[derive(Clone)]
pub(super) struct CycleLevel {
    pub(super) operator: Operator,
    /// To the level above; empty on the coarsest.
    pub(super) prolongation: Vec<Prolongation>,
    /// Its transpose: nodes of this level and their weights, for each node of the level above.
    pub(super) restriction: Lists<(u32, f32)>,
    /// For each node an element that has it, and as which corner.
    corner_of: Vec<(u32, u8)>,
    /// Element of the level above for each element.
    pub(super) parent: Vec<u32>,
    /// Elements of this level for each element of the level above.
    pub(super) children: Lists<u32>,
    pub(super) place: Vec<Place>,
    pub(super) largest_eigenvalue: f32,
    /// Right side: on the finest level the residual of the solve.
    pub(super) b: NodeVector,
    /// What the cycle makes of it.
    pub(super) x: NodeVector,
    r: NodeVector,
    step: NodeVector,
}

/// Where an element lies in its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Place {
    /// One of the eight parts of a parent of twice its size.
    Octant(u8),
    /// The parent has the same cell.
    Same,
}

impl Place {
    fn of(child: &Element, parent: &Element) -> Self {
        // The parent's lattice is twice as coarse.
        if child.size == 2 * parent.size {
            return Self::Same;
        }
        let bit = |a: usize| ((child.cell[a] & 1) as u8) << a;
        Self::Octant(bit(0) | bit(1) | bit(2))
    }

    /// Weights of each corner of the child among the parent's corners.
    fn weights(self) -> [[f64; 8]; 8] {
        let (octant, scale) = match self {
            Self::Octant(octant) => (octant, 0.5),
            Self::Same => (0, 1.0),
        };
        std::array::from_fn(|c| {
            shape_functions([0, 1, 2].map(|a| scale * f64::from((octant >> a & 1) + (c as u8 >> a & 1))))
        })
    }
}

impl CycleLevel {
    pub(super) fn new(level: &Level) -> Self {
        Self::of(Operator::new(level))
    }

    /// What of a level follows the state with a lag, and nothing else.
    pub(super) fn lagging(
        largest_eigenvalue: f32,
        diagonal: Kept<Diagonal>,
        matrices: Option<Vec<PackedMatrix<f32x8>>>,
    ) -> Self {
        let operator = Operator::lagging(diagonal, matrices.unwrap_or_default());
        Self { largest_eigenvalue, ..Self::of(operator) }
    }

    /// Takes what of `read` follows the state with a lag.
    pub(super) fn take_lag(&mut self, read: Self) {
        self.largest_eigenvalue = read.largest_eigenvalue;
        self.operator.take_lag(read.operator);
    }

    fn of(operator: Operator) -> Self {
        Self {
            operator,
            prolongation: Vec::new(),
            restriction: Lists::default(),
            corner_of: Vec::new(),
            parent: Vec::new(),
            children: Lists::default(),
            place: Vec::new(),
            largest_eigenvalue: 1.0,
            x: Vec::new(),
            b: Vec::new(),
            r: Vec::new(),
            step: Vec::new(),
        }
    }

    /// Takes the connectivity of a level and the one above it, of which the elements in `changed`, of
    /// both, are new or have other nodes; `None`: all. Returns the chunks of the operator that changed.
    pub(super) fn set_topology(
        &mut self,
        level: &Level,
        above: Option<&Level>,
        changed: Option<[&[u32]; 2]>,
    ) -> Vec<usize> {
        let nodes = level.nodes.len();
        let renumbered = self.operator.set_topology(level, changed.map(|c| c[0]));
        for v in [&mut self.x, &mut self.b, &mut self.r, &mut self.step] {
            grow(v, nodes, f32x4::ZERO);
        }
        let Some(above) = above else { return renumbered };
        grow(&mut self.corner_of, nodes, (0, 0));
        self.parent.clone_from(&above.owner);
        let parents = self.parent.iter().zip(0..).map(|(parent, child)| (*parent, child));
        self.children.fill(above.elements.len(), parents);
        grow(&mut self.place, level.elements.len(), Place::Same);
        grow(&mut self.prolongation, nodes, Prolongation::default());
        let hanging_above: Vec<HangingNode> = above.hanging().collect();
        match changed {
            Some([own, parents]) if !level.is_graded() => {
                let children = parents.iter().flat_map(|p| self.children.list(*p as usize));
                let mut elements: Vec<u32> = own.iter().chain(children).copied().collect();
                elements.sort_unstable();
                elements.dedup();
                elements.into_iter().for_each(|e| self.interpolate(level, above, &hanging_above, e as usize));
            }
            _ => (0..level.elements.len()).for_each(|e| self.interpolate(level, above, &hanging_above, e)),
        }
        let entries = self.prolongation.iter().zip(0..);
        let transposed = entries.flat_map(|(p, node)| p.iter().map(move |(above, w)| (above as u32, (node, w))));
        self.restriction.fill(above.nodes.len(), transposed);
        renumbered
    }

    /// Where an element lies in its parent, and what its nodes take from the parent's.
    fn interpolate(&mut self, level: &Level, above: &Level, hanging_above: &[HangingNode], element: usize) {
        let (data, parent) = (&level.elements[element], &above.elements[above.owner[element] as usize]);
        self.place[element] = Place::of(data, parent);
        let weights = self.place[element].weights();
        for (corner, &node) in data.nodes.iter().enumerate() {
            self.corner_of[node as usize] = (element as u32, corner as u8);
            let takes = level.hanging_node(node).is_none();
            self.prolongation[node as usize] = if takes {
                Prolongation::new(&parent.nodes, &weights[corner], hanging_above)
            } else {
                Prolongation::default()
            };
        }
    }

    /// Weights of an element's corners among the corners of its parent. A corner that hangs goes with its masters.
    pub(super) fn weights(&self, element: usize, above: &Operator) -> [[f64; 8]; 8] {
        let mut weights = self.place[element].weights();
        for (weights, &node) in weights.iter_mut().zip(self.operator.element_nodes(element)) {
            if self.operator.hangs(node) {
                *weights = self.weights_of_masters(node, element, above);
            }
        }
        weights
    }

    /// What a hanging node takes from the corners of the parent of `element` through its masters.
    fn weights_of_masters(&self, node: u32, element: usize, above: &Operator) -> [f64; 8] {
        let parent_nodes = |element: usize| above.element_nodes(self.parent[element] as usize);
        let mut weights = [0.0; 8];
        let masters = masters_of(self.operator.hanging(), node as usize);
        for (master, share) in masters {
            let (with_master, corner) = self.corner_of[master];
            let of_master = self.place[with_master as usize].weights()[usize::from(corner)];
            for (above, weight) in parent_nodes(with_master as usize).iter().zip(of_master) {
                if let Some(own) = parent_nodes(element).iter().position(|node| node == above) {
                    weights[own] += f64::from(share) * weight;
                }
            }
        }
        weights
    }

    /// Estimates the largest eigenvalue of `D^-1 A` by power iterations.
    pub(super) fn estimate_eigenvalue(&mut self, workers: &Workers<'_>) {
        // Any start with all frequencies in it; the same one every time.
        let start = |node: usize| {
            let h = (node as u32).wrapping_mul(2_654_435_761);
            let [x, y, z] = [0, 8, 16].map(|s| (h >> s & 255) as f32 / 128.0 - 1.0);
            f32x4::new([x, y, z, 0.0])
        };
        let mut eigenvector: NodeVector = (0..self.operator.node_count()).map(start).collect();
        for _ in 0..POWER_ITERATIONS {
            self.operator.apply(workers, &eigenvector, &mut self.r);
            let operator = &self.operator;
            workers.for_chunks((&self.r[..], &mut self.step[..]), NODE_GRAIN, |chunk, (r, step)| {
                for (node, (r, step)) in (chunk * NODES_PER_CHUNK..).zip(r.iter().zip(step)) {
                    *step = operator.precondition_node(node, *r);
                }
            });
            let along = dot(workers, &self.step, &self.r);
            let size = dot(workers, &self.step, &self.step).sqrt();
            let norm = dot(workers, &eigenvector, &self.r);
            if size == 0.0 || norm <= 0.0 {
                return;
            }
            // Rayleigh quotient of the next vector's energy: between the last two power steps.
            self.largest_eigenvalue = EIGENVALUE_MARGIN * (along / norm) as f32;
            let scale = f32x4::splat((1.0 / size) as f32);
            workers.for_chunks((&mut eigenvector[..], &self.step[..]), NODE_GRAIN, |_, (v, step)| {
                v.iter_mut().zip(step).for_each(|(v, s)| *v = *s * scale);
            });
        }
    }

    /// Chebyshev steps on `A x = b`; `x` starts from zero where `fresh`.
    pub(super) fn smooth(&mut self, workers: &Workers<'_>, fresh: bool) {
        for (index, beta) in CHEBYSHEV_BETA.iter().enumerate() {
            let from_zero = fresh && index == 0;
            if !from_zero {
                self.operator.multiply(workers, &self.x);
            }
            let k = (index + 1) as f32;
            let gain = f32x4::splat((8.0 * k - 4.0) / ((2.0 * k + 1.0) * self.largest_eigenvalue));
            let carry = f32x4::splat((2.0 * k - 3.0) / (2.0 * k + 1.0));
            let beta = f32x4::splat(*beta);
            let operator = &self.operator;
            let data = (&self.b[..], &mut self.step[..], &mut self.x[..]);
            workers.for_chunks(data, NODE_GRAIN, |chunk, (b, step, x)| {
                for (node, ((b, step), x)) in (chunk * NODES_PER_CHUNK..).zip(b.iter().zip(step).zip(x)) {
                    let r = if from_zero { *b } else { *b - operator.product_at(node) };
                    let z = gain * operator.precondition_node(node, r);
                    // The old step is not read at the first index, nor the old x where it is to be zero:
                    // they may belong to another solve.
                    *step = if index == 0 { z } else { carry.mul_add(*step, z) };
                    let from = if from_zero { f32x4::ZERO } else { *x };
                    *x = beta.mul_add(*step, from);
                }
            });
        }
    }

    /// `b = P^T (b - A x)` on the level above.
    pub(super) fn restrict(&mut self, workers: &Workers<'_>, above: &mut [f32x4]) {
        self.operator.multiply(workers, &self.x);
        let operator = &self.operator;
        workers.for_chunks((&self.b[..], &mut self.r[..]), NODE_GRAIN, |chunk, (b, r)| {
            for (node, (b, r)) in (chunk * NODES_PER_CHUNK..).zip(b.iter().zip(r)) {
                *r = *b - operator.product_at(node);
            }
        });
        let (restriction, r) = (&self.restriction, &self.r);
        workers.for_chunks(above, NODE_GRAIN, |chunk, above| {
            for (node, b) in (chunk * NODES_PER_CHUNK..).zip(above) {
                let terms = restriction.list(node).iter();
                *b = terms.fold(f32x4::ZERO, |sum, &(node, w)| f32x4::splat(w).mul_add(r[node as usize], sum));
            }
        });
    }

    /// `x += P x` from the level above.
    pub(super) fn prolongate(&mut self, workers: &Workers<'_>, above: &[f32x4]) {
        workers.for_chunks((&self.prolongation[..], &mut self.x[..]), NODE_GRAIN, |_, (prolongation, x)| {
            for (entry, x) in prolongation.iter().zip(x) {
                *x = entry.iter().fold(*x, |sum, (node, w)| f32x4::splat(w).mul_add(above[node], sum));
            }
        });
    }
}

impl Prolongation {
    /// From the corners of a parent, or from what moves those of them that hang.
    fn new(parent_nodes: &[u32; 8], weights: &[f64; 8], hanging: &[HangingNode]) -> Self {
        let mut entry = Self::default();
        for (node, weight) in parent_nodes.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            masters_of(hanging, *node as usize).for_each(|(node, w)| entry.add(node as u32, w * *weight as f32));
        }
        entry
    }

    fn add(&mut self, node: u32, weight: f32) {
        let count = self.count as usize;
        match self.nodes[..count].iter().position(|n| *n == node) {
            Some(found) => self.weights[found] += weight,
            // More than eight move it only where cuts meet at several hanging nodes; it preconditions.
            None if count == self.nodes.len() => {}
            None => {
                (self.nodes[count], self.weights[count]) = (node, weight);
                self.count += 1;
            }
        }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, f32)> + Clone + '_ {
        let count = self.count as usize;
        self.nodes[..count].iter().zip(&self.weights[..count]).map(|(node, w)| (*node as usize, *w))
    }
}
