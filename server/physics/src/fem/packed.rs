//! The packed matrices of a block of elements, one per lane; where all are that of one whole cell, stored
//! once and applied through its symmetry.
//!
//! A whole cell of one material has the matrix of every other such cell, and is its own mirror image in
//! three planes. The Walsh-Hadamard transform over the corners takes such a matrix apart into eight 3x3
//! blocks: component i at the frequency s (three bits, one per axis) is even or odd under each mirror as
//! `s xor e_i` says, and only what is alike under all three is coupled. 72 products and 144 sums stand
//! for 576 products, and there is next to nothing to read.

use super::lanes::{self, LaneVector, PACKED, unpack};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::sync::Arc;
use wide::f64x4;

/// Distinct shared matrices that are kept track of; more of them would save little and be searched long.
pub const MOST_SHARED: usize = 32;
/// Entries of the eight symmetric 3x3 blocks.
const MODES: usize = 48;

/// The matrix of a whole cell.
pub struct WholeCell<S> {
    packed: [S; PACKED],
    /// For each symmetry class, the lower triangle over its three modes, by rows; 1/64 of the transform.
    modes: [S; MODES],
}

/// Packed symmetric 24x24 matrices of the elements of a block. Read from a file, the matrix of a whole cell is that
/// block's own.
#[derive(Clone)]
pub enum PackedMatrix<L: LaneVector> {
    /// One for each lane.
    Each(Box<[L; PACKED]>),
    /// That of a whole cell in all lanes.
    Whole(Arc<WholeCell<L::Scalar>>),
}

/// As it is walked: the entries one after the other.
#[derive(Serialize, Deserialize)]
enum Entries<E, W> {
    Each(E),
    Whole(W),
}

impl<L: LaneVector + Serialize> Serialize for PackedMatrix<L>
where
    L::Scalar: Serialize,
{
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let entries: Entries<&[L], &[L::Scalar]> = match self {
            Self::Each(k) => Entries::Each(&k[..]),
            Self::Whole(cell) => Entries::Whole(&cell.packed[..]),
        };
        entries.serialize(serializer)
    }
}

impl<'de, L: LaneVector + Deserialize<'de>> Deserialize<'de> for PackedMatrix<L>
where
    L::Scalar: Deserialize<'de>,
{
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let count = |_| D::Error::custom(format!("a packed matrix has {PACKED} entries"));
        Ok(match Entries::<Vec<L>, Vec<L::Scalar>>::deserialize(deserializer)? {
            Entries::Each(k) => Self::Each(k.try_into().map_err(|_| count(()))?),
            Entries::Whole(packed) => {
                let packed: [L::Scalar; PACKED] = packed.try_into().map_err(|_| count(()))?;
                let modes = modes::<L>(&packed.map(Into::into));
                let modes = modes.ok_or_else(|| D::Error::custom("a matrix is not that of a whole cell"))?;
                Self::Whole(Arc::new(WholeCell { packed, modes }))
            }
        })
    }
}

/// Matrices that whole blocks have in common.
pub type Shared<L> = Vec<Arc<WholeCell<<L as LaneVector>::Scalar>>>;

/// Zero, which copies have in common until they are written.
impl<L: LaneVector> Default for PackedMatrix<L> {
    fn default() -> Self {
        let zero = L::narrow(0.0);
        Self::Whole(Arc::new(WholeCell { packed: [zero; PACKED], modes: [zero; MODES] }))
    }
}

impl<L: LaneVector> PackedMatrix<L> {
    /// An entry of every lane.
    #[inline(always)]
    #[must_use]
    pub fn entry(&self, index: usize) -> L {
        match self {
            Self::Each(k) => k[index],
            Self::Whole(cell) => L::splat(cell.packed[index]),
        }
    }

    /// An entry of one lane.
    #[must_use]
    pub fn at(&self, index: usize, lane: usize) -> f64 {
        match self {
            Self::Each(k) => k[index].lane(lane).into(),
            Self::Whole(cell) => cell.packed[index].into(),
        }
    }

    /// Sets the matrix of a lane.
    pub fn set(&mut self, lane: usize, packed: &[f64; PACKED]) {
        self.write(std::iter::once(lane), |index, _| packed[index]);
    }

    /// Sets the matrices of those of four lanes from `first` on that are `written`.
    pub fn set_lanes(&mut self, first: usize, packed: &[f64x4; PACKED], written: [bool; 4]) {
        let lanes = (0..4).filter(|lane| written[*lane]).map(|lane| first + lane);
        self.write(lanes, |index, lane| packed[index].as_array()[lane - first]);
    }

    fn write(&mut self, lanes: impl Iterator<Item = usize> + Clone, value: impl Fn(usize, usize) -> f64) {
        if let Self::Whole(cell) = self {
            let is_same = |lane| (0..PACKED).all(|i| cell.packed[i] == L::narrow(value(i, lane)));
            if lanes.clone().all(is_same) {
                return;
            }
            let mut each = Box::new([L::ZERO; PACKED]);
            (0..PACKED).for_each(|i| each[i] = L::splat(cell.packed[i]));
            *self = Self::Each(each);
        }
        if let Self::Each(k) = self {
            for (i, entry) in k.iter_mut().enumerate() {
                lanes.clone().for_each(|lane| entry.set_lane(lane, L::narrow(value(i, lane))));
            }
        }
    }

    /// Stores the matrix once if it is that of one whole cell in all lanes.
    pub fn share(&mut self, shared: &mut Shared<L>) {
        let Self::Each(k) = self else { return };
        if !k.iter().all(|entry| (1..L::LANES).all(|lane| entry.lane(lane) == entry.lane(0))) {
            return;
        }
        let packed: [L::Scalar; PACKED] = std::array::from_fn(|i| k[i].lane(0));
        if let Some(known) = shared.iter().find(|cell| cell.packed == packed) {
            *self = Self::Whole(Arc::clone(known));
        } else if let Some(modes) = modes::<L>(&packed.map(Into::into)) {
            let cell = Arc::new(WholeCell { packed, modes });
            if shared.len() < MOST_SHARED {
                shared.push(Arc::clone(&cell));
            }
            *self = Self::Whole(cell);
        }
    }

    /// `y_n = K u_n` for each of several vectors.
    #[inline(always)]
    pub fn apply_to_each<const N: usize>(&self, u: &[[L; 24]; N]) -> [[L; 24]; N] {
        match self {
            Self::Each(k) => lanes::apply_to_each(k, u),
            Self::Whole(cell) => {
                let mut y = *u;
                y.iter_mut().for_each(|y| cell.apply::<L>(y));
                y
            }
        }
    }

    /// The same of matrices that do not resist translation, where the first corner of every vector is zero.
    #[inline(always)]
    pub fn apply_from_first_corner<const N: usize>(&self, u: &[[L; 24]; N]) -> [[L; 24]; N] {
        match self {
            Self::Each(k) => lanes::apply_from_first_corner(k, u),
            Self::Whole(_) => self.apply_to_each(u),
        }
    }

    /// `y = K u`.
    #[inline(always)]
    pub fn apply(&self, u: &[L; 24]) -> [L; 24] {
        match self {
            Self::Each(k) => {
                let [y] = lanes::apply_to_each(k, std::array::from_ref(u));
                y
            }
            Self::Whole(cell) => {
                let mut y = *u;
                cell.apply::<L>(&mut y);
                y
            }
        }
    }
}

impl<S: Copy> WholeCell<S> {
    /// `u = K u`.
    #[inline(always)]
    fn apply<L: LaneVector<Scalar = S>>(&self, u: &mut [L; 24]) {
        transform(u);
        for class in 0..8 {
            let m = &self.modes[6 * class..6 * class + 6];
            let m = |i: usize| L::splat(m[i]);
            let [x, y, z] = class_slots(class);
            let v = [u[x], u[y], u[z]];
            u[x] = m(0).fma(v[0], m(1).fma(v[1], m(3) * v[2]));
            u[y] = m(1).fma(v[0], m(2).fma(v[1], m(4) * v[2]));
            u[z] = m(3).fma(v[0], m(4).fma(v[1], m(5) * v[2]));
        }
        transform(u);
    }
}

/// Slots of the components x, y and z that share a symmetry class.
#[inline(always)]
const fn class_slots(class: usize) -> [usize; 3] {
    [3 * (class ^ 1), 3 * (class ^ 2) + 1, 3 * (class ^ 4) + 2]
}

/// Walsh-Hadamard transform over the corners, each component by itself; twice is eight times the vector.
#[inline(always)]
fn transform<L: LaneVector>(v: &mut [L; 24]) {
    for bit in [1, 2, 4] {
        for corner in 0..8 {
            if corner & bit == 0 {
                for i in 0..3 {
                    let (low, high) = (v[3 * corner + i], v[3 * (corner | bit) + i]);
                    v[3 * corner + i] = low + high;
                    v[3 * (corner | bit) + i] = low - high;
                }
            }
        }
    }
}

/// The 3x3 blocks of a matrix that has a whole cell's symmetry; `None` if it has not.
fn modes<L: LaneVector>(packed: &[f64; PACKED]) -> Option<[L::Scalar; MODES]> {
    let full = unpack(packed);
    let sign = |s: usize, corner: usize| if (s & corner).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 };
    let mut half = [[0.0; 24]; 24];
    for (row, half) in half.iter_mut().enumerate() {
        for (column, value) in half.iter_mut().enumerate() {
            *value = (0..8).map(|a| sign(row / 3, a) * full[3 * a + row % 3][column]).sum();
        }
    }
    let entry = |row: usize, column: usize| -> f64 {
        (0..8).map(|b| sign(column / 3, b) * half[row][3 * b + column % 3]).sum::<f64>() / 64.0
    };
    let class = |slot: usize| (slot / 3) ^ (1 << (slot % 3));
    let size = (0..24).map(|slot| entry(slot, slot).abs()).fold(0.0, f64::max);
    let alike = |row: usize| (0..24).all(|c| class(c) == class(row) || entry(row, c).abs() <= L::ROUNDING * size);
    if !(0..24).all(alike) {
        return None;
    }
    let mut modes = [L::narrow(0.0); MODES];
    for c in 0..8 {
        let slots = class_slots(c);
        for (index, (i, j)) in [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)].into_iter().enumerate() {
            modes[6 * c + index] = L::narrow(entry(slots[i], slots[j]));
        }
    }
    Some(modes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::composite::{CompositeTables, Field, FilledVoxel};
    use crate::fem::lanes::pack;
    use crate::fem::material::Elastic;

    /// Stiffness of a cell of 2^3 voxels, all filled or all but one.
    fn stiffness(whole: bool) -> [f64; PACKED] {
        let tables = CompositeTables::new(1, 0.01);
        let elastic = Elastic::new(1e6, 0.45, 1000.0);
        let filled: Vec<_> = (usize::from(!whole)..8).map(|voxel| FilledVoxel::whole(voxel, elastic)).collect();
        pack(&tables.assemble(&filled, Field::IncompatibleModes).stiffness)
    }

    fn block(matrix: &[f64; PACKED]) -> PackedMatrix<f64x4> {
        let mut block = PackedMatrix::default();
        (0..f64x4::LANES).for_each(|lane| block.set(lane, matrix));
        block
    }

    #[test]
    fn a_whole_cell_is_stored_once_and_gives_the_same_product() {
        let (mut shared, each) = (Shared::<f64x4>::new(), block(&stiffness(true)));
        let (mut one, mut other) = (each.clone(), each.clone());
        one.share(&mut shared);
        other.share(&mut shared);
        assert!(matches!((&one, &other), (PackedMatrix::Whole(_), PackedMatrix::Whole(_))));
        assert_eq!(shared.len(), 1, "two blocks with one matrix share it");
        let u = std::array::from_fn(|i| f64x4::splat((i as f64).sin()));
        for (a, b) in one.apply(&u).into_iter().zip(each.apply(&u)) {
            let (a, b) = (a.to_array()[1], b.to_array()[1]);
            assert!((a - b).abs() < 1e-10 * 1e4, "{a} N against {b} N, of some 1e4 N/m by 1 m");
        }
    }

    #[test]
    fn a_cell_that_is_not_whole_or_changes_keeps_a_matrix_of_its_own() {
        let mut shared = Shared::<f64x4>::new();
        let mut partial = block(&stiffness(false));
        partial.share(&mut shared);
        assert!(matches!(partial, PackedMatrix::Each(_)));

        let mut whole = block(&stiffness(true));
        whole.share(&mut shared);
        let before = whole.at(5, 2);
        whole.set(3, &stiffness(false));
        assert_eq!((whole.at(5, 2), whole.at(5, 3)), (before, stiffness(false)[5]));
        whole.share(&mut shared);
        assert!(matches!(whole, PackedMatrix::Each(_)), "lanes differ");
    }
}
