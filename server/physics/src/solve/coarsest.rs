//! Direct solve on the coarsest level: a dense factor of the rest state, warped by the rotations of
//! the nodes, `z = Q M0^-1 Q^T r`, so that nothing is refactored until the topology changes.
//!
//! Each connected piece has a factor of its own: a body that has been cut to shreds has a coarsest
//! level of many nodes, but of small pieces. Where these press on each other, the springs between them are all that
//! holds them, far stiffer than their mass: a factor without would be wrong by that much for each of the ways in
//! which a piece moves, and the solve would take an iteration for each. Those pieces are factored as one whenever
//! springs change, in the scene frame and with the springs.

use super::operator::Operator;
use crate::fem::lanes::{for_packed, unpack};
use crate::grid::levels::NONE;
use crate::walk::{Kept, WalkError};
use serde::{Deserialize, Serialize};
use std::ops::{AddAssign, Mul};
use wide::f32x4;

/// Pieces of more nodes than this are left to the smoother: the work of a dense factor grows with
/// the cube of its size.
const MOST_NODES: usize = 200;

/// A piece: its nodes and the lower triangle of its factor by rows, each diagonal entry inverted.
#[derive(Clone, Serialize, Deserialize)]
struct Piece {
    nodes: Vec<u32>,
    factor: Option<Vec<f32>>,
}

impl Piece {
    /// Whether a factor of the other one serves this one.
    fn is_like(&self, other: &Self) -> bool {
        let n = 3 * self.nodes.len();
        self.nodes == other.nodes && other.factor.as_ref().is_none_or(|factor| factor.len() == n * (n + 1) / 2)
    }
}

/// Pieces that springs join, as one system in the scene frame.
#[derive(Clone, Default)]
struct Joined {
    nodes: Vec<u32>,
    /// Of each node of the level among these; [`NONE`]: its piece is not joined.
    place: Vec<u32>,
    /// Lower triangle by rows, and its factor rounded, each diagonal entry inverted.
    matrix: Vec<f64>,
    factor: Vec<f32>,
}

/// The factors and the rotations of the nodes.
#[derive(Clone, Serialize, Deserialize)]
pub struct Coarsest {
    /// Factors of matrices that may have changed since.
    pieces: Kept<Vec<Piece>>,
    /// Of each node.
    #[serde(skip)]
    piece: Vec<u32>,
    #[serde(skip)]
    joined: Joined,
    /// Columns of each node's rotation.
    #[serde(skip)]
    rotation: Vec<[f32x4; 3]>,
    #[serde(skip)]
    sums: Vec<[f64; 9]>,
    #[serde(skip)]
    buffer: Vec<f32>,
}

impl Coarsest {
    /// Factors the matrix of `operator` at rest, springs left out.
    #[must_use]
    pub fn new(operator: &Operator) -> Self {
        let pieces = pieces(operator);
        let mut piece = vec![0; operator.node_count()];
        for (index, of) in pieces.iter().enumerate() {
            of.nodes.iter().for_each(|node| piece[*node as usize] = index as u32);
        }
        Self {
            pieces: pieces.into(),
            joined: Joined { place: vec![NONE; piece.len()], ..Joined::default() },
            rotation: vec![[f32x4::ZERO; 3]; piece.len()],
            sums: vec![[0.0; 9]; piece.len()],
            buffer: vec![0.0; 3 * piece.len()],
            piece,
        }
    }

    /// Takes the factors of `read`, of the same pieces.
    pub fn take_factors(&mut self, read: Self) -> Result<(), WalkError> {
        let alike = |(own, read): (&Piece, &Piece)| own.is_like(read);
        if self.pieces.len() != read.pieces.len() || !self.pieces.iter().zip(read.pieces.iter()).all(alike) {
            return Err(WalkError::new("the factors of the coarsest level are of other pieces".into()));
        }
        self.pieces = read.pieces;
        Ok(())
    }

    /// Room for the pieces that springs may join.
    pub fn reserve(&mut self) {
        if self.pieces.len() > 1 {
            let n = 3 * self.piece.len().min(MOST_NODES);
            let Joined { nodes, matrix, factor, .. } = &mut self.joined;
            nodes.reserve(self.piece.len() - nodes.len());
            matrix.reserve((n * (n + 1) / 2).saturating_sub(matrix.len()));
            factor.reserve((n * (n + 1) / 2).saturating_sub(factor.len()));
        }
    }

    /// Takes in the springs between pieces.
    pub fn set_springs(&mut self, operator: &Operator) {
        let Joined { nodes, place, .. } = &mut self.joined;
        nodes.drain(..).for_each(|node| place[node as usize] = NONE);
        for spring in operator.springs() {
            let mut pieces = spring.entries().map(|(node, _)| self.piece[node]);
            let first = pieces.next();
            if pieces.any(|piece| Some(piece) != first) {
                for (node, _) in spring.entries().filter(|(_, w)| *w != 0.0) {
                    let piece = &self.pieces[self.piece[node] as usize].nodes;
                    if place[node] == NONE {
                        piece.iter().zip(nodes.len() as u32..).for_each(|(node, at)| place[*node as usize] = at);
                        nodes.extend(piece);
                    }
                }
            }
        }
        if !nodes.is_empty() && (nodes.len() > MOST_NODES || !self.joined.factor(operator)) {
            let Joined { nodes, place, .. } = &mut self.joined;
            nodes.drain(..).for_each(|node| place[node as usize] = NONE);
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
        let Joined { nodes, place, factor, .. } = &self.joined;
        let values = &mut self.buffer[..3 * nodes.len()];
        for (&node, value) in nodes.iter().zip(values.chunks_exact_mut(3)) {
            value.copy_from_slice(&b[node as usize].to_array()[..3]);
        }
        substitute(factor, values);
        for (&node, value) in nodes.iter().zip(values.chunks_exact(3)) {
            x[node as usize] = f32x4::new([value[0], value[1], value[2], 0.0]);
        }
        for piece in self.pieces.iter().filter(|piece| place[piece.nodes[0] as usize] == NONE) {
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
                x[node as usize] = super::vectors::times(&self.rotation[node as usize], u);
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

/// Dot product in sixteen partial sums.
fn dot<T: Copy + Default + AddAssign + Mul<Output = T>>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::default(); 16];
    let ((a_chunks, a_rest), (b_chunks, b_rest)) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    for (x, y) in a_chunks.iter().zip(b_chunks) {
        (0..16).for_each(|i| sums[i] += x[i] * y[i]);
    }
    for width in [8, 4, 2, 1] {
        (0..width).for_each(|i| sums[i] += sums[i + width]);
    }
    a_rest.iter().zip(b_rest).for_each(|(x, y)| sums[0] += *x * *y);
    sums[0]
}

impl Joined {
    /// Factors the system; whether it is definite.
    fn factor(&mut self, operator: &Operator) -> bool {
        let n = 3 * self.nodes.len();
        self.matrix.clear();
        self.matrix.resize(n * (n + 1) / 2, 0.0);
        let Self { place, matrix, factor, .. } = self;
        let mut add = |a: usize, i: usize, b: usize, j: usize, value: f64| {
            let (row, column) = (3 * place[a] as usize + i, 3 * place[b] as usize + j);
            if row >= column {
                matrix[row * (row + 1) / 2 + column] += value;
            }
        };
        for element in 0..operator.element_count() {
            let nodes = operator.element_nodes(element).map(|node| node as usize);
            if place[nodes[0]] != NONE {
                let (k, r) = (unpack(&operator.matrix(element)), operator.rotation(element));
                for (a, b) in (0..64).map(|pair| (pair / 8, pair % 8)) {
                    // R K_ab R^T.
                    let half = |i: usize, m: usize| (0..3).map(|l| r[3 * i + l] * k[3 * a + l][3 * b + m]).sum::<f64>();
                    let half: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|m| half(i, m)));
                    for (i, j) in (0..9).map(|entry| (entry / 3, entry % 3)) {
                        add(nodes[a], i, nodes[b], j, (0..3).map(|m| half[i][m] * r[3 * j + m]).sum());
                    }
                }
            }
        }
        for spring in operator.springs().iter().filter(|s| s.entries().all(|(node, _)| place[node] != NONE)) {
            let stiffness = spring.stiffness();
            for (a, wa) in spring.entries() {
                for (b, wb) in spring.entries() {
                    let weight = f64::from(wa) * f64::from(wb);
                    (0..9).for_each(|entry| add(a, entry / 3, b, entry % 3, weight * stiffness[entry / 3][entry % 3]));
                }
            }
        }
        let found = self::factor(matrix, n);
        factor.clear();
        factor.extend(matrix.iter().map(|l| *l as f32));
        found
    }
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
    let triangle = |nodes: usize| vec![0.0; 3 * nodes * (3 * nodes + 1) / 2];
    let mut matrices: Vec<Option<Vec<f64>>> =
        pieces.iter().map(|p| (p.nodes.len() <= MOST_NODES).then(|| triangle(p.nodes.len()))).collect();
    for element in 0..operator.element_count() {
        let nodes = operator.element_nodes(element);
        let Some(matrix) = &mut matrices[place[nodes[0] as usize].0] else { continue };
        let packed = operator.matrix(element);
        for_packed(|index, row, column| {
            let local = |dof: usize| 3 * place[nodes[dof / 3] as usize].1 + dof % 3;
            // Nodes of a coarse element may coincide: an entry of either triangle may be one of the lower.
            let (i, j) = (local(row), local(column));
            matrix[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)] += packed[index];
            if row != column && i == j {
                matrix[i * (i + 1) / 2 + i] += packed[index];
            }
        });
    }
    for (piece, matrix) in pieces.iter_mut().zip(matrices) {
        piece.factor = matrix.and_then(|mut matrix| {
            factor(&mut matrix, 3 * piece.nodes.len()).then(|| matrix.into_iter().map(|l| l as f32).collect())
        });
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

/// Cholesky's factor of a matrix of `n` rows in the place of its lower triangle, each diagonal entry inverted; whether
/// the matrix is definite.
fn factor(rows: &mut [f64], n: usize) -> bool {
    let mut start = 0;
    for i in 0..n {
        let (above, row) = rows.split_at_mut(start);
        let mut start_above = 0;
        for j in 0..i {
            let other = &above[start_above..=start_above + j];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) * other[j];
            start_above += j + 1;
        }
        // Nodes that carry next to nothing make the matrix rank-deficient in f32 entries; a fraction of
        // the diagonal well above that rounding keeps the factor definite.
        let pivot = row[i] * (1.0 + 1e-5) + f64::MIN_POSITIVE - dot(&row[..i], &row[..i]);
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        // A row of nothing: its unknown is zero.
        let l = pivot.sqrt();
        row[i] = if l < f64::from(f32::MIN_POSITIVE) { 0.0 } else { 1.0 / l };
        start += i + 1;
    }
    true
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
