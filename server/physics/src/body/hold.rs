//! What holds a body: the voxels of the regions that its object states as `fixed`.

use super::Body;
use crate::Vec3;
use crate::fem::block::LANES;
use crate::fem::composite::shape_functions;
use crate::fem::lanes::diagonal_entry;
use crate::grid::VoxelId;
use wide::f64x4;

/// Stiffness of a held voxel over `E h`: its compliance adds less than a hundredth of a voxel of
/// tissue to what it holds.
const HOLD_STIFFNESS: f64 = 300.0;

/// A node is firmly held where the hold is this many times as stiff as the element.
const FIRM_HOLD: f64 = 10.0;

impl Body {
    /// A held voxel is held at its eight corners, through the interpolation of its element.
    pub(super) fn hold_matrix(&self, voxels: &[VoxelId]) -> [f64; 36] {
        let mut hold = [0.0; 36];
        let h = self.state.grid.voxel_size_m();
        for &voxel in voxels.iter().filter(|v| self.description.voxel_loads[v.index()].held) {
            let stiffness = HOLD_STIFFNESS * self.material_of(voxel).young_modulus_pa * h / 8.0;
            let element = self.base().owner[voxel.index()] as usize;
            let centre = self.state.grid.centre_m(self.state.grid.voxels()[voxel.index()].ijk);
            for corner in 0..8 {
                let offset = Vec3::from([0, 1, 2].map(|a| ((corner >> a & 1) as f64 - 0.5) * h));
                let n = shape_functions(self.local_coordinates(element, &(centre + offset)));
                for a in 0..8 {
                    for b in 0..=a {
                        hold[a * (a + 1) / 2 + b] += stiffness * n[a] * n[b];
                    }
                }
            }
        }
        hold
    }

    /// Whether a node is held so firmly that it hardly moves.
    pub(super) fn held_nodes(&self) -> Vec<bool> {
        let mut held = vec![false; self.node_count()];
        for (element, hold) in &self.solver.holds {
            let (block, lane) = (&self.solver.blocks[*element as usize / LANES], *element as usize % LANES);
            for (corner, &node) in self.base().elements[*element as usize].nodes.iter().enumerate() {
                let stiffness = block.stiffness.at(diagonal_entry(corner), lane);
                held[node as usize] |= hold[corner * (corner + 3) / 2] > FIRM_HOLD * stiffness;
            }
        }
        held
    }

    /// What holds an element's voxels does at its corners, N.
    pub(super) fn hold_forces_n(&self, element: usize) -> [Vec3; 8] {
        let Ok(found) = self.solver.holds.binary_search_by_key(&(element as u32), |h| h.0) else {
            return Default::default();
        };
        hold_times(&self.solver.holds[found].1, &self.corner_displacements(element)).map(|force| {
            let [x, y, z, _] = force.to_array();
            -Vec3::new(x, y, z)
        })
    }
}

/// `H u` on each axis, for the 8x8 matrix of what holds an element.
pub(super) fn hold_times(hold: &[f64; 36], u: &[f64x4; 8]) -> [f64x4; 8] {
    let mut pull = [f64x4::ZERO; 8];
    for a in 0..8 {
        let row = &hold[a * (a + 1) / 2..=a * (a + 3) / 2];
        for b in 0..a {
            let entry = f64x4::splat(row[b]);
            pull[a] = entry.mul_add(u[b], pull[a]);
            pull[b] = entry.mul_add(u[a], pull[b]);
        }
        pull[a] = f64x4::splat(row[a]).mul_add(u[a], pull[a]);
    }
    pull
}

pub(super) fn dot(a: &[f64x4; 8], b: &[f64x4; 8]) -> f64 {
    a.iter().zip(b).fold(f64x4::ZERO, |sum, (a, b)| a.mul_add(*b, sum)).reduce_add()
}
