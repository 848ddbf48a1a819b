//! A layer in plane strain made of the simulation's own composite elements: their compliance under a
//! line load, whichever way it is spread over the nodes.

use kerf_physics::fem::composite::{CompositeTables, Field, FilledVoxel};
use kerf_physics::fem::material::Elastic;

/// Columns of nodes on either side of the loaded one, and rows from the top down, whose loads are known.
const REACH: usize = 12;

/// Vertical compliances between the nodes at the top of a layer, times E.
pub struct Strip {
    /// `at[row][other row][columns apart]`, rows 0 (top) and 1.
    at: [[[f64; REACH + 1]; 2]; 2],
    /// Depth of the layer over the element's edge.
    pub depth: f64,
}

impl Strip {
    /// A layer of `rows` elements of 2^level voxels a side, the topmost with `filled` layers of voxels.
    pub fn new(level: u8, poisson_ratio: f64, rows: usize, filled: usize) -> Self {
        let k = 1usize << level;
        let tables = CompositeTables::new(level, 1.0 / k as f64);
        let elastic = Elastic::new(1.0, poisson_ratio, 1.0);
        let plane = |filled: usize| {
            let voxels: Vec<FilledVoxel> =
                (0..k * k * k).filter(|v| v / k % k < filled).map(|v| FilledVoxel::whole(v, elastic)).collect();
            in_plane(&tables.assemble(&voxels, Field::IncompatibleModes).stiffness)
        };
        let (whole, top) = (plane(k), plane(filled));
        // Long enough that its ends, at four depths, do not show.
        let columns = 8 * rows;
        let mut matrix = Banded::new(2 * rows * (columns + 1), 2 * rows + 3);
        for column in 0..columns {
            for row in 0..rows {
                let k = if row == rows - 1 { &top } else { &whole };
                matrix.add(k, |corner| {
                    // The lowest row of nodes is held.
                    let (up, right) = (row + (corner & 1), column + (corner >> 1));
                    (up > 0).then(|| 2 * (right * rows + up - 1))
                });
            }
        }
        matrix.factor();
        let node = |column: usize, row: usize| 2 * (column * rows + rows - 1 - row);
        let mut at = [[[0.0; REACH + 1]; 2]; 2];
        for row in 0..2 {
            let mut u = vec![0.0; matrix.size];
            u[node(columns / 2, row)] = 1.0;
            matrix.solve(&mut u);
            for other in 0..2 {
                for apart in 0..=REACH {
                    at[row][other][apart] = u[node(columns / 2 + apart, other)];
                }
            }
        }
        Self { at, depth: rows as f64 - 1.0 + filled as f64 / k as f64 }
    }

    /// Compliance under a line load spread over columns of nodes by `across` (column, weight) and between
    /// the top row of nodes and the one below by `up` (the fraction of the top row).
    pub fn compliance(&self, across: &[(i32, f64)], up: f64) -> f64 {
        let rows = [up, 1.0 - up];
        let mut sum = 0.0;
        for (a, wa) in across {
            for (b, wb) in across {
                for i in 0..2 {
                    for j in 0..2 {
                        sum += wa * wb * rows[i] * rows[j] * self.at[i][j][a.abs_diff(*b) as usize];
                    }
                }
            }
        }
        sum
    }
}

/// Element matrix for displacements across x that do not change along x: nodes (y, z), degrees of
/// freedom (y, z); corner bit 0 is y, bit 1 is z.
fn in_plane(k: &[[f64; 24]; 24]) -> [[f64; 8]; 8] {
    let mut plane = [[0.0; 8]; 8];
    for row in (0..24).filter(|r| r % 3 != 0) {
        for column in (0..24).filter(|c| c % 3 != 0) {
            let of = |dof: usize| 2 * (dof / 6) + dof % 3 - 1;
            plane[of(row)][of(column)] += k[row][column];
        }
    }
    plane
}

/// A symmetric positive definite band matrix: each row's entries from the diagonal leftward.
struct Banded {
    size: usize,
    band: usize,
    entries: Vec<f64>,
}

impl Banded {
    fn new(size: usize, band: usize) -> Self {
        Self { size, band, entries: vec![0.0; size * (band + 1)] }
    }

    fn slot(&self, row: usize, column: usize) -> usize {
        row * (self.band + 1) + row - column
    }

    fn add(&mut self, k: &[[f64; 8]; 8], first_dof: impl Fn(usize) -> Option<usize>) {
        for a in 0..8 {
            for b in 0..8 {
                if let (Some(row), Some(column)) = (first_dof(a / 2), first_dof(b / 2)) {
                    let (row, column) = (row + a % 2, column + b % 2);
                    if column <= row {
                        let slot = self.slot(row, column);
                        self.entries[slot] += k[a][b];
                    }
                }
            }
        }
    }

    /// Cholesky's factor in place.
    fn factor(&mut self) {
        for row in 0..self.size {
            for column in row.saturating_sub(self.band)..=row {
                let from = row.saturating_sub(self.band).max(column.saturating_sub(self.band));
                let dot: f64 =
                    (from..column).map(|j| self.entries[self.slot(row, j)] * self.entries[self.slot(column, j)]).sum();
                let (slot, diagonal) = (self.slot(row, column), self.slot(column, column));
                let value = self.entries[slot] - dot;
                self.entries[slot] = if row == column { value.sqrt() } else { value / self.entries[diagonal] };
            }
        }
    }

    fn solve(&self, x: &mut [f64]) {
        for row in 0..self.size {
            let from = row.saturating_sub(self.band);
            let dot: f64 = (from..row).map(|j| self.entries[self.slot(row, j)] * x[j]).sum();
            x[row] = (x[row] - dot) / self.entries[self.slot(row, row)];
        }
        for row in (0..self.size).rev() {
            x[row] /= self.entries[self.slot(row, row)];
            for j in row.saturating_sub(self.band)..row {
                x[j] -= self.entries[self.slot(row, j)] * x[row];
            }
        }
    }
}
