//! How lattice cells are grouped into the cells of composite elements: all alike, or smaller in some
//! regions than elsewhere.

use super::Ijk;
use serde::{Deserialize, Serialize};

/// How the lattice cells of a level are grouped into the cells of its elements.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CellSizes {
    /// Number of lattice cells along each axis: a multiple of the largest cell.
    pub(super) dims: [i32; 3],
    /// log2 of the size of the cell that each lattice cell lies in, x fastest.
    log2: Vec<u8>,
}

impl CellSizes {
    /// The cells of a base level over `dims` lattice cells where each lattice cell wants to lie in a cell
    /// of at most 2^`finest` times its own edge: each cell is as large as all of it allows, at most
    /// 2^`largest`, and touches none of less than half or more than twice its size.
    #[must_use]
    pub fn graded(dims: [i32; 3], largest: u8, finest: impl Fn(Ijk) -> u8) -> Self {
        let step = 1 << largest;
        let mut sizes = Self::uniform(dims.map(|d| (d + step - 1) / step * step));
        let cells: Vec<Ijk> = sizes.lattice().collect();
        for (&cell, log2) in cells.iter().zip(&mut sizes.log2) {
            *log2 = if (0..3).all(|a| cell[a] < dims[a]) { finest(cell).min(largest) } else { largest };
        }
        // From the smallest up: what is split here touches nothing that would have to be split again.
        for log2 in 1..=largest {
            sizes.split_where_too_large(&cells, log2);
        }
        sizes
    }

    /// Splits the cells of 2^`log2` a side that hold a lattice cell that wants a smaller one, or touch a
    /// lattice cell that wants one of less than half that.
    fn split_where_too_large(&mut self, cells: &[Ijk], log2: u8) {
        let size = 1 << log2;
        let corners = || cells.iter().filter(|c| c.iter().all(|x| x % size == 0));
        let within = |corner: &Ijk, margin: i32| {
            let [x, y, z] = corner.map(|c| c - margin..c + size + margin);
            z.flat_map(move |z| {
                let x = x.clone();
                y.clone().flat_map(move |y| x.clone().map(move |x| [x, y, z]))
            })
        };
        let wants = |sizes: &Self, cell: Ijk| sizes.slot(cell).map_or(log2, |slot| sizes.log2[slot]);
        let split: Vec<&Ijk> = corners()
            .filter(|corner| {
                within(corner, 0).any(|c| wants(self, c) < log2) || within(corner, 1).any(|c| wants(self, c) + 1 < log2)
            })
            .collect();
        for corner in split {
            for cell in within(corner, 0) {
                let slot = self.slot(cell).expect("the lattice is a multiple of the largest cell");
                self.log2[slot] = self.log2[slot].min(log2 - 1);
            }
        }
    }

    /// Every lattice cell is a cell.
    #[must_use]
    pub fn uniform(dims: [i32; 3]) -> Self {
        Self { dims, log2: vec![0; dims.iter().map(|d| *d as usize).product()] }
    }

    /// The cells of the level above.
    pub(super) fn grown(&self) -> Self {
        let mut above = Self::uniform(self.dims.map(|d| (d + 1) / 2));
        let cells: Vec<Ijk> = above.lattice().collect();
        for (cell, log2) in cells.into_iter().zip(&mut above.log2) {
            let slot = self.slot(cell.map(|c| 2 * c)).expect("half of it lies inside");
            *log2 = self.log2[slot].saturating_sub(1);
        }
        above
    }

    /// Number of lattice cells.
    pub(super) fn len(&self) -> usize {
        self.log2.len()
    }

    /// All lattice cells, x fastest.
    pub(super) fn lattice(&self) -> impl Iterator<Item = Ijk> + use<> {
        let [nx, ny, nz] = self.dims;
        (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
    }

    /// Place of a lattice cell among all of them; `None` outside the lattice.
    pub(super) fn slot(&self, cell: Ijk) -> Option<usize> {
        let inside = (0..3).all(|a| (0..self.dims[a]).contains(&cell[a]));
        inside.then(|| ((cell[2] * self.dims[1] + cell[1]) * self.dims[0] + cell[0]) as usize)
    }

    /// Size of the cell that a lattice cell lies in; `None` outside the lattice.
    pub(crate) fn at(&self, cell: Ijk) -> Option<i32> {
        self.slot(cell).map(|slot| 1 << self.log2[slot])
    }

    /// Lower corner and size of the cell that a lattice cell lies in; `None` outside the lattice.
    pub(super) fn cell_of(&self, cell: Ijk) -> Option<(Ijk, i32)> {
        self.at(cell).map(|size| (cell.map(|c| c & -size), size))
    }
}
