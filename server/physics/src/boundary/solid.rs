//! What a boundary bounds.

use crate::Vec3;
use crate::grid::levels::Level;
use crate::grid::{Grid, VoxelId};

/// Voxels and the elements made of them: what a boundary bounds.
#[derive(Clone, Copy)]
pub(crate) struct Solid<'a> {
    /// Voxels and links.
    pub(crate) grid: &'a Grid,
    /// The elements that are solved on.
    pub(crate) level: &'a Level,
}

impl Solid<'_> {
    /// Element of a voxel.
    pub(super) fn owner(&self, voxel: VoxelId) -> u32 {
        self.level.owner[voxel.index()]
    }

    /// Coordinates of a reference position in the cell of an element; 0..=1 inside it.
    pub(crate) fn local_coordinates(&self, element: usize, position_m: &Vec3) -> [f64; 3] {
        let lattice_edge_m = self.grid.voxel_size_m() * f64::from(1u32 << self.level.exponent);
        let at = (position_m - self.grid.origin_m()) / lattice_edge_m;
        self.level.elements[element].place().local_coordinates(&at)
    }
}
