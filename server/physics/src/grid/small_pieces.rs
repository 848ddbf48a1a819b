//! Small pieces: voxels at a shape's thin parts that hang together with next to nothing.

use super::lattice::Lattice;
use super::{LEAST_PIECE_VOXELS, LinkId};

/// Pieces of fewer than [`LEAST_PIECE_VOXELS`] that are left out of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// How many.
    pub pieces: u32,
    /// Voxels of all of them.
    pub voxels: u32,
    /// Voxels of the smallest.
    pub smallest: u32,
}

/// Empties the cells of pieces below the least, unless there is no larger one; calls `emptied` with the slot of
/// each.
pub(super) fn leave_out(lattice: &Lattice, inside: &mut [bool], mut emptied: impl FnMut(usize)) -> LeftOut {
    let mut seen = vec![false; inside.len()];
    let (mut small, mut is_large) = (Vec::new(), false);
    for start in lattice.cells() {
        let slot = lattice.slot(start);
        if !inside[slot] || std::mem::replace(&mut seen[slot], true) {
            continue;
        }
        let (mut piece, mut next) = (vec![start], 0);
        while let Some(&cell) = piece.get(next) {
            next += 1;
            for axis in 0..3 {
                let mut lower = cell;
                lower[axis] -= 1;
                for other in [lower, LinkId { cell, axis: axis as u8 }.upper()] {
                    let fits = (0..3).all(|a| (-1..=lattice.dims[a]).contains(&other[a]));
                    let slot = if fits { lattice.slot(other) } else { continue };
                    if inside[slot] && !std::mem::replace(&mut seen[slot], true) {
                        piece.push(other);
                    }
                }
            }
        }
        if piece.len() < LEAST_PIECE_VOXELS {
            small.push(piece);
        } else {
            is_large = true;
        }
    }
    let Some(smallest) = small.iter().map(Vec::len).min().filter(|_| is_large) else { return LeftOut::default() };
    for slot in small.iter().flatten().map(|cell| lattice.slot(*cell)) {
        inside[slot] = false;
        emptied(slot);
    }
    let voxels: usize = small.iter().map(Vec::len).sum();
    LeftOut { pieces: small.len() as u32, voxels: voxels as u32, smallest: smallest as u32 }
}
