//! The system matrix of one level, `A = sum_e R_e A_e R_e^T + contacts`, sixteen elements at a time.
//!
//! `A_e = (1 + alpha dt) M_e + (dt^2 + beta dt) (K_e + H_e)`: mass, stiffness and held voxels. Element
//! results go to a buffer of their own and each node sums its entries in a fixed order, so the bits
//! do not depend on the number of threads and no colouring is needed.

use crate::fem::lanes::{self, PACKED};
use crate::workers::Workers;
use wide::f32x16;

/// Elements per block.
pub const LANES: usize = 16;
/// Blocks per chunk of parallel work.
const BLOCKS_PER_CHUNK: usize = 16;
/// Nodes per chunk of parallel work.
pub const NODES_PER_CHUNK: usize = 512;

/// A vector with three components per node.
pub type NodeVector = Vec<[f32; 3]>;

/// Sixteen elements.
#[derive(Clone)]
pub struct OperatorBlock {
    /// Packed `A_e` in the rest frame.
    pub matrix: Box<[f32x16; PACKED]>,
    /// Rotation of each element, row-major.
    pub rotation: [f32x16; 9],
    nodes: [[u32; LANES]; 8],
}

/// A spring between a point of the tissue and something outside it: adds
/// `stiffness w w^T (x) d d^T` to the system matrix.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointSpring {
    /// Nodes and weights of the point.
    pub weights: Vec<(u32, f32)>,
    /// Unit direction.
    pub direction: [f32; 3],
    /// `(dt^2) k`, kg.
    pub stiffness: f32,
}

/// One level's system matrix.
pub struct Operator {
    /// Blocks of elements, by element id.
    pub blocks: Vec<OperatorBlock>,
    /// Springs that act now.
    pub springs: Vec<PointSpring>,
    element_nodes: Vec<[u32; 8]>,
    /// Entries of node n are `incidence[first[n]..first[n + 1]]`, each `element * 8 + corner`.
    first: Vec<u32>,
    incidence: Vec<u32>,
    /// Inverse of the diagonal 3x3 block of each node, lower triangle by rows.
    diagonal_inverse: Vec<[f32; 6]>,
    results: Vec<[f32x16; 24]>,
}

impl OperatorBlock {
    fn new() -> Self {
        let (zero, one) = (f32x16::ZERO, f32x16::ONE);
        Self {
            matrix: Box::new([zero; PACKED]),
            rotation: [one, zero, zero, zero, one, zero, zero, zero, one],
            nodes: [[0; LANES]; 8],
        }
    }

    #[inline(always)]
    fn gather(&self, x: &[[f32; 3]]) -> [f32x16; 24] {
        let mut out = [f32x16::ZERO; 24];
        for corner in 0..8 {
            let points: [[f32; 3]; LANES] = std::array::from_fn(|l| x[self.nodes[corner][l] as usize]);
            for i in 0..3 {
                out[3 * corner + i] = f32x16::from(points.map(|p| p[i]));
            }
        }
        out
    }
}

impl Operator {
    /// An operator over `elements`, all matrices zero.
    #[must_use]
    pub fn new(element_nodes: Vec<[u32; 8]>, node_count: usize) -> Self {
        let mut operator = Self {
            blocks: Vec::new(),
            springs: Vec::new(),
            element_nodes: Vec::new(),
            first: Vec::new(),
            incidence: Vec::new(),
            diagonal_inverse: Vec::new(),
            results: Vec::new(),
        };
        operator.set_topology(element_nodes, node_count);
        operator
    }

    /// Number of nodes.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.diagonal_inverse.len()
    }

    /// Number of elements.
    #[must_use]
    pub fn element_count(&self) -> usize {
        self.element_nodes.len()
    }

    /// Takes new connectivity; matrices of elements that were there before are kept.
    pub fn set_topology(&mut self, element_nodes: Vec<[u32; 8]>, node_count: usize) {
        let blocks = element_nodes.len().div_ceil(LANES);
        self.blocks.resize_with(blocks, OperatorBlock::new);
        self.results.resize(blocks, [f32x16::ZERO; 24]);
        self.diagonal_inverse.resize(node_count, [0.0; 6]);
        let mut count = vec![0u32; node_count + 1];
        for (element, nodes) in element_nodes.iter().enumerate() {
            for (corner, &node) in nodes.iter().enumerate() {
                self.blocks[element / LANES].nodes[corner][element % LANES] = node;
                count[node as usize + 1] += 1;
            }
        }
        for node in 0..node_count {
            count[node + 1] += count[node];
        }
        self.first.clone_from(&count);
        self.incidence.resize(8 * element_nodes.len(), 0);
        for (element, nodes) in element_nodes.iter().enumerate() {
            for (corner, &node) in nodes.iter().enumerate() {
                self.incidence[count[node as usize] as usize] = (8 * element + corner) as u32;
                count[node as usize] += 1;
            }
        }
        self.element_nodes = element_nodes;
    }

    /// Nodes of an element.
    #[must_use]
    pub fn element_nodes(&self, element: usize) -> &[u32; 8] {
        &self.element_nodes[element]
    }

    /// Sets the packed matrix of an element.
    pub fn set_matrix(&mut self, element: usize, packed: &[f64; PACKED]) {
        let (block, lane) = (&mut self.blocks[element / LANES], element % LANES);
        for (slot, value) in block.matrix.iter_mut().zip(packed) {
            slot.as_mut_array()[lane] = *value as f32;
        }
    }

    /// The packed matrix of an element, as set.
    #[must_use]
    pub fn matrix(&self, element: usize) -> [f64; PACKED] {
        let (block, lane) = (&self.blocks[element / LANES], element % LANES);
        std::array::from_fn(|i| f64::from(block.matrix[i].as_array()[lane]))
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
    pub fn apply(&mut self, workers: &Workers<'_>, x: &[[f32; 3]], y: &mut [[f32; 3]]) {
        let Self { blocks, results, .. } = self;
        workers.for_chunks(results, BLOCKS_PER_CHUNK, |chunk, results| {
            let blocks = &blocks[chunk * BLOCKS_PER_CHUNK..];
            for (result, block) in results.iter_mut().zip(blocks) {
                let u = lanes::rotate_back(&block.rotation, &block.gather(x));
                *result = lanes::rotate(&block.rotation, &lanes::apply(&block.matrix, &u));
            }
        });
        self.sum_at_nodes(workers, y);
        for spring in &self.springs {
            spring.add_to(x, y);
        }
    }

    fn sum_at_nodes(&self, workers: &Workers<'_>, y: &mut [[f32; 3]]) {
        let results: &[f32] = bytemuck::cast_slice(self.results.as_slice());
        workers.for_chunks(y, NODES_PER_CHUNK, |chunk, y| {
            for (i, value) in y.iter_mut().enumerate() {
                let node = chunk * NODES_PER_CHUNK + i;
                let mut sum = [0.0f32; 3];
                for &entry in &self.incidence[self.first[node] as usize..self.first[node + 1] as usize] {
                    let (element, corner) = (entry as usize / 8, entry as usize % 8);
                    let base = (element / LANES * 24 + 3 * corner) * LANES + element % LANES;
                    for axis in 0..3 {
                        sum[axis] += results[base + axis * LANES];
                    }
                }
                *value = sum;
            }
        });
    }

    /// Recomputes the inverse diagonal blocks from matrices, rotations and springs.
    pub fn update_diagonal(&mut self, workers: &Workers<'_>) {
        let Self { blocks, results, .. } = self;
        // The six entries of each corner's rotated block fit the 24 slots in two passes of four corners.
        let mut sums = std::mem::take(&mut self.diagonal_inverse);
        sums.iter_mut().for_each(|s| *s = [0.0; 6]);
        for half in 0..2 {
            workers.for_chunks(results, BLOCKS_PER_CHUNK, |chunk, results| {
                for (result, block) in results.iter_mut().zip(&blocks[chunk * BLOCKS_PER_CHUNK..]) {
                    *result = rotated_diagonal(block, half);
                }
            });
            let values: &[f32] = bytemuck::cast_slice(results.as_slice());
            let (first, incidence) = (&self.first, &self.incidence);
            workers.for_chunks(&mut sums, NODES_PER_CHUNK, |chunk, sums| {
                for (i, sum) in sums.iter_mut().enumerate() {
                    let node = chunk * NODES_PER_CHUNK + i;
                    for &entry in &incidence[first[node] as usize..first[node + 1] as usize] {
                        let (element, corner) = (entry as usize / 8, entry as usize % 8);
                        if corner / 4 == half {
                            let base = (element / LANES * 24 + 6 * (corner % 4)) * LANES + element % LANES;
                            (0..6).for_each(|j| sum[j] += values[base + j * LANES]);
                        }
                    }
                }
            });
        }
        for spring in &self.springs {
            spring.add_to_diagonal(&mut sums);
        }
        sums.iter_mut().for_each(|s| *s = invert_symmetric(s));
        self.diagonal_inverse = sums;
    }

    /// `D^-1 r` at a node.
    #[inline(always)]
    #[must_use]
    pub fn precondition_node(&self, node: usize, r: [f32; 3]) -> [f32; 3] {
        let d = &self.diagonal_inverse[node];
        [
            d[0] * r[0] + d[1] * r[1] + d[3] * r[2],
            d[1] * r[0] + d[2] * r[1] + d[4] * r[2],
            d[3] * r[0] + d[4] * r[1] + d[5] * r[2],
        ]
    }
}

/// Lower triangles of `R A_aa R^T` for corners `4 half..4 half + 4`.
#[inline(always)]
fn rotated_diagonal(block: &OperatorBlock, half: usize) -> [f32x16; 24] {
    let mut out = [f32x16::ZERO; 24];
    let r = &block.rotation;
    for c in 0..4 {
        let a = 4 * half + c;
        let start = 6 * a + 9 * (a * a - a) / 2;
        let m = &block.matrix[start..start + 6];
        let full = [m[0], m[1], m[3], m[1], m[2], m[4], m[3], m[4], m[5]];
        let mut rm = [f32x16::ZERO; 9];
        for i in 0..3 {
            for j in 0..3 {
                rm[3 * i + j] = r[3 * i] * full[j] + r[3 * i + 1] * full[3 + j] + r[3 * i + 2] * full[6 + j];
            }
        }
        let mut slot = 6 * c;
        for i in 0..3 {
            for j in 0..=i {
                out[slot] = rm[3 * i] * r[3 * j] + rm[3 * i + 1] * r[3 * j + 1] + rm[3 * i + 2] * r[3 * j + 2];
                slot += 1;
            }
        }
    }
    out
}

fn invert_symmetric(m: &[f32; 6]) -> [f32; 6] {
    let [a, b, c, d, e, f] = m.map(f64::from);
    let (c00, c01, c02) = (c * f - e * e, d * e - b * f, b * e - c * d);
    let det = a * c00 + b * c01 + d * c02;
    // A node that carries nothing stays where it is.
    if det <= 0.0 {
        return [0.0; 6];
    }
    let s = 1.0 / det;
    [c00 * s, c01 * s, (a * f - d * d) * s, c02 * s, (b * d - a * e) * s, (a * c - b * b) * s].map(|x| x as f32)
}

impl PointSpring {
    fn add_to(&self, x: &[[f32; 3]], y: &mut [[f32; 3]]) {
        let d = self.direction;
        let along: f32 = self
            .weights
            .iter()
            .map(|&(node, w)| {
                let x = x[node as usize];
                w * (d[0] * x[0] + d[1] * x[1] + d[2] * x[2])
            })
            .sum();
        let force = self.stiffness * along;
        for &(node, w) in &self.weights {
            (0..3).for_each(|i| y[node as usize][i] += force * w * d[i]);
        }
    }

    fn add_to_diagonal(&self, sums: &mut [[f32; 6]]) {
        let d = self.direction;
        for &(node, w) in &self.weights {
            let s = self.stiffness * w * w;
            let sum = &mut sums[node as usize];
            let mut slot = 0;
            for i in 0..3 {
                for j in 0..=i {
                    sum[slot] += s * d[i] * d[j];
                    slot += 1;
                }
            }
        }
    }
}
