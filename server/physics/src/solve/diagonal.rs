//! The diagonal blocks of a level's system matrix, and their inverses: the smoother's preconditioner.

use super::assembly::LANES;
use super::vectors::NodeVector;
use crate::fem::lanes;
use crate::grow::grow;
use serde::{Deserialize, Serialize};
use wide::{f32x4, f32x8};

/// What is added to the diagonal of a node's block, over its trace: well above the rounding of its sum, which is
/// 1e-7, and far below what would slow the smoother. Half or twice moves forces by less than 1e-4 and iterations by
/// 0.1 %.
const LEAST_SHARE: f32 = 1e-5;

/// Diagonal 3x3 blocks of every node: symmetric, so six entries.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct Diagonal {
    /// xx, yy, zz.
    pub(super) on: NodeVector,
    /// xy, xz, yz.
    pub(super) off: NodeVector,
}

impl Diagonal {
    /// Number of nodes.
    pub(super) fn len(&self) -> usize {
        self.on.len().min(self.off.len())
    }

    pub(super) fn resize(&mut self, nodes: usize) {
        grow(&mut self.on, nodes, f32x4::ZERO);
        grow(&mut self.off, nodes, f32x4::ZERO);
    }
}

/// Inverses of eight symmetric blocks given by diagonals (xx, yy, zz) and the rest (xy, xz, yz), by
/// `L D L^T` with [`LEAST_SHARE`] of the trace added: where elements and springs hold a node in one or two
/// directions only, rounding would else decide the sign of the rest, and a smoother that is indefinite at one
/// node spoils the whole solve. A node that carries nothing stays where it is: its inverse is zero.
#[inline(always)]
pub(super) fn invert(on: [f32x4; LANES], off: [f32x4; LANES]) -> [[f32x4; 3]; LANES] {
    let ([xx, yy, zz], [xy, xz, yz]) = (lanes::split(on), lanes::split(off));
    let trace = xx + yy + zz;
    let carries = trace.simd_gt(f32x8::ZERO);
    // Of order one: the products of a stiff matrix under a long time step are beyond f32.
    let scale = carries.bitselect(f32x8::ONE / carries.bitselect(trace, f32x8::ONE), f32x8::ZERO);
    let [xx, yy, zz, xy, xz, yz] = [xx, yy, zz, xy, xz, yz].map(|v| v * scale);
    let least = f32x8::splat(LEAST_SHARE);
    let [xx, yy, zz] = [xx, yy, zz].map(|v| v + least);
    let pivot = |v: f32x8| f32x8::ONE / v.max(least);
    let px = pivot(xx);
    let (ly, lz) = (xy * px, xz * px);
    let py = pivot(yy - xy * ly);
    let rest = yz - xy * lz;
    let lzy = rest * py;
    let pz = pivot(zz - xz * lz - rest * lzy);
    // Rows of L^-1.
    let zx = ly * lzy - lz;
    let (c02, c12, c22) = (zx * pz, -(lzy * pz), pz);
    let (c01, c11) = (zx * c12 - ly * py, py - lzy * c12);
    let c00 = px + ly * ly * py + zx * c02;
    let columns = [[c00, c01, c02], [c01, c11, c12], [c02, c12, c22]].map(|c| lanes::join(c.map(|v| v * scale)));
    std::array::from_fn(|lane| columns.map(|c| c[lane]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Mat3, Vec3};

    fn inverse_of(block: &Mat3) -> Mat3 {
        let [on, off] = [[(0, 0), (1, 1), (2, 2)], [(0, 1), (0, 2), (1, 2)]].map(|entries| {
            let [a, b, c] = entries.map(|at| block[at] as f32);
            [f32x4::new([a, b, c, 0.0]); LANES]
        });
        let columns = invert(on, off)[0].map(|c| c.to_array().map(f64::from));
        Mat3::from_fn(|i, j| columns[j][i])
    }

    #[test]
    fn the_inverse_of_a_nodes_block_is_definite_however_few_directions_hold_the_node() {
        let mut random = 1u64;
        let mut unit = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 40) as f64 / (1u64 << 23) as f64 - 1.0
        };
        let mut direction = || Vec3::new(unit(), unit(), unit()).normalize();
        for case in 0..30_000 {
            // Springs along one to four directions, each a thousandth of the one before or as stiff, of any scale.
            let scale = 10f64.powi(case % 25 - 12);
            let softer = if case % 2 == 0 { 1.0 } else { 1e-3f64 };
            let along = |n: i32, d: Vec3| d * d.transpose() * (scale * softer.powi(n));
            let block: Mat3 = (0..1 + case % 4).map(|n| along(n, direction())).sum();
            let inverse = inverse_of(&block);
            let values = inverse.symmetric_eigenvalues() * block.trace();
            assert!(values.min() > 0.1 && values.max() < 1.2e5, "{case}: {values:?} of {block}");
            let least = block.symmetric_eigenvalues().min() / block.trace();
            if least > 1e-3 {
                let error = (inverse * block - Mat3::identity()).amax();
                assert!(error < 3e-5 / least, "{case}: {error} of {block}");
            }
        }
        assert_eq!(inverse_of(&Mat3::zeros()), Mat3::zeros());
    }
}
