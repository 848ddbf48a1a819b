//! Direct solve on the coarsest level: a dense factor of the rest state, warped by the rotations of
//! the nodes, `z = Q M0^-1 Q^T r`, so that nothing is refactored until the topology changes.
//!
//! Each connected piece has a factor of its own: a body that has been cut to shreds has a coarsest
//! level of many nodes, but of small pieces. Where these press on each other, the springs between them are all that
//! holds them, far stiffer than their mass: a factor without would be wrong by that much for each of the ways in
//! which a piece moves, and the solve would take an iteration for each. Those pieces are factored as one whenever
//! springs change, in the scene frame and with the springs.

use super::operator::Operator;
use super::spring::PointSpring;
use crate::fem::lanes::{for_packed, unpack};
use crate::grid::levels::NONE;
use crate::grow::make_room;
use crate::walk::{Kept, WalkError};
use serde::{Deserialize, Serialize};
use wide::{f32x4, f64x4};

/// Pieces of more nodes than this are left to the smoother: the work of a dense factor grows with
/// the cube of its size.
const MOST_NODES: usize = 200;
/// The same of pieces that are joined, whose factor is mostly zeros: a piece meets few others.
const MOST_JOINED_NODES: usize = 600;

/// A piece: its nodes and the factor of its matrix, by [`factor`].
#[derive(Clone, Serialize, Deserialize)]
struct Piece {
    nodes: Vec<u32>,
    factor: Option<Vec<f32>>,
}

impl Piece {
    /// Whether a factor of the other one serves this one.
    fn is_like(&self, other: &Self) -> bool {
        let entries = row_start(3 * self.nodes.len(), 3 * self.nodes.len());
        self.nodes == other.nodes && other.factor.as_ref().is_none_or(|factor| factor.len() == entries)
    }
}

/// Pieces that springs join, as one system in the scene frame.
#[derive(Clone, Default)]
struct Joined {
    /// In order.
    pieces: Vec<u32>,
    /// By piece: scratch.
    is_joined: Vec<bool>,
    /// Of the pieces, one after the other.
    nodes: Vec<u32>,
    /// Of each node of the level among these; [`NONE`]: its piece is not joined.
    place: Vec<u32>,
    /// What the elements add to the matrix; empty: not known yet.
    elements: Vec<Block>,
    /// The springs that are in the factor.
    springs: Vec<PointSpring>,
    /// The matrix, the factor as it is computed, and as it is used.
    blocks: Vec<Block>,
    matrix: Vec<f64>,
    factor: Vec<f32>,
}

/// Rows of the block of two nodes, the last lane idle. Those of an upper triangle stand by rows, as entries do; of the
/// blocks on the diagonal the lower part is there too.
type Block = [f64x4; 3];

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
            joined: Joined {
                is_joined: vec![false; pieces.len()],
                place: vec![NONE; piece.len()],
                ..Joined::default()
            },
            pieces: pieces.into(),
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

    /// Room for the pieces that `count` springs may join.
    pub fn reserve(&mut self, count: usize) {
        if self.pieces.len() > 1 {
            let most = self.piece.len().min(MOST_JOINED_NODES);
            let (pairs, entries) = (row_start(most, most), row_start(3 * most, 3 * most));
            let Joined { nodes, springs, elements, blocks, matrix, factor, .. } = &mut self.joined;
            make_room(nodes, self.piece.len());
            make_room(springs, count);
            make_room(elements, pairs);
            make_room(blocks, pairs);
            make_room(matrix, entries);
            make_room(factor, entries);
        }
    }

    /// Takes in the springs between pieces.
    pub fn set_springs(&mut self, operator: &Operator) {
        self.joined.find(&self.pieces, &self.piece, operator.springs());
        if !self.joined.nodes.is_empty()
            && (self.joined.nodes.len() > MOST_JOINED_NODES || !self.joined.factor(operator))
        {
            self.joined.separate();
        }
    }

    /// Takes the rotation of each node from the elements around it.
    pub fn update_rotations(&mut self, operator: &Operator) {
        self.joined.elements.clear();
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

/// Where a row begins in an upper triangle of `n` rows; of row `n`, the number of its entries.
fn row_start(n: usize, row: usize) -> usize {
    row * n - row * row.saturating_sub(1) / 2
}

/// `v = (U^T U)^-1 v`.
fn substitute(factor: &[f32], v: &mut [f32]) {
    let n = v.len();
    let mut rows = factor;
    for i in 0..n {
        let (row, below) = rows.split_at(n - i);
        rows = below;
        let (own, rest) = v[i..].split_at_mut(1);
        own[0] *= row[0];
        rest.iter_mut().zip(&row[1..]).for_each(|(v, u)| *v -= own[0] * u);
    }
    for i in (0..n).rev() {
        let row = &factor[row_start(n, i)..][..n - i];
        v[i] = (v[i] - dot(&row[1..], &v[i + 1..])) * row[0];
    }
}

/// Dot product in sixteen partial sums.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0; 16];
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
    /// Finds the pieces that these springs join.
    fn find(&mut self, pieces: &[Piece], piece: &[u32], springs: &[PointSpring]) {
        self.is_joined.fill(false);
        for spring in springs {
            let carriers = || spring.entries().filter(|(_, w)| *w != 0.0).map(|(node, _)| piece[node]);
            let first = carriers().next();
            if carriers().any(|piece| Some(piece) != first) {
                carriers().for_each(|piece| self.is_joined[piece as usize] = true);
            }
        }
        let found = (0..pieces.len() as u32).filter(|piece| self.is_joined[*piece as usize]);
        if found.clone().eq(self.pieces.iter().copied()) {
            return;
        }
        let Self { nodes, place, .. } = self;
        nodes.drain(..).for_each(|node| place[node as usize] = NONE);
        nodes.extend(found.clone().flat_map(|piece| &pieces[piece as usize].nodes));
        nodes.iter().zip(0..).for_each(|(node, at)| place[*node as usize] = at);
        self.pieces.clear();
        self.pieces.extend(found);
        self.elements.clear();
    }

    /// Leaves every piece to itself.
    fn separate(&mut self) {
        let Self { nodes, place, .. } = self;
        nodes.drain(..).for_each(|node| place[node as usize] = NONE);
        self.pieces.clear();
        self.factor.clear();
    }

    /// Factors the system, unless the factor is of these springs; whether it is definite.
    fn factor(&mut self, operator: &Operator) -> bool {
        let is_anew = self.elements.is_empty();
        if is_anew {
            self.sum_elements(operator);
        }
        let count = self.nodes.len();
        let Self { place, elements, springs, blocks, matrix, factor, .. } = self;
        let within = |spring: &&PointSpring| spring.entries().all(|(node, w)| w == 0.0 || place[node] != NONE);
        let acting = operator.springs().iter().filter(within);
        if !is_anew && acting.clone().eq(springs.iter()) {
            return true;
        }
        springs.clear();
        springs.extend(acting);
        blocks.clear();
        blocks.extend_from_slice(elements);
        for spring in springs.iter() {
            let stiffness = spring.stiffness().map(f64x4::from);
            let carriers = || spring.entries().filter(|(_, w)| *w != 0.0);
            for ((a, wa), (b, wb)) in carriers().flat_map(|a| carriers().map(move |b| (a, b))) {
                let weight = f64x4::splat(f64::from(wa) * f64::from(wb));
                add_block(blocks, count, [place[a], place[b]], stiffness.map(|row| weight * row));
            }
        }
        write_rows(blocks, count, matrix);
        let is_definite = self::factor(matrix, 3 * count);
        factor.clear();
        factor.extend(matrix.iter().map(|u| *u as f32));
        is_definite
    }

    /// The elements' matrices, in the scene frame.
    fn sum_elements(&mut self, operator: &Operator) {
        let count = self.nodes.len();
        let Self { place, elements, .. } = self;
        elements.resize(row_start(count, count), [f64x4::ZERO; 3]);
        for element in 0..operator.element_count() {
            let nodes = operator.element_nodes(element).map(|node| place[node as usize]);
            if nodes[0] != NONE {
                let (k, r) = (unpack(&operator.matrix(element)), operator.rotation(element));
                for (a, b) in (0..64).map(|pair| (pair / 8, pair % 8)) {
                    // R K_ab R^T.
                    let half = |i: usize, m: usize| (0..3).map(|l| r[3 * i + l] * k[3 * a + l][3 * b + m]).sum::<f64>();
                    let half: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|m| half(i, m)));
                    let whole = |i: usize, j: usize| (0..3).map(|m| half[i][m] * r[3 * j + m]).sum();
                    let block = [0, 1, 2].map(|i| f64x4::new([whole(i, 0), whole(i, 1), whole(i, 2), 0.0]));
                    add_block(elements, count, [nodes[a], nodes[b]], block);
                }
            }
        }
    }
}

/// Adds the block of the nodes at two places to an upper triangle of `count` nodes; one below the diagonal is left out.
fn add_block(triangle: &mut [Block], count: usize, places: [u32; 2], block: Block) {
    let [row, column] = places.map(|place| place as usize);
    if row <= column {
        let sum = &mut triangle[row_start(count, row) + column - row];
        *sum = std::array::from_fn(|i| sum[i] + block[i]);
    }
}

/// The rows of an upper triangle of blocks of `count` nodes.
fn write_rows(blocks: &[Block], count: usize, rows: &mut Vec<f64>) {
    rows.clear();
    for row in 0..count {
        let of_row = &blocks[row_start(count, row)..][..count - row];
        for i in 0..3 {
            rows.extend_from_slice(&of_row[0][i].to_array()[i..3]);
            rows.extend(of_row[1..].iter().flat_map(|block| block[i].to_array().into_iter().take(3)));
        }
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
    let triangle = |nodes: usize| vec![0.0; row_start(3 * nodes, 3 * nodes)];
    let mut matrices: Vec<Option<Vec<f64>>> =
        pieces.iter().map(|p| (p.nodes.len() <= MOST_NODES).then(|| triangle(p.nodes.len()))).collect();
    for element in 0..operator.element_count() {
        let nodes = operator.element_nodes(element);
        let piece = place[nodes[0] as usize].0;
        let Some(matrix) = &mut matrices[piece] else { continue };
        let n = 3 * pieces[piece].nodes.len();
        let packed = operator.matrix(element);
        for_packed(|index, row, column| {
            let local = |dof: usize| 3 * place[nodes[dof / 3] as usize].1 + dof % 3;
            // Nodes of a coarse element may coincide: an entry of either triangle may be one of the lower.
            let (i, j) = (local(row), local(column));
            let entry = row_start(n, i.min(j)) + i.abs_diff(j);
            matrix[entry] += packed[index];
            if row != column && i == j {
                matrix[entry] += packed[index];
            }
        });
    }
    for (piece, matrix) in pieces.iter_mut().zip(matrices) {
        piece.factor = matrix.and_then(|mut matrix| {
            factor(&mut matrix, 3 * piece.nodes.len()).then(|| matrix.into_iter().map(|u| u as f32).collect())
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

/// Rows that leave those below them together.
const ROWS: usize = 4;

/// Cholesky's factor U of a matrix `U^T U` of `n` rows, in the place of its upper triangle, which stands by rows; each
/// diagonal entry inverted. Whether the matrix is definite.
fn factor(triangle: &mut [f64], n: usize) -> bool {
    for row in 0..n {
        // Nodes that carry next to nothing make the matrix rank-deficient in f32 entries; a fraction of
        // the diagonal well above that rounding keeps the factor definite.
        let diagonal = &mut triangle[row_start(n, row)];
        *diagonal = *diagonal * (1.0 + 1e-5) + f64::MIN_POSITIVE;
    }
    for first in (0..n).step_by(ROWS) {
        let end = n.min(first + ROWS);
        let (above, below) = triangle.split_at_mut(row_start(n, end));
        for row in first..end {
            let (done, values) = above.split_at_mut(row_start(n, row));
            let values = &mut values[..n - row];
            for other in first..row {
                let other = &done[row_start(n, other) + row - other..][..n - row];
                values.iter_mut().zip(other).for_each(|(v, u)| *v = (-other[0]).mul_add(*u, *v));
            }
            let pivot = values[0];
            if pivot.is_nan() || pivot <= 0.0 {
                return false;
            }
            // A row of nothing: its unknown is zero.
            let root = pivot.sqrt();
            let inverse = if root < f64::from(f32::MIN_POSITIVE) { 0.0 } else { 1.0 / root };
            values.iter_mut().for_each(|v| *v *= inverse);
            values[0] = inverse;
        }
        // Rows and columns beyond what these rows reach stay as they are: those of pieces that theirs meets nowhere.
        let reach = (first..end).map(|row| row_end(&above[row_start(n, row)..][..n - row], row)).fold(end, usize::max);
        let mut rest = below;
        for row in end..reach {
            let (values, next) = rest.split_at_mut(n - row);
            rest = next;
            // There are rows below whole bands only.
            let [a, b, c, d] = std::array::from_fn::<_, ROWS, _>(|i| {
                &above[row_start(n, first + i) + row - first - i..][..reach - row]
            });
            if [a, b, c, d].iter().all(|u| u[0] == 0.0) {
                continue;
            }
            for (i, v) in values[..reach - row].iter_mut().enumerate() {
                let half = (-a[0]).mul_add(a[i], (-b[0]).mul_add(b[i], *v));
                *v = (-c[0]).mul_add(c[i], (-d[0]).mul_add(d[i], half));
            }
        }
    }
    true
}

/// The column after the last entry of a row that is not zero.
fn row_end(values: &[f64], row: usize) -> usize {
    row + values.iter().rposition(|v| *v != 0.0).map_or(0, |last| last + 1)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::composite::{CompositeTables, Field, FilledVoxel};
    use crate::fem::lanes::pack;
    use crate::fem::material::Elastic;
    use crate::grid::cell_sizes::CellSizes;
    use crate::grid::levels::Level;
    use crate::grid::units::VoxelUnits;
    use crate::grid::voxelize::voxelize;
    use crate::grid::{Crossing, LinkId};
    use crate::scene::SceneDesc;
    use crate::workers::Workers;

    /// Loose cells in a row along x, each of one element with mass.
    fn loose_cells(count: usize) -> Operator {
        let text = format!(
            "version = 1\nname = \"row\"\n[[objects]]\nname = \"row\"\n\
             shape = {{ box = {{ min_m = [0.0, 0.0, 0.0], max_m = [{}, 0.01, 0.01] }} }}\nvoxel_size_m = 0.01\nlevel = 0\n\
             material = {{ young_modulus_pa = 1e5, poisson_ratio = 0.3 }}",
            0.01 * count as f64
        );
        let desc = SceneDesc::from_toml("row.toml", &text).expect("a scene");
        let mut grid = voxelize(&desc.objects[0], &Default::default()).expect("a valid object");
        let first = grid.voxels()[0].ijk;
        for i in 0..count as i32 - 1 {
            let link = LinkId { cell: [first[0] + i, first[1], first[2]], axis: 0 };
            grid.part(link, Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] });
        }
        let level = Level::base(&VoxelUnits { grid: &grid, exponent: 0 }, CellSizes::uniform(grid.dims()));
        let mut operator = Operator::new(&level);
        let filled = [FilledVoxel::whole(0, Elastic::new(1e5, 0.3, 1000.0))];
        let mut matrix = CompositeTables::new(0, 0.01).assemble(&filled, Field::Trilinear).stiffness;
        (0..24).for_each(|i| matrix[i][i] += 100.0);
        (0..level.elements.len()).for_each(|element| operator.set_matrix(element, &pack(&matrix)));
        operator.update_diagonal(&Workers::serial());
        operator
    }

    #[test]
    fn pieces_that_press_on_each_other_are_solved_as_one_however_many() {
        let workers = Workers::serial();
        // Of eight nodes each.
        for count in [4, 40] {
            let mut operator = loose_cells(count);
            assert_eq!(operator.node_count(), 8 * count);
            let mut coarsest = Coarsest::new(&operator);
            assert_eq!(coarsest.pieces.len(), count);
            let spring = |i: usize| {
                let [a, b] = [i, i + 1].map(|element| *operator.element_nodes(element));
                let ends = [(a[1], 0.5), (a[3], 0.5), (b[0], -0.5), (b[2], -0.5)];
                // Far stiffer than a cell.
                PointSpring::new(ends.into_iter(), [0.8, 0.6, 0.0], 1e6)
            };
            let springs: Vec<PointSpring> = (0..count - 1).map(spring).collect();
            operator.set_springs(springs.into_iter(), 4.0);
            coarsest.reserve(count);
            coarsest.update_rotations(&operator);
            coarsest.set_springs(&operator);
            let b: Vec<f32x4> = (0..8 * count).map(|i| f32x4::new([(i as f32).sin(), 1.0, -0.5, 0.0])).collect();
            let (mut x, mut product) = (vec![f32x4::ZERO; b.len()], vec![f32x4::ZERO; b.len()]);
            coarsest.solve(&operator, &b, &mut x);
            operator.apply(&workers, &x, &mut product);
            let norm = |v: &[f32x4]| v.iter().map(|v| (*v * *v).reduce_add()).sum::<f32>().sqrt();
            let left: Vec<f32x4> = b.iter().zip(&product).map(|(b, ax)| *b - *ax).collect();
            assert!(norm(&left) < 1e-2 * norm(&b), "{count} pieces: {} of {} is left", norm(&left), norm(&b));
        }
    }

    #[test]
    fn a_factor_of_a_matrix_with_gaps_multiplies_to_the_matrix() {
        // Pieces of five unknowns: each with the next one and, here and there, with one far off.
        let n = 43;
        let is_there = |i: usize, j: usize| i / 5 == j / 5 || j - i == 5 || (i.is_multiple_of(10) && j - i == 21);
        let entry = |i: usize, j: usize| match j - i {
            0 => 5.0 + (i % 3) as f64,
            _ if is_there(i, j) => ((i * 7 + j * 3) % 11) as f64 / 11.0 - 0.5,
            _ => 0.0,
        };
        let matrix: Vec<f64> = (0..n).flat_map(|i| (i..n).map(move |j| entry(i, j))).collect();
        let mut triangle = matrix.clone();
        assert!(factor(&mut triangle, n));
        let at = |i: usize, j: usize| match j - i {
            0 => 1.0 / triangle[row_start(n, i)],
            _ => triangle[row_start(n, i) + j - i],
        };
        for i in 0..n {
            for j in i..n {
                let product: f64 = (0..=i).map(|k| at(k, i) * at(k, j)).sum();
                let wanted = entry(i, j) * if i == j { 1.0 + 1e-5 } else { 1.0 };
                assert!((product - wanted).abs() < 1e-12, "({i}, {j}): {product} for {wanted}");
            }
        }
    }
}
