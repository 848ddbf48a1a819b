//! Elements that touch what is held.
//!
//! What is held stays where it is, and the tissue beside it gives way right up to it, however few voxels of an
//! element that is. So the displacement is interpolated twice: corners of voxels that are held have none, at every
//! other corner of a voxel it is trilinear between the element's nodes, and within each voxel it is trilinear between
//! the voxel's corners. Nodes among held voxels are free: their values are what lets the field next to them come
//! to zero at the surface of what is held.
//!
//! Corners that no other element has follow those that others have by static condensation, for the most part.
//!
//! An element that turns sees what is held turn the other way. In its frame a held corner at rest position X, from the
//! cell's lower corner, has the displacement `(R^T - 1) X`: that of the three *ground points* `H e_j`, H the cell's edge,
//! by the weights X_j / H. With these three beside its eight corners the element is as any other: it resists neither
//! translation nor rotation of all of them.

use super::composite::{CompositeTables, Field, FilledVoxel, shape_functions, shape_gradients};
use super::material::Elastic;
use super::matrices::{DOFS, ElementMatrices, GROUND, Ground, GroundStiffness, Matrix24};
use nalgebra::{Cholesky, DMatrix};
use serde::{Deserialize, Serialize};

/// Corners' and ground points'.
const ALL: usize = DOFS + GROUND;
/// Fraction of the plain element's matrices that is left in an element whose voxels are held or hardly reach out of
/// what is: its nodes would be singular. Between 1e-6 and 1e-3 it does not show in any displacement.
const LEFT_OVER: f64 = 1e-3;
/// A node that no other element has is resisted by this fraction of what would resist it if nothing were held, at least:
/// see [`tie_weak_nodes`]. What is tied so carries hardly anything, so that it tells only where it would run off.
const LEAST_RESISTED: f64 = 0.1;
/// Share of the stiffness with all corners trilinear in that which has inner corners condensed. Without it nodes that
/// only inner corners feel would be singular; at 0.03 the search for rest no longer ends. The built-in liver is off by
/// 8.0 % at level 2 with all of it, 5.5 % with 0.3, 4.6 % with 0.1.
const TRILINEAR: f64 = 0.25;
/// Displacements that are condensed at most: the time goes with the cube. Beyond it they stay trilinear.
const MOST_CONDENSED: usize = 450;

/// What the corners of a cell's voxels are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Corner {
    /// Of no voxel of the element, or of its voxels alone.
    #[default]
    Own,
    /// Of another element's voxels, too.
    Shared,
    /// Held.
    Held,
}

/// The corners of the voxels of a cell of 2^exponent voxels a side, and what each is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct VoxelCorners {
    exponent: u8,
    corners: Box<[Corner]>,
    /// Bit a: node a stands still.
    still: u8,
    /// Bit a: no other element has node a.
    lone: u8,
}

impl VoxelCorners {
    /// All [`Corner::Own`].
    #[must_use]
    pub fn new(exponent: u8) -> Self {
        let across = (1usize << exponent) + 1;
        Self { exponent, corners: vec![Corner::Own; across * across * across].into(), still: 0, lone: 0 }
    }

    /// Of an element that is taken as a single voxel: the nodes of a mask are held.
    fn of_nodes(held: u8) -> Self {
        let corner = |a: u8| if held >> a & 1 == 1 { Corner::Held } else { Corner::Own };
        Self { exponent: 0, corners: (0..8).map(corner).collect(), still: held, lone: 0 }
    }

    /// Whether they are of an element whose edge has so many voxels, as log2.
    #[must_use]
    pub fn fits(&self, exponent: u8) -> bool {
        self.exponent == exponent && self.corners.len() == ((1usize << exponent) + 1).pow(3)
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Place among them of the corner at `at`, in voxels from the cell's lower corner.
    #[must_use]
    pub fn index(&self, at: [i32; 3]) -> usize {
        let across = (1 << self.exponent) + 1;
        ((at[2] * across + at[1]) * across + at[0]) as usize
    }

    /// What the corner at `at`, in voxels from the cell's lower corner, is.
    #[must_use]
    pub fn at(&self, at: [i32; 3]) -> Corner {
        self.corners[self.index(at)]
    }

    /// Whether a corner is the element's own and none of its nodes.
    fn is_inner(&self, at: [i32; 3]) -> bool {
        self.at(at) == Corner::Own && at.iter().any(|x| x % (1 << self.exponent) != 0)
    }

    /// Says what a corner is.
    pub fn set(&mut self, at: [i32; 3], corner: Corner) {
        let index = self.index(at);
        self.corners[index] = corner;
    }

    /// Whether any is held.
    #[must_use]
    pub fn any_held(&self) -> bool {
        self.corners.contains(&Corner::Held)
    }

    /// Nodes that a corner's trilinear displacement comes from; bit a for node a.
    fn support(&self, at: [i32; 3]) -> u8 {
        let across = 1 << self.exponent;
        let of = |a: &usize| (0..3).all(|axis| at[axis] != if a >> axis & 1 == 1 { 0 } else { across });
        (0..8usize).filter(of).fold(0, |mask, a| mask | 1 << a)
    }

    /// The nodes that, if they stood still, would hold what is held and nothing else of `voxels`; bit a for node a.
    /// `None` where what is held does not end at faces of the cell.
    #[must_use]
    pub fn held_nodes(&self, voxels: impl Iterator<Item = [i32; 3]> + Clone) -> Option<u8> {
        let corners = voxels.flat_map(corners_of);
        let held = corners.clone().filter(|at| self.at(*at) == Corner::Held);
        let nodes = held.fold(0, |mask, at| mask | self.support(at));
        let mut free = corners.filter(|at| self.at(*at) != Corner::Held);
        free.all(|at| self.support(at) & !nodes != 0).then_some(nodes)
    }

    /// Nodes that stand still; bit a for node a.
    #[must_use]
    pub fn still(&self) -> u8 {
        self.still
    }

    /// Says which nodes stand still, and which no other element has.
    pub fn set_nodes(&mut self, still: u8, lone: u8) {
        (self.still, self.lone) = (still, lone);
    }

    /// Nodes that no other element has; bit a for node a.
    #[must_use]
    pub fn lone(&self) -> u8 {
        self.lone
    }

    /// Weights of the nodes, but for those that stand still, at local coordinates.
    fn moving(&self, local: [f64; 3]) -> [f64; 8] {
        let n = shape_functions(local);
        std::array::from_fn(|a| if self.still >> a & 1 == 1 { 0.0 } else { n[a] })
    }

    /// Local coordinates, 0 to 1 in the cell, of a corner.
    fn local(&self, at: [i32; 3]) -> [f64; 3] {
        at.map(|x| f64::from(x) / f64::from(1 << self.exponent))
    }

    /// The voxel of a cell that local coordinates lie in, or the one next to them, and where in it they are.
    fn voxel_at(&self, local: [f64; 3]) -> ([i32; 3], [f64; 3]) {
        let across = f64::from(1 << self.exponent);
        let at = local.map(|x| (x * across).floor().clamp(0.0, across - 1.0) as i32);
        (at, [0, 1, 2].map(|a| local[a] * across - f64::from(at[a])))
    }

    /// Weights of the element's nodes in the displacement at local coordinates within a voxel, at `voxel` in the cell;
    /// what is missing to one is held.
    #[must_use]
    pub fn weights(&self, voxel: [i32; 3], local: [f64; 3]) -> [f64; 8] {
        let across = f64::from(1 << self.exponent);
        let within = [0, 1, 2].map(|a| local[a] * across - f64::from(voxel[a]));
        self.sum_free(voxel, shape_functions(within))
    }

    /// Gradients of these weights with respect to the local coordinates.
    #[must_use]
    pub fn weight_gradients(&self, voxel: [i32; 3], local: [f64; 3]) -> [[f64; 3]; 8] {
        let across = f64::from(1 << self.exponent);
        let within = [0, 1, 2].map(|a| local[a] * across - f64::from(voxel[a]));
        let gradients = shape_gradients(within);
        let along = [0, 1, 2].map(|axis| self.sum_free(voxel, gradients.map(|g| across * g[axis])));
        std::array::from_fn(|node| [0, 1, 2].map(|axis| along[axis][node]))
    }

    /// Weights at local coordinates and their gradients, in the voxel that these lie in or next to.
    #[must_use]
    pub fn weights_anywhere(&self, local: [f64; 3]) -> ([f64; 8], [[f64; 3]; 8]) {
        let (voxel, _) = self.voxel_at(local);
        (self.weights(voxel, local), self.weight_gradients(voxel, local))
    }

    /// Sum over the corners of a voxel that are not held of `values` times the corner's shape functions.
    fn sum_free(&self, voxel: [i32; 3], values: [f64; 8]) -> [f64; 8] {
        let mut sum = [0.0; 8];
        for (corner, value) in corners_of(voxel).zip(values) {
            if self.at(corner) != Corner::Held {
                let n = self.moving(self.local(corner));
                (0..8).for_each(|a| sum[a] += value * n[a]);
            }
        }
        sum
    }
}

/// The corners of a voxel.
fn corners_of(voxel: [i32; 3]) -> impl Iterator<Item = [i32; 3]> + Clone {
    (0..8).map(move |corner| corner_of(voxel, corner))
}

/// One of them, 0 to 7.
fn corner_of(voxel: [i32; 3], corner: usize) -> [i32; 3] {
    [0, 1, 2].map(|a| voxel[a] + (corner >> a & 1) as i32)
}

/// A voxel of an element that touches what is held.
#[derive(Clone, Copy, Debug)]
pub struct HeldVoxel {
    /// In voxels from the cell's lower corner.
    pub at: [i32; 3],
    /// Its material.
    pub elastic: Elastic,
    /// How much of it is filled; 1: all of it.
    pub share: f64,
}

/// A voxel, its matrices if it were filled, and how much of it is.
type Part<'a> = ([i32; 3], &'a ElementMatrices, f64);

/// What moves a corner of a voxel: the element's corners, then the ground points, each by the same weight along all axes.
const SHARES: usize = ALL / 3;

/// Displacements of the voxels' corners in terms of those of the element's corners and the ground points: trilinear but
/// for what is held.
struct Displacements<'a> {
    corners: &'a VoxelCorners,
    /// By voxel corner.
    weights: Vec<[f64; SHARES]>,
}

impl<'a> Displacements<'a> {
    fn truncated(corners: &'a VoxelCorners) -> Self {
        let across = (1 << corners.exponent) + 1;
        let weights_of = |n: i32| {
            let local = corners.local([n % across, n / across % across, n / across / across]);
            let mut weights = [0.0; SHARES];
            if corners.corners[n as usize] == Corner::Held {
                weights[8..].copy_from_slice(&local);
            } else {
                let (all, moving) = (shape_functions(local), corners.moving(local));
                for node in 0..8 {
                    weights[node] = moving[node];
                    let along = |point: &usize| node >> point & 1 == 1;
                    (0..3).filter(along).for_each(|point| weights[8 + point] += all[node] - moving[node]);
                }
            }
            weights
        };
        Self { corners, weights: (0..corners.corners.len() as i32).map(weights_of).collect() }
    }

    /// The weights of a voxel's corners.
    fn of_voxel(&self, voxel: [i32; 3]) -> [[f64; SHARES]; 8] {
        let mut weights = [[0.0; SHARES]; 8];
        for (weights, at) in weights.iter_mut().zip(corners_of(voxel)) {
            *weights = self.weights[self.corners.index(at)];
        }
        weights
    }

    /// For a pair of corners of the voxels that have these `matrices`, the sum of the products of their weights:
    /// `P^T K P` over these voxels is that of the products with the blocks of K.
    fn products(
        &self,
        voxels: &[Part<'_>],
        matrices: &ElementMatrices,
        [row, column]: [usize; 2],
    ) -> [[f64; SHARES]; SHARES] {
        let mut products = [[0.0; SHARES]; SHARES];
        for (voxel, _, share) in voxels.iter().filter(|(_, of, _)| std::ptr::eq(*of, matrices)) {
            let weights = |corner| &self.weights[self.corners.index(corner_of(*voxel, corner))];
            let (row, column) = (weights(row), weights(column));
            for (sum, row) in products.iter_mut().zip(row).filter(|(_, row)| **row != 0.0) {
                (0..SHARES).for_each(|q| sum[q] += share * row * column[q]);
            }
        }
        products
    }

    /// `P^T K P` over the voxels, of their stiffness and of what of it strain stiffening measures.
    fn stiffness(&self, voxels: &[Part<'_>]) -> [Whole; 2] {
        let mut sums = [(); 2].map(|()| Box::new([[0.0; ALL]; ALL]));
        for (index, (_, matrices, _)) in voxels.iter().enumerate() {
            if voxels[..index].iter().any(|(_, other, _)| std::ptr::eq(*other, *matrices)) {
                continue;
            }
            for [row, column] in (0..64).map(|pair| [pair / 8, pair % 8]) {
                let products = self.products(voxels, matrices, [row, column]);
                for (k, sum) in [&matrices.stiffness, &matrices.stiffness_measured].into_iter().zip(&mut sums) {
                    add_block(sum, &products, |i, j| k[3 * row + i][3 * column + j]);
                }
            }
        }
        sums
    }

    /// `(K P)` at the corners that no other element has, and the part of K between those; three rows and columns each, in
    /// the order of the corners. `None` where there are none, or too many.
    fn inner(&self, voxels: &[Part<'_>]) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
        let mut is_inner = vec![false; self.weights.len()];
        for at in voxels.iter().flat_map(|(voxel, ..)| corners_of(*voxel)).filter(|at| self.corners.is_inner(*at)) {
            is_inner[self.corners.index(at)] = true;
        }
        let mut count = 0;
        let mut number = vec![None; is_inner.len()];
        for number in number.iter_mut().zip(is_inner).filter_map(|(number, is)| is.then_some(number)) {
            *number = Some(count);
            count += 1;
        }
        if count == 0 || 3 * count > MOST_CONDENSED {
            return None;
        }
        let mut own = DMatrix::<f64>::zeros(3 * count, 3 * count);
        // A column for each row of what is returned: sums are added to places next to each other.
        let mut unbalanced = DMatrix::<f64>::zeros(ALL, 3 * count);
        for (voxel, matrices, share) in voxels {
            let weights = self.of_voxel(*voxel);
            let numbers: Vec<_> = corners_of(*voxel).map(|at| number[self.corners.index(at)]).collect();
            for (row, to) in numbers.iter().enumerate().filter_map(|(row, to)| Some((row, (*to)?))) {
                for (column, (weights, other)) in weights.iter().zip(&numbers).enumerate() {
                    for i in 0..3 {
                        let k = [0, 1, 2].map(|j| share * matrices.stiffness[3 * row + i][3 * column + j]);
                        let mut sums = unbalanced.column_mut(3 * to + i);
                        for (sums, weight) in sums.as_mut_slice().as_chunks_mut::<3>().0.iter_mut().zip(weights) {
                            (0..3).for_each(|j| sums[j] += k[j] * weight);
                        }
                        if let Some(other) = other {
                            (0..3).for_each(|j| own[(3 * to + i, 3 * other + j)] += k[j]);
                        }
                    }
                }
            }
        }
        Some((own, unbalanced.transpose()))
    }

    /// What `P^T K P` loses where corners that no other element has go where the voxels' stiffness takes them.
    fn relief(&self, voxels: &[Part<'_>]) -> Option<DMatrix<f64>> {
        let (own, mut unbalanced) = self.inner(voxels)?;
        // What hangs on by an edge of a voxel alone has no stiffness against turning there: it stays trilinear.
        let factor = Cholesky::new(own)?;
        factor.l_dirty().solve_lower_triangular_mut(&mut unbalanced);
        Some(unbalanced.tr_mul(&unbalanced))
    }
}

/// Adds the products of weights with a 3x3 block.
fn add_block(sum: &mut Whole, products: &[[f64; SHARES]; SHARES], block: impl Fn(usize, usize) -> f64) {
    for (p, row) in products.iter().enumerate() {
        for (i, j) in (0..9).map(|n| (n / 3, n % 3)) {
            let k = block(i, j);
            (0..SHARES).for_each(|q| sum[3 * p + i][3 * q + j] += k * row[q]);
        }
    }
}

type Whole = Box<[[f64; ALL]; ALL]>;

/// The blocks of a stiffness over corners and ground points.
fn split(whole: &Whole) -> (Box<Matrix24>, GroundStiffness) {
    let mean = |row: usize, column: usize| 0.5 * (whole[row][column] + whole[column][row]);
    let corners = Box::new(std::array::from_fn(|row| std::array::from_fn(|column| mean(row, column))));
    let coupling = Box::new(std::array::from_fn(|row| std::array::from_fn(|point| mean(row, DOFS + point))));
    let own = Box::new(std::array::from_fn(|row| std::array::from_fn(|point| mean(DOFS + row, DOFS + point))));
    (corners, GroundStiffness { coupling, own })
}

/// Matrices of an element of which some corners of voxels are held. `plain` are those it would have if none were,
/// `voxels` those of its voxels that are not held themselves, `single` the tables of one voxel.
#[must_use]
pub fn hold(
    plain: &ElementMatrices,
    corners: &VoxelCorners,
    voxels: &[HeldVoxel],
    single: &CompositeTables,
) -> ElementMatrices {
    let still = corners.still();
    if still != 0 && still != u8::MAX && corners.held_nodes(voxels.iter().map(|voxel| voxel.at)) == Some(still) {
        return hold_parts(plain, &VoxelCorners::of_nodes(still), &[([0; 3], plain, 1.0)]);
    }
    let mut made: Vec<(Elastic, ElementMatrices)> = Vec::new();
    for voxel in voxels {
        if !made.iter().any(|(elastic, _)| *elastic == voxel.elastic) {
            made.push((
                voxel.elastic,
                single.assemble(&[FilledVoxel::whole(0, voxel.elastic)], Field::IncompatibleModes),
            ));
        }
    }
    let of = |voxel: &HeldVoxel| &made.iter().find(|(elastic, _)| *elastic == voxel.elastic).expect("it was made").1;
    let voxels: Vec<_> = voxels.iter().map(|voxel| (voxel.at, of(voxel), voxel.share)).collect();
    hold_parts(plain, corners, &voxels)
}

/// The same of an element of parts, each a cell of `corners` with its matrices.
fn hold_parts(plain: &ElementMatrices, corners: &VoxelCorners, voxels: &[Part<'_>]) -> ElementMatrices {
    let displacements = Displacements::truncated(corners);
    let [mut whole, measured] = displacements.stiffness(voxels);
    let (measured, measured_ground) = split(&measured);
    if let Some(relief) = displacements.relief(voxels) {
        for (row, k) in whole.iter_mut().enumerate() {
            k.iter_mut().enumerate().for_each(|(column, k)| *k -= (1.0 - TRILINEAR) * relief[(row, column)]);
        }
    }
    tie_weak_nodes(&mut whole, plain, corners.lone);
    let (stiffness, ground) = split(&whole);
    let mut held = ElementMatrices {
        stiffness,
        stiffness_measured: measured,
        mass_kg: plain.mass_kg.map(|row| row.map(|m| LEFT_OVER * m)),
        mean_gradient: [[0.0; 3]; 8],
        volume_m3: 0.0,
        ground: None,
    };
    for (k, plain) in held.stiffness.as_flattened_mut().iter_mut().zip(plain.stiffness.as_flattened()) {
        *k += LEFT_OVER * plain;
    }
    for (voxel, matrices, share) in voxels {
        held.add_voxel(corners, *voxel, matrices, *share);
    }
    if voxels.is_empty() {
        held.volume_m3 = plain.volume_m3;
    } else {
        let volume_m3 = held.volume_m3;
        held.mean_gradient.iter_mut().flatten().for_each(|g| *g /= volume_m3);
    }
    held.ground = Some(Ground { stiffness: ground, measured: measured_ground });
    held
}

/// Ties `lone` nodes that hardly anything of the element resists to what is held: those of a sliver whose corners are held,
/// or next to what is. Nothing shows where they are, and a solve leaves them anywhere within its tolerance. But they carry
/// material again when links part or the element strains far, and then it is stretched to wherever they were left.
fn tie_weak_nodes(whole: &mut Whole, plain: &ElementMatrices, lone: u8) {
    for dof in (0..DOFS).filter(|dof| lone >> (dof / 3) & 1 == 1) {
        let missing = LEAST_RESISTED * plain.stiffness[dof][dof] - whole[dof][dof];
        if missing <= 0.0 {
            continue;
        }
        let (node, axis) = (dof / 3, dof % 3);
        // The node against where it would be if it went with what is held.
        let ground = (0..3).filter(|point| node >> point & 1 == 1).map(|point| (DOFS + 3 * point + axis, -1.0));
        let apart: Vec<(usize, f64)> = ground.chain([(dof, 1.0)]).collect();
        for (row, a) in &apart {
            apart.iter().for_each(|(column, b)| whole[*row][*column] += missing * a * b);
        }
    }
}

impl ElementMatrices {
    /// Adds a voxel's mass, volume and volume times mean gradient, through the trilinear displacements.
    fn add_voxel(&mut self, corners: &VoxelCorners, at: [i32; 3], voxel: &Self, share: f64) {
        let n: Vec<Option<[f64; 8]>> = corners_of(at)
            .map(|corner| (corners.at(corner) != Corner::Held).then(|| corners.moving(corners.local(corner))))
            .collect();
        for (c, n_c) in n.iter().enumerate().filter_map(|(c, n)| Some((c, (*n)?))) {
            for (d, n_d) in n.iter().enumerate().filter_map(|(d, n)| Some((d, (*n)?))) {
                let mass_kg = share * voxel.mass_kg[c][d];
                (0..8).for_each(|a| (0..8).for_each(|b| self.mass_kg[a][b] += mass_kg * n_c[a] * n_d[b]));
            }
            for a in 0..8 {
                (0..3).for_each(|i| {
                    self.mean_gradient[a][i] += share * voxel.volume_m3 * n_c[a] * voxel.mean_gradient[c][i]
                });
            }
        }
        self.volume_m3 += share * voxel.volume_m3;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const H_M: f64 = 0.01;

    /// What an element pushes its nodes back with where they and, after them, the ground points are moved, N.
    fn forces_n(element: &ElementMatrices, moved_m: &[f64; ALL]) -> [f64; DOFS] {
        let ground = element.ground.as_ref().expect("something of it is held");
        std::array::from_fn(|row| {
            let of_nodes: f64 = element.stiffness[row].iter().zip(moved_m).map(|(k, u)| k * u).sum();
            let of_ground: f64 = ground.stiffness.coupling[row].iter().zip(&moved_m[DOFS..]).map(|(k, u)| k * u).sum();
            of_nodes + of_ground
        })
    }

    #[test]
    fn a_node_that_only_a_held_sliver_has_is_tied_to_what_is_held_and_turns_with_it() {
        // Of a cell of 4 x 4 x 4 voxels the one at node 0 is left, and all its corners are held.
        let elastic = Elastic::new(1e6, 0.45, 1000.0);
        let plain = CompositeTables::new(2, H_M).assemble(&[FilledVoxel::whole(0, elastic)], Field::IncompatibleModes);
        let mut corners = VoxelCorners::new(2);
        corners_of([0; 3]).for_each(|at| corners.set(at, Corner::Held));
        // Node 0 is another element's, too.
        corners.set_nodes(0, 0b1111_1110);
        let sliver = [HeldVoxel { at: [0; 3], elastic, share: 1.0 }];
        let held = hold(&plain, &corners, &sliver, &CompositeTables::new(0, H_M));
        for dof in 0..DOFS {
            let share = held.stiffness[dof][dof] / plain.stiffness[dof][dof];
            if dof / 3 == 0 {
                assert!(share < 0.01, "node 0 is resisted by {share} of the plain element");
            } else {
                assert!(share > 0.09, "node {} is resisted by {share} of the plain element", dof / 3);
            }
        }
        // What is held turns in the frame of an element that turns, and the nodes with it: nothing resists that.
        let edge_m = 4.0 * H_M;
        let turned_m = |at: [f64; 3]| [-at[1] + 0.3 * at[2], at[0], -0.3 * at[0]].map(|x| 1e-3 * edge_m * x);
        let mut moved_m = [0.0; ALL];
        for node in 0..8 {
            let at = [0, 1, 2].map(|axis| f64::from(node as u8 >> axis & 1));
            moved_m[3 * node..3 * node + 3].copy_from_slice(&turned_m(at));
        }
        for point in 0..3 {
            let at = [0, 1, 2].map(|axis| if axis == point { 1.0 } else { 0.0 });
            moved_m[DOFS + 3 * point..DOFS + 3 * point + 3].copy_from_slice(&turned_m(at));
        }
        let stiffest_n_per_m = (0..DOFS).map(|dof| plain.stiffness[dof][dof]).fold(0.0, f64::max);
        let most_n = forces_n(&held, &moved_m).into_iter().map(f64::abs).fold(0.0, f64::max);
        assert!(most_n < 1e-9 * stiffest_n_per_m * edge_m, "{most_n} N of {stiffest_n_per_m} N/m");
    }
}
