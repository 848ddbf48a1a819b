//! What the elements of a level are made of: voxels, or elements of the level below.

use super::{Grid, Ijk};

/// What a level is built from.
pub trait Units {
    /// Number of units.
    fn len(&self) -> usize;
    /// Calls `visit` with each unit of a cell of the level above, given by its lower corner and size in
    /// lattice cells of that level, in a fixed order.
    fn in_cell(&self, cell: Ijk, size: i32, visit: &mut dyn FnMut(u32));
    /// Whether units fill a cell of the level above wholly.
    fn is_full(&self, cell: Ijk, size: i32) -> bool;
    /// Calls `visit(face, other)` for each unit linked to `unit`.
    fn neighbours(&self, unit: u32, visit: &mut dyn FnMut(u8, u32));
}

/// Voxels as the units of a base level of 2^exponent voxels a side.
pub struct VoxelUnits<'a> {
    /// The voxels.
    pub grid: &'a Grid,
    /// log2 of the base level's cell edge in voxels.
    pub exponent: u8,
}

impl Units for VoxelUnits<'_> {
    fn len(&self) -> usize {
        self.grid.voxels().len()
    }

    fn in_cell(&self, cell: Ijk, size: i32, visit: &mut dyn FnMut(u32)) {
        let [x, y, z] = cell.map(|c| c << self.exponent..(c + size) << self.exponent);
        for z in z {
            for y in y.clone() {
                for x in x.clone() {
                    if let Some(voxel) = self.grid.voxel_at([x, y, z]) {
                        visit(voxel.0);
                    }
                }
            }
        }
    }

    fn is_full(&self, cell: Ijk, size: i32) -> bool {
        let mut count = 0;
        self.in_cell(cell, size, &mut |_| count += 1);
        count == (size << self.exponent).pow(3)
    }

    fn neighbours(&self, unit: u32, visit: &mut dyn FnMut(u8, u32)) {
        let cell = self.grid.voxels()[unit as usize].ijk;
        for (face, (link, other)) in Grid::links_of(cell).enumerate() {
            if self.grid.is_intact(link)
                && let Some(voxel) = self.grid.voxel_at(other)
            {
                visit(face as u8, voxel.0);
            }
        }
    }
}
