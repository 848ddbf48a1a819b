//! Vectors over the nodes of a level, and what is done with them in one sweep.

use crate::workers::{Grain, Workers};
use wide::{f32x4, f64x4};

/// Nodes per chunk of parallel work.
pub const NODES_PER_CHUNK: usize = 512;
/// Of sweeps over nodes: 3 us a chunk.
pub const NODE_GRAIN: Grain = Grain { chunk: NODES_PER_CHUNK, least: 8 };

/// A vector with three components per node; the fourth is zero.
pub type NodeVector = Vec<f32x4>;

#[inline(always)]
fn widen(v: f32x4) -> f64x4 {
    f64x4::from(v.to_array().map(f64::from))
}

/// Dot product of two chunks.
#[inline(always)]
pub(super) fn dot_chunk(a: &[f32x4], b: &[f32x4]) -> f64 {
    let mut sum = f64x4::ZERO;
    for (x, y) in a.iter().zip(b) {
        sum = widen(*x).mul_add(widen(*y), sum);
    }
    let [x, y, z, _] = sum.to_array();
    x + y + z
}

/// Dot product over fixed chunks, summed in a fixed order.
#[must_use]
pub fn dot(workers: &Workers<'_>, a: &[f32x4], b: &[f32x4]) -> f64 {
    workers.reduce_chunks((a, b), NODE_GRAIN, |_, (a, b)| dot_chunk(a, b), |x, y| x + y)
}

/// `B v` of a 3x3 block given by its columns.
#[inline(always)]
pub(super) fn times(columns: &[f32x4; 3], v: f32x4) -> f32x4 {
    let [x, y, z, _] = v.to_array();
    columns[0].mul_add(f32x4::splat(x), columns[1].mul_add(f32x4::splat(y), columns[2] * f32x4::splat(z)))
}
