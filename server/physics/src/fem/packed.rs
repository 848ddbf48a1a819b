//! The packed matrices of a block of elements, one per lane; where they are all the same, stored once.
//!
//! A whole cell of one material has the matrix of every other such cell, and reading matrices is most
//! of what a product costs: inside a body it is shared.

use super::lanes::{self, LaneVector, PACKED};
use std::sync::Arc;

/// Distinct shared matrices that are kept track of; more of them would save little and be searched long.
const MOST_SHARED: usize = 32;

/// Packed symmetric 24x24 matrices of the elements of a block.
#[derive(Clone)]
pub enum PackedMatrix<L: LaneVector> {
    /// One for each lane.
    Each(Box<[L; PACKED]>),
    /// The same for all lanes.
    Same(Arc<[L::Scalar; PACKED]>),
}

/// Matrices that whole blocks have in common.
pub type Shared<L> = Vec<Arc<[<L as LaneVector>::Scalar; PACKED]>>;

impl<L: LaneVector> Default for PackedMatrix<L> {
    fn default() -> Self {
        Self::Each(Box::new([L::ZERO; PACKED]))
    }
}

impl<L: LaneVector> PackedMatrix<L> {
    /// An entry of every lane.
    #[inline(always)]
    #[must_use]
    pub fn entry(&self, index: usize) -> L {
        match self {
            Self::Each(k) => k[index],
            Self::Same(k) => L::splat(k[index]),
        }
    }

    /// An entry of one lane.
    #[must_use]
    pub fn at(&self, index: usize, lane: usize) -> f64 {
        match self {
            Self::Each(k) => k[index].lane(lane).into(),
            Self::Same(k) => k[index].into(),
        }
    }

    /// Sets the matrix of a lane.
    pub fn set(&mut self, lane: usize, packed: &[f64; PACKED]) {
        if let Self::Same(shared) = self {
            if (0..PACKED).all(|i| shared[i] == L::narrow(packed[i])) {
                return;
            }
            let mut each = Box::new([L::ZERO; PACKED]);
            (0..PACKED).for_each(|i| each[i] = L::splat(shared[i]));
            *self = Self::Each(each);
        }
        if let Self::Each(k) = self {
            (0..PACKED).for_each(|i| k[i].set_lane(lane, L::narrow(packed[i])));
        }
    }

    /// Stores the matrix once if it is the same in all lanes.
    pub fn share(&mut self, shared: &mut Shared<L>) {
        let Self::Each(k) = self else { return };
        if !k.iter().all(|entry| (1..L::LANES).all(|lane| entry.lane(lane) == entry.lane(0))) {
            return;
        }
        let same: [L::Scalar; PACKED] = std::array::from_fn(|i| k[i].lane(0));
        let known = shared.iter().find(|s| ***s == same).cloned();
        *self = Self::Same(known.unwrap_or_else(|| {
            let new = Arc::new(same);
            if shared.len() < MOST_SHARED {
                shared.push(Arc::clone(&new));
            }
            new
        }));
    }

    /// `y_n = K u_n` for each of several vectors.
    #[inline(always)]
    pub fn apply_to_each<const N: usize>(&self, u: &[[L; 24]; N]) -> [[L; 24]; N] {
        match self {
            Self::Each(k) => lanes::apply_to_each(|i| k[i], u),
            Self::Same(k) => lanes::apply_to_each(|i| L::splat(k[i]), u),
        }
    }

    /// `y = K u`.
    #[inline(always)]
    pub fn apply(&self, u: &[L; 24]) -> [L; 24] {
        match self {
            Self::Each(k) => lanes::apply(|i| k[i], u),
            Self::Same(k) => lanes::apply(|i| L::splat(k[i]), u),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wide::f32x8;

    fn matrix(scale: f64) -> [f64; PACKED] {
        std::array::from_fn(|i| scale * (1.0 + (i * 37 % 101) as f64))
    }

    #[test]
    fn a_matrix_that_all_lanes_have_is_stored_once_and_gives_the_same_bits() {
        let mut block = PackedMatrix::<f32x8>::default();
        (0..f32x8::LANES).for_each(|lane| block.set(lane, &matrix(1.0)));
        let (each, u) = (block.clone(), std::array::from_fn(|i| f32x8::splat((i as f32).sin())));
        let mut shared = Shared::<f32x8>::new();
        block.share(&mut shared);
        assert!(matches!(block, PackedMatrix::Same(_)));
        assert_eq!(block.apply(&u).map(|y| y.to_array()), each.apply(&u).map(|y| y.to_array()));

        let mut other = each;
        other.share(&mut shared);
        assert_eq!(shared.len(), 1, "two blocks with one matrix share it");
        other.set(3, &matrix(2.0));
        assert_eq!((other.at(5, 2), other.at(5, 3)), (block.at(5, 2), 2.0 * block.at(5, 2)));
        other.share(&mut shared);
        assert!(matches!(other, PackedMatrix::Each(_)), "lanes differ");
    }
}
