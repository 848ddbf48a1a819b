//! The system matrix of one level, `A = sum_e R_e A_e R_e^T + contacts`, eight elements at a time.
//!
//! `A_e = (1 + alpha dt) M_e + (dt^2 + beta dt) (K_e + H_e)`: mass, stiffness and held voxels. Element
//! results go to a buffer of their own and each node sums its entries in a fixed order, so the bits
//! do not depend on the number of threads and no colouring is needed. Node vectors are padded to four
//! components: a node is one load, and eight nodes become lanes by a transpose in registers.
//!
//! Hanging nodes are no unknowns: the system is `Z^T A Z` with Z the interpolation of all nodes from the
//! others. A vector of unknowns carries at hanging nodes what its masters say, a vector of forces zero.

use super::spring::{POINT_NODES, PointSpring};
use crate::fem::lanes::{self, PACKED};
use crate::fem::packed::PackedMatrix;
use crate::grid::levels::{HangingNode, Level};
use crate::workers::Workers;
use wide::{f32x4, f32x8};

/// Elements per block.
pub const LANES: usize = 8;
/// Blocks per chunk of parallel work.
const BLOCKS_PER_CHUNK: usize = 64;
/// Nodes per chunk of parallel work.
pub const NODES_PER_CHUNK: usize = 512;

/// A vector with three components per node; the fourth is zero.
pub type NodeVector = Vec<f32x4>;

/// Eight elements.
#[derive(Clone)]
pub struct OperatorBlock {
    /// `A_e` in the rest frame.
    matrix: PackedMatrix<f32x8>,
    /// Rotation of each element, row-major.
    pub rotation: [f32x8; 9],
    nodes: [[u32; LANES]; 8],
}

/// Diagonal 3x3 blocks of every node: symmetric, so six entries.
#[derive(Default)]
struct Diagonal {
    /// xx, yy, zz.
    on: NodeVector,
    /// xy, xz, yz.
    off: NodeVector,
}

/// One level's system matrix.
pub struct Operator {
    /// Blocks of elements, by element id.
    pub blocks: Vec<OperatorBlock>,
    /// Springs that act now.
    springs: Vec<PointSpring>,
    element_nodes: Vec<[u32; 8]>,
    hanging: Vec<HangingNode>,
    /// Entries of node n are `incidence[first[n]..first[n + 1]]`, each `element * 8 + corner`.
    first: Vec<u32>,
    incidence: Vec<u32>,
    /// Of the elements alone.
    diagonal: Diagonal,
    /// Of the springs alone; zero but while they are summed.
    spring_diagonal: Diagonal,
    /// Nodes that carry springs.
    sprung: Vec<u32>,
    /// Columns of the inverse diagonal block of each node.
    inverse: Vec<[f32x4; 3]>,
    /// Result of every corner, by element.
    results: Vec<[f32x4; 8 * LANES]>,
}

impl OperatorBlock {
    fn new() -> Self {
        let (zero, one) = (f32x8::ZERO, f32x8::ONE);
        Self {
            matrix: PackedMatrix::default(),
            rotation: [one, zero, zero, zero, one, zero, zero, zero, one],
            nodes: [[0; LANES]; 8],
        }
    }

    #[inline(always)]
    fn gather(&self, x: &[f32x4]) -> [f32x8; 24] {
        let mut out = [f32x8::ZERO; 24];
        for (corner, nodes) in self.nodes.iter().enumerate() {
            let mut points = [f32x4::ZERO; LANES];
            for (point, node) in points.iter_mut().zip(nodes) {
                *point = x[*node as usize];
            }
            out[3 * corner..3 * corner + 3].copy_from_slice(&lanes::split(points));
        }
        out
    }

    /// `R A_e R^T x` of every lane.
    #[inline(always)]
    fn apply(&self, x: &[f32x4]) -> [f32x8; 24] {
        let u = lanes::rotate_back(&self.rotation, &self.gather(x));
        lanes::rotate(&self.rotation, &self.matrix.apply(&u))
    }

    /// Rows of the diagonal block of a corner in the rest frame.
    #[inline(always)]
    fn corner_block(&self, corner: usize) -> [[f32x8; 3]; 3] {
        let start = lanes::diagonal_entry(corner);
        let m: [f32x8; 6] = std::array::from_fn(|i| self.matrix.entry(start + i));
        [[m[0], m[1], m[3]], [m[1], m[2], m[4]], [m[3], m[4], m[5]]]
    }

    /// `(R B R^T)_ij` of each corner's diagonal block B for three pairs (i, j).
    #[inline(always)]
    fn rotated_diagonal(&self, entries: [(usize, usize); 3]) -> [f32x8; 24] {
        let row = |i: usize| [self.rotation[3 * i], self.rotation[3 * i + 1], self.rotation[3 * i + 2]];
        let dot = |a: [f32x8; 3], b: [f32x8; 3]| a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]));
        let mut out = [f32x8::ZERO; 24];
        for corner in 0..8 {
            let block = self.corner_block(corner);
            for (slot, (i, j)) in entries.into_iter().enumerate() {
                out[3 * corner + slot] = dot(block.map(|b| dot(b, row(i))), row(j));
            }
        }
        out
    }
}

impl Operator {
    /// An operator over the elements of `level`, all matrices zero.
    #[must_use]
    pub fn new(level: &Level) -> Self {
        let mut operator = Self {
            blocks: Vec::new(),
            springs: Vec::new(),
            element_nodes: Vec::new(),
            hanging: Vec::new(),
            first: Vec::new(),
            incidence: Vec::new(),
            diagonal: Diagonal::default(),
            spring_diagonal: Diagonal::default(),
            sprung: Vec::new(),
            inverse: Vec::new(),
            results: Vec::new(),
        };
        operator.set_topology(level);
        operator
    }

    /// Number of nodes.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.inverse.len()
    }

    /// Number of elements.
    #[must_use]
    pub fn element_count(&self) -> usize {
        self.element_nodes.len()
    }

    /// Takes new connectivity; matrices of elements that were there before are kept.
    pub fn set_topology(&mut self, level: &Level) {
        let element_nodes: Vec<[u32; 8]> = level.elements.iter().map(|e| e.nodes).collect();
        let node_count = level.nodes.len();
        self.hanging.clear();
        self.hanging.extend(level.hanging());
        let blocks = element_nodes.len().div_ceil(LANES);
        self.blocks.resize_with(blocks, OperatorBlock::new);
        self.results.resize(blocks, [f32x4::ZERO; 8 * LANES]);
        self.inverse.resize(node_count, [f32x4::ZERO; 3]);
        self.diagonal.resize(node_count);
        self.spring_diagonal.resize(node_count);
        self.springs.clear();
        self.sprung.clear();
        self.first.clear();
        self.first.resize(node_count + 1, 0);
        for (element, nodes) in element_nodes.iter().enumerate() {
            for (corner, &node) in nodes.iter().enumerate() {
                self.blocks[element / LANES].nodes[corner][element % LANES] = node;
                self.first[node as usize] += 1;
            }
        }
        let mut end = 0;
        for first in &mut self.first {
            end += *first;
            *first = end;
        }
        // Filled from the back, the ends become the beginnings.
        self.incidence.resize(8 * element_nodes.len(), 0);
        for (element, nodes) in element_nodes.iter().enumerate().rev() {
            for (corner, &node) in nodes.iter().enumerate().rev() {
                self.first[node as usize] -= 1;
                self.incidence[self.first[node as usize] as usize] = (8 * element + corner) as u32;
            }
        }
        self.element_nodes = element_nodes;
    }

    /// Nodes of an element.
    #[must_use]
    pub fn element_nodes(&self, element: usize) -> &[u32; 8] {
        &self.element_nodes[element]
    }

    /// The elements around a node, and which corner of each the node is, ascending.
    pub fn corners_at(&self, node: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let range = self.first[node] as usize..self.first[node + 1] as usize;
        self.incidence[range].iter().map(|entry| (*entry as usize / 8, *entry as usize % 8))
    }

    /// Sets the packed matrix of an element.
    pub fn set_matrix(&mut self, element: usize, packed: &[f64; PACKED]) {
        self.blocks[element / LANES].matrix.set(element % LANES, packed);
    }

    /// Stores once what blocks have in common.
    pub fn share_matrices(&mut self) {
        let mut shared = Vec::new();
        self.blocks.iter_mut().for_each(|b| b.matrix.share(&mut shared));
    }

    /// The packed matrix of an element, as set.
    #[must_use]
    pub fn matrix(&self, element: usize) -> [f64; PACKED] {
        let (block, lane) = (&self.blocks[element / LANES], element % LANES);
        std::array::from_fn(|i| block.matrix.at(i, lane))
    }

    /// Sets the rotation of an element, row-major.
    pub fn set_rotation(&mut self, element: usize, rotation: &[f64; 9]) {
        let (block, lane) = (&mut self.blocks[element / LANES], element % LANES);
        for (slot, value) in block.rotation.iter_mut().zip(rotation) {
            slot.as_mut_array()[lane] = *value as f32;
        }
    }

    /// The rotation of an element, row-major.
    #[must_use]
    pub fn rotation(&self, element: usize) -> [f64; 9] {
        let (block, lane) = (&self.blocks[element / LANES], element % LANES);
        std::array::from_fn(|i| f64::from(block.rotation[i].as_array()[lane]))
    }

    /// `y = A x`.
    pub fn apply(&mut self, workers: &Workers<'_>, x: &[f32x4], y: &mut [f32x4]) {
        self.evaluate_blocks(workers, |block| block.apply(x));
        self.sum_at_nodes(workers, y);
        for spring in &self.springs {
            spring.add_to(x, y);
        }
        self.gather_hanging(y);
    }

    /// Nodes that hang, ascending.
    #[must_use]
    pub fn hanging(&self) -> &[HangingNode] {
        &self.hanging
    }

    /// `y = Z^T y`: what acts on hanging nodes acts on their masters.
    pub fn gather_hanging(&self, y: &mut [f32x4]) {
        for hanging in &self.hanging {
            let force = std::mem::take(&mut y[hanging.node as usize]);
            for (master, w) in hanging.masters {
                y[master as usize] = f32x4::splat(w).mul_add(force, y[master as usize]);
            }
        }
    }

    /// `x = Z x`: hanging nodes go where their masters take them.
    pub fn place_hanging(&self, x: &mut [f32x4]) {
        for hanging in &self.hanging {
            x[hanging.node as usize] = hanging
                .masters
                .iter()
                .fold(f32x4::ZERO, |sum, (master, w)| f32x4::splat(*w).mul_add(x[*master as usize], sum));
        }
    }

    fn evaluate_blocks(&mut self, workers: &Workers<'_>, evaluate: impl Fn(&OperatorBlock) -> [f32x8; 24] + Sync) {
        let Self { blocks, results, .. } = self;
        workers.for_chunks(results, BLOCKS_PER_CHUNK, |chunk, results| {
            for (result, block) in results.iter_mut().zip(&blocks[chunk * BLOCKS_PER_CHUNK..]) {
                let y = evaluate(block);
                for corner in 0..8 {
                    let vectors = lanes::join([y[3 * corner], y[3 * corner + 1], y[3 * corner + 2]]);
                    (0..LANES).for_each(|lane| result[8 * lane + corner] = vectors[lane]);
                }
            }
        });
    }

    fn sum_at_nodes(&self, workers: &Workers<'_>, y: &mut [f32x4]) {
        let results = self.results.as_flattened();
        workers.for_chunks(y, NODES_PER_CHUNK, |chunk, y| {
            let first = &self.first[chunk * NODES_PER_CHUNK..];
            for (value, range) in y.iter_mut().zip(first.windows(2)) {
                let entries = &self.incidence[range[0] as usize..range[1] as usize];
                *value = entries.iter().fold(f32x4::ZERO, |sum, &entry| sum + results[entry as usize]);
            }
        });
    }

    /// Recomputes the inverse diagonal blocks from matrices and rotations. Springs are dropped.
    pub fn update_diagonal(&mut self, workers: &Workers<'_>) {
        let mut diagonal = std::mem::take(&mut self.diagonal);
        self.evaluate_blocks(workers, |block| block.rotated_diagonal([(0, 0), (1, 1), (2, 2)]));
        self.sum_at_nodes(workers, &mut diagonal.on);
        self.evaluate_blocks(workers, |block| block.rotated_diagonal([(0, 1), (0, 2), (1, 2)]));
        self.sum_at_nodes(workers, &mut diagonal.off);
        for hanging in &self.hanging {
            // Without the entries between a node and its masters: they would make it smaller.
            for v in [&mut diagonal.on, &mut diagonal.off] {
                let own = std::mem::take(&mut v[hanging.node as usize]);
                hanging.masters.iter().for_each(|(master, w)| v[*master as usize] += f32x4::splat(w * w) * own);
            }
        }
        self.diagonal = diagonal;
        self.springs.clear();
        self.sprung.clear();
        for (first, inverse) in self.inverse.chunks_mut(LANES).enumerate() {
            let at = |v: &NodeVector| -> [f32x4; LANES] {
                std::array::from_fn(|i| v.get(first * LANES + i).copied().unwrap_or_default())
            };
            let inverted = invert(at(&self.diagonal.on), at(&self.diagonal.off));
            inverse.copy_from_slice(&inverted[..inverse.len()]);
        }
    }

    /// Room for `count` springs.
    pub fn reserve_springs(&mut self, count: usize) {
        self.springs.clear();
        self.springs.reserve(count);
        self.sprung.reserve(POINT_NODES * count);
    }

    /// Springs that act now.
    #[must_use]
    pub fn springs(&self) -> &[PointSpring] {
        &self.springs
    }

    /// Replaces the springs; costs in proportion to the nodes that carry one or carried one.
    pub fn set_springs(&mut self, springs: impl Iterator<Item = PointSpring>) {
        self.springs.clear();
        self.springs.extend(springs);
        let mut sprung = std::mem::take(&mut self.sprung);
        self.invert_at(&sprung);
        sprung.clear();
        for spring in &self.springs {
            let [on, off] = spring.diagonal();
            let spring = if self.hanging.is_empty() { *spring } else { spring.coarsened(|node| self.masters_of(node)) };
            for (node, w) in spring.entries() {
                let square = f32x4::splat(w * w);
                if self.spring_diagonal.on[node] == f32x4::ZERO {
                    sprung.push(node as u32);
                }
                self.spring_diagonal.on[node] += square * on;
                self.spring_diagonal.off[node] += square * off;
            }
        }
        self.invert_at(&sprung);
        for &node in &sprung {
            self.spring_diagonal.on[node as usize] = f32x4::ZERO;
            self.spring_diagonal.off[node as usize] = f32x4::ZERO;
        }
        self.sprung = sprung;
    }

    /// The unknowns that move a node, and how much.
    fn masters_of(&self, node: usize) -> impl Iterator<Item = (usize, f32)> {
        let masters = match self.hanging.binary_search_by_key(&(node as u32), |h| h.node) {
            Ok(found) => self.hanging[found].masters,
            Err(_) => [(node as u32, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)],
        };
        masters.into_iter().filter(|(_, w)| *w != 0.0).map(|(master, w)| (master as usize, w))
    }

    fn invert_at(&mut self, nodes: &[u32]) {
        for nodes in nodes.chunks(LANES) {
            let sum = |a: &NodeVector, b: &NodeVector| -> [f32x4; LANES] {
                std::array::from_fn(|i| nodes.get(i).map_or(f32x4::ZERO, |&n| a[n as usize] + b[n as usize]))
            };
            let on = sum(&self.diagonal.on, &self.spring_diagonal.on);
            let off = sum(&self.diagonal.off, &self.spring_diagonal.off);
            for (&node, inverse) in nodes.iter().zip(invert(on, off)) {
                self.inverse[node as usize] = inverse;
            }
        }
    }

    /// `D^-1 r` at a node.
    #[inline(always)]
    #[must_use]
    pub fn precondition_node(&self, node: usize, r: f32x4) -> f32x4 {
        times(&self.inverse[node], r)
    }
}

impl Diagonal {
    fn resize(&mut self, nodes: usize) {
        self.on.resize(nodes, f32x4::ZERO);
        self.off.resize(nodes, f32x4::ZERO);
    }
}

/// `B v` of a 3x3 block given by its columns.
#[inline(always)]
pub(super) fn times(columns: &[f32x4; 3], v: f32x4) -> f32x4 {
    let [x, y, z, _] = v.to_array();
    columns[0].mul_add(f32x4::splat(x), columns[1].mul_add(f32x4::splat(y), columns[2] * f32x4::splat(z)))
}

/// Inverses of eight symmetric blocks given by diagonals (xx, yy, zz) and the rest (xy, xz, yz).
/// A node that carries nothing stays where it is: its inverse is zero.
#[inline(always)]
fn invert(on: [f32x4; LANES], off: [f32x4; LANES]) -> [[f32x4; 3]; LANES] {
    let ([xx, yy, zz], [xy, xz, yz]) = (lanes::split(on), lanes::split(off));
    // Of order one: the cube of a stiff matrix under a long time step is beyond f32.
    let trace = xx + yy + zz;
    let scale = f32x8::ONE / trace.simd_gt(f32x8::ZERO).bitselect(trace, f32x8::ONE);
    let [xx, yy, zz, xy, xz, yz] = [xx, yy, zz, xy, xz, yz].map(|v| v * scale);
    let (c00, c01, c02) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
    let det = xx * c00 + xy * c01 + xz * c02;
    let carries = det.simd_gt(f32x8::ZERO);
    let s = carries.bitselect(f32x8::ONE / carries.bitselect(det, f32x8::ONE), f32x8::ZERO);
    let (c11, c12, c22) = (xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy);
    let columns = [[c00, c01, c02], [c01, c11, c12], [c02, c12, c22]].map(|c| lanes::join(c.map(|v| v * s * scale)));
    std::array::from_fn(|lane| columns.map(|c| c[lane]))
}
