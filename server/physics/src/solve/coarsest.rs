//! Direct solve on the coarsest level: a dense factor of the rest state, warped by the rotations of
//! the nodes, `z = Q M0^-1 Q^T r`, so that nothing is refactored until the topology changes.
//!
//! Each connected piece has a factor of its own: a body that has been cut to shreds has a coarsest
//! level of many nodes, but of small pieces.

use super::operator::Operator;
use crate::fem::lanes::for_packed;
use nalgebra::{Cholesky, DMatrix};
use wide::f32x4;

/// Pieces of more nodes than this are left to the smoother: the work of a dense factor grows with
/// the cube of its size.
const MOST_NODES: usize = 200;

/// A piece: its nodes and the lower triangle of its factor by rows, each diagonal entry inverted.
#[derive(Clone)]
struct Piece {
    nodes: Vec<u32>,
    factor: Option<Vec<f32>>,
}

/// The factors and the rotations of the nodes.
#[derive(Clone)]
pub struct Coarsest {
    pieces: Vec<Piece>,
    /// Columns of each node's rotation.
    rotation: Vec<[f32x4; 3]>,
    sums: Vec<[f64; 9]>,
    buffer: Vec<f32>,
}

impl Coarsest {
    /// Factors the matrix of `operator` at rest, springs left out.
    #[must_use]
    pub fn new(operator: &Operator) -> Self {
        let pieces = pieces(operator);
        let most = pieces.iter().map(|p| p.nodes.len()).max().unwrap_or(0);
        Self {
            pieces,
            rotation: vec![[f32x4::ZERO; 3]; operator.node_count()],
            sums: vec![[0.0; 9]; operator.node_count()],
            buffer: vec![0.0; 3 * most],
        }
    }

    /// Takes the rotation of each node from the elements around it.
    pub fn update_rotations(&mut self, operator: &Operator) {
        self.sums.fill([0.0; 9]);
        for element in 0..operator.element_count() {
            let r = operator.rotation(element);
            for &node in operator.element_nodes(element) {
                (0..9).for_each(|i| self.sums[node as usize][i] += r[i]);
            }
        }
        for (rotation, sum) in self.rotation.iter_mut().zip(&self.sums) {
            let r = orthonormal(sum).map(|c| c as f32);
            *rotation = [0, 1, 2].map(|j| f32x4::new([r[j], r[3 + j], r[6 + j], 0.0]));
        }
    }

    /// `x = Q M0^-1 Q^T b`; `x = D^-1 b` on pieces without a factor.
    pub fn solve(&mut self, operator: &Operator, b: &[f32x4], x: &mut [f32x4]) {
        for piece in &self.pieces {
            let Some(factor) = &piece.factor else {
                for &node in &piece.nodes {
                    x[node as usize] = operator.precondition_node(node as usize, b[node as usize]);
                }
                continue;
            };
            let values = &mut self.buffer[..3 * piece.nodes.len()];
            for (&node, value) in piece.nodes.iter().zip(values.chunks_exact_mut(3)) {
                let (q, b) = (&self.rotation[node as usize], b[node as usize]);
                (0..3).for_each(|i| value[i] = (q[i] * b).reduce_add());
            }
            substitute(factor, values);
            for (&node, value) in piece.nodes.iter().zip(values.chunks_exact(3)) {
                let u = f32x4::new([value[0], value[1], value[2], 0.0]);
                x[node as usize] = super::operator::times(&self.rotation[node as usize], u);
            }
        }
    }
}

/// `v = (L L^T)^-1 v`.
fn substitute(factor: &[f32], v: &mut [f32]) {
    let mut start = 0;
    for i in 0..v.len() {
        let row = &factor[start..start + i];
        v[i] = (v[i] - dot(row, &v[..i])) * factor[start + i];
        start += i + 1;
    }
    for i in (0..v.len()).rev() {
        start -= i + 1;
        let value = v[i] * factor[start + i];
        v[i] = value;
        for (v, l) in v[..i].iter_mut().zip(&factor[start..start + i]) {
            *v -= value * l;
        }
    }
}

/// Dot product in eight partial sums.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 8];
    let (a_chunks, b_chunks) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f32 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a_chunks.zip(b_chunks) {
        (0..8).for_each(|i| sums[i] += x[i] * y[i]);
    }
    sums.iter().sum::<f32>() + rest
}

/// The connected pieces of a level, each factored.
fn pieces(operator: &Operator) -> Vec<Piece> {
    let mut root: Vec<u32> = (0..operator.node_count() as u32).collect();
    for element in 0..operator.element_count() {
        let nodes = operator.element_nodes(element);
        for &node in &nodes[1..] {
            let (a, b) = (find(&mut root, nodes[0]), find(&mut root, node));
            root[a.max(b) as usize] = a.min(b);
        }
    }
    let mut pieces: Vec<Piece> = Vec::new();
    // Piece and place in it of each node; a root comes before the nodes it stands for.
    let mut place = vec![(0, 0); root.len()];
    for node in 0..root.len() {
        let own = find(&mut root, node as u32) as usize;
        if own == node {
            place[node] = (pieces.len(), 0);
            pieces.push(Piece { nodes: vec![node as u32], factor: None });
        } else {
            let piece = place[own].0;
            place[node] = (piece, pieces[piece].nodes.len());
            pieces[piece].nodes.push(node as u32);
        }
    }
    let mut matrices: Vec<Option<DMatrix<f64>>> = pieces
        .iter()
        .map(|p| (p.nodes.len() <= MOST_NODES).then(|| DMatrix::zeros(3 * p.nodes.len(), 3 * p.nodes.len())))
        .collect();
    for element in 0..operator.element_count() {
        let nodes = operator.element_nodes(element);
        let Some(matrix) = &mut matrices[place[nodes[0] as usize].0] else { continue };
        let packed = operator.matrix(element);
        for_packed(|index, row, column| {
            let local = |dof: usize| 3 * place[nodes[dof / 3] as usize].1 + dof % 3;
            // Nodes of a coarse element may coincide; both triangles are written, the lower is read.
            matrix[(local(row), local(column))] += packed[index];
            if row != column {
                matrix[(local(column), local(row))] += packed[index];
            }
        });
    }
    for (piece, matrix) in pieces.iter_mut().zip(matrices) {
        piece.factor = matrix.and_then(factor);
    }
    pieces
}

fn find(root: &mut [u32], mut node: u32) -> u32 {
    while root[node as usize] != node {
        root[node as usize] = root[root[node as usize] as usize];
        node = root[node as usize];
    }
    node
}

fn factor(mut matrix: DMatrix<f64>) -> Option<Vec<f32>> {
    // Nodes that carry next to nothing make the matrix rank-deficient in f32 entries; a share of
    // the diagonal well above that rounding keeps the factor definite.
    for i in 0..matrix.nrows() {
        matrix[(i, i)] = matrix[(i, i)] * (1.0 + 1e-5) + f64::MIN_POSITIVE;
    }
    let lower = Cholesky::new(matrix)?.unpack();
    let rows = (0..lower.nrows()).flat_map(|i| (0..=i).map(move |j| (i, j)));
    let entry = |(i, j): (usize, usize)| match lower[(i, j)] {
        // A row of nothing: its unknown is zero.
        l if i == j && l < f64::from(f32::MIN_POSITIVE) => 0.0,
        l if i == j => (1.0 / l) as f32,
        l => l as f32,
    };
    Some(rows.map(entry).collect())
}

/// Gram-Schmidt on the rows of a sum of rotations; the identity where they cancel.
pub(super) fn orthonormal(m: &[f64; 9]) -> [f64; 9] {
    let a = crate::Vec3::new(m[0], m[1], m[2]);
    let b = crate::Vec3::new(m[3], m[4], m[5]);
    let (Some(a), true) = (a.try_normalize(1e-6), b.norm() > 1e-6) else {
        return [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    };
    let Some(b) = (b - a * a.dot(&b)).try_normalize(1e-6) else {
        return [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    };
    let c = a.cross(&b);
    [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z]
}
