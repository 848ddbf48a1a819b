//! The lattice of cells that a shape is sampled on.

use super::{Grid, Ijk};
use crate::Vec3;
use crate::scene::SceneError;
use crate::scene::wording::brief;

/// Cells of one object's lattice, margin included. At 11 bytes a cell while it is sampled this is 180 MB.
pub const MAX_CELLS: f64 = (1u64 << 24) as f64;

/// A share of a voxel by which a shape may exceed a whole number of voxels and still count as whole:
/// far above the rounding of `(max - min) / h`, far below anything visible.
const WHOLE: f64 = 1e-6;

/// An axis-aligned box, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner, m.
    pub min_m: Vec3,
    /// Upper corner, m.
    pub max_m: Vec3,
}

impl Bounds {
    /// The box that holds every point; `None` without points.
    pub(crate) fn of(points: impl Iterator<Item = Vec3>) -> Option<Self> {
        points.map(|p| Self { min_m: p, max_m: p }).reduce(Self::with)
    }

    /// The box that holds both.
    #[must_use]
    pub(crate) fn with(self, other: Self) -> Self {
        Self { min_m: self.min_m.inf(&other.min_m), max_m: self.max_m.sup(&other.max_m) }
    }

    /// Edge lengths, m.
    #[must_use]
    pub fn extent_m(&self) -> Vec3 {
        self.max_m - self.min_m
    }
}

/// Cells `0..dims` of edge `voxel_size_m` with a margin of one cell on every side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lattice {
    pub(super) origin_m: Vec3,
    pub(super) voxel_size_m: f64,
    pub(super) dims: [i32; 3],
}

impl Lattice {
    /// The smallest lattice that covers `bounds` grown by `bulge_m`, centred on `bounds`: a box of a
    /// whole number of voxels is filled by exactly those voxels.
    pub(super) fn over(bounds: &Bounds, bulge_m: f64, voxel_size_m: f64) -> Result<Self, SceneError> {
        let across = bounds.extent_m() / voxel_size_m;
        let margin = (bulge_m / voxel_size_m).ceil();
        let dims = across.map(|n| (n - WHOLE).ceil().max(1.0) + 2.0 * margin);
        let cells: f64 = dims.iter().map(|d| d + 2.0).product();
        if cells > MAX_CELLS {
            let message = format!(
                "{} m gives a lattice of {:.0} x {:.0} x {:.0} cells, more than {MAX_CELLS} in all: the shape is {} m \
                 long; take larger voxels, or, where it is not meant to be so long, the right unit (metres; of a mesh: \
                 scale_m_per_unit)",
                brief(voxel_size_m),
                dims.x,
                dims.y,
                dims.z,
                brief(bounds.extent_m().max()),
            );
            return Err(SceneError::Field { field: "voxel_size_m".into(), message });
        }
        let centre_m = (bounds.min_m + bounds.max_m) / 2.0;
        Ok(Self {
            origin_m: centre_m - dims * (voxel_size_m / 2.0),
            voxel_size_m,
            dims: [dims.x as i32, dims.y as i32, dims.z as i32],
        })
    }

    /// The lattice that a grid stands on.
    pub(super) fn of(grid: &Grid) -> Self {
        Self { origin_m: grid.origin_m(), voxel_size_m: grid.voxel_size_m(), dims: grid.dims() }
    }

    /// The part of the lattice from `first` to `last`, both included.
    pub(super) fn part(&self, first: Ijk, last: Ijk) -> Self {
        let offset = Vec3::from_fn(|a, _| f64::from(first[a]) * self.voxel_size_m);
        Self {
            origin_m: self.origin_m + offset,
            voxel_size_m: self.voxel_size_m,
            dims: std::array::from_fn(|a| last[a] - first[a] + 1),
        }
    }

    /// Number of cells, margin included.
    pub(super) fn len(&self) -> usize {
        self.dims.iter().map(|d| (d + 2) as usize).product()
    }

    /// Index of a cell of `-1..dims + 1`, x fastest.
    pub(super) fn slot(&self, cell: Ijk) -> usize {
        (0..3).rev().fold(0, |slot, a| slot * (self.dims[a] + 2) as usize + (cell[a] + 1) as usize)
    }

    /// Every cell, margin included, in the order of [`Self::slot`].
    pub(super) fn cells(self) -> impl Iterator<Item = Ijk> {
        let [nx, ny, nz] = self.dims;
        (-1..=nz).flat_map(move |k| (-1..=ny).flat_map(move |j| (-1..=nx).map(move |i| [i, j, k])))
    }

    /// Coordinate of the centres of the cells with index `i` on an axis, m.
    pub(super) fn centre_on_axis_m(&self, axis: usize, i: i32) -> f64 {
        self.origin_m[axis] + (f64::from(i) + 0.5) * self.voxel_size_m
    }

    /// Centre of a cell, m.
    pub(super) fn centre_m(&self, cell: Ijk) -> Vec3 {
        Vec3::from_fn(|a, _| self.centre_on_axis_m(a, cell[a]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(edge_m: f64) -> Bounds {
        Bounds { min_m: Vec3::zeros(), max_m: Vec3::repeat(edge_m) }
    }

    #[test]
    fn a_whole_number_of_voxels_is_covered_exactly_whatever_the_rounding() {
        for (n, h) in [(30, 0.0025), (7, 0.1), (46, 1.0 / 3.0), (22, 0.003)] {
            let lattice = Lattice::over(&cube(f64::from(n) * h), 0.0, h).unwrap();
            assert_eq!(lattice.dims, [n; 3]);
            assert!(lattice.origin_m.amax() < 1e-12);
        }
    }

    #[test]
    fn a_broken_number_of_voxels_is_covered_and_centred() {
        let lattice = Lattice::over(&cube(1.05), 0.0, 0.1).unwrap();
        assert_eq!(lattice.dims, [11; 3]);
        assert!((lattice.origin_m.x + 0.025).abs() < 1e-12);
    }

    #[test]
    fn slots_follow_the_order_of_the_cells() {
        let lattice = Lattice { origin_m: Vec3::zeros(), voxel_size_m: 1.0, dims: [2, 3, 4] };
        assert!(lattice.cells().enumerate().all(|(i, cell)| lattice.slot(cell) == i));
        assert_eq!(lattice.cells().count(), lattice.len());
    }
}
