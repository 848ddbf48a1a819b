//! Numbers of cells, links and dual cells, and which of them are neighbours.

use std::ops::{Range, RangeInclusive};

use crate::grid::{Grid, Ijk, LinkId};

/// The cells of the box `-1..dims + 1`, numbered x fastest; a dual cell has the number of its lowest
/// corner, a link that of its lower cell times three plus its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Lattice {
    /// Cells along each axis, the layer outside the object on either side included.
    cells: [u32; 3],
}

/// The links of a dual cell: corner at the lower end, and axis.
pub(super) const DUAL_CELL_LINKS: [(usize, u8); 12] =
    [(0, 0), (2, 0), (4, 0), (6, 0), (0, 1), (1, 1), (4, 1), (5, 1), (0, 2), (1, 2), (2, 2), (3, 2)];

/// The cell at corner `corner` of a dual cell.
pub(super) fn corner_cell(dual_cell: Ijk, corner: usize) -> Ijk {
    std::array::from_fn(|axis| dual_cell[axis] + (corner >> axis & 1) as i32)
}

impl Lattice {
    pub(super) fn new(grid: &Grid) -> Self {
        Self { cells: grid.dims().map(|d| d as u32 + 2) }
    }

    pub(super) fn cell_index(self, cell: Ijk) -> u32 {
        let [i, j, k] = cell.map(|c| (c + 1) as u32);
        (k * self.cells[1] + j) * self.cells[0] + i
    }

    pub(super) fn cell(self, index: u32) -> Ijk {
        let row = index / self.cells[0];
        [index % self.cells[0], row % self.cells[1], row / self.cells[1]].map(|c| c as i32 - 1)
    }

    pub(super) fn link_index(self, link: LinkId) -> u32 {
        self.cell_index(link.cell) * 3 + u32::from(link.axis)
    }

    pub(super) fn link(self, index: u32) -> LinkId {
        LinkId { cell: self.cell(index / 3), axis: (index % 3) as u8 }
    }

    /// The four dual cells around a link with an end inside, counter-clockwise seen from its upper
    /// end, each with the corner the link's lower end is at.
    pub(super) fn around(self, link: LinkId) -> [(u32, usize); 4] {
        let (u, v) = ((link.axis as usize + 1) % 3, (link.axis as usize + 2) % 3);
        [(1, 1), (0, 1), (0, 0), (1, 0)].map(|(at_u, at_v)| {
            let mut dual_cell = link.cell;
            dual_cell[u] -= at_u;
            dual_cell[v] -= at_v;
            (self.cell_index(dual_cell), (at_u as usize) << u | (at_v as usize) << v)
        })
    }

    /// The twelve links of a dual cell.
    pub(super) fn links_of(self, dual_cell: u32) -> [u32; 12] {
        let cell = self.cell(dual_cell);
        DUAL_CELL_LINKS.map(|(corner, axis)| self.link_index(LinkId { cell: corner_cell(cell, corner), axis }))
    }

    /// The cells at such distances along each axis from a run of cells in a row along x, in such runs.
    pub(super) fn near(self, cells: Range<u32>, distances: RangeInclusive<i32>) -> impl Iterator<Item = Range<u32>> {
        let (first, counts) = (self.cell(cells.start), self.cells.map(|n| n as i32));
        let last = [first[0] + cells.len() as i32 - 1, first[1], first[2]];
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let (first, last) = (first[axis] + distances.start(), last[axis] + distances.end());
            first.max(-1)..(last + 1).min(counts[axis] - 1)
        });
        z.flat_map(move |k| y.clone().map(move |j| [j, k])).map(move |[j, k]| {
            let first = self.cell_index([x.start, j, k]);
            first..first + x.len() as u32
        })
    }

    /// Cells, ascending, in runs along x.
    pub(super) fn rows(self, cells: &[u32]) -> impl Iterator<Item = Range<u32>> {
        let runs = cells.chunk_by(move |a, b| a + 1 == *b && b % self.cells[0] != 0);
        runs.map(|run| run[0]..run[run.len() - 1] + 1)
    }

    /// The eight dual cells that have a voxel as a corner.
    pub(super) fn dual_cells_of(self, voxel: Ijk) -> [u32; 8] {
        let lowest = voxel.map(|c| c - 1);
        std::array::from_fn(|corner| self.cell_index(corner_cell(lowest, corner)))
    }
}
