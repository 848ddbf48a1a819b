//! Preconditioned conjugate gradients in `f32` with `f64` dot products.
//!
//! The flexible form of beta (Polak-Ribiere) costs one more dot product and tolerates a
//! preconditioner that is symmetric only up to rounding.

use super::multigrid::Multigrid;
use super::operator::{NODES_PER_CHUNK, NodeVector};
use crate::workers::Workers;
use wide::{f32x4, f64x4};

/// Times that a solve mends a preconditioner that turns out indefinite.
const MAX_REPAIRS: u32 = 3;

/// Vectors of a solve, kept between solves.
#[derive(Default)]
pub struct PcgScratch {
    r: NodeVector,
    z: NodeVector,
    p: NodeVector,
    ap: NodeVector,
}

/// When a solve ends.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    /// Norm of what the right side is the balance of. Where large terms cancel in `b`, a residual that
    /// is small beside them is small enough.
    pub scale: f64,
    /// Residual over the larger of `|b|` and `scale`.
    pub relative_tolerance: f64,
    /// Iterations after which it ends whatever the residual.
    pub max_iterations: u32,
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PcgReport {
    /// Iterations taken.
    pub iterations: u32,
    /// Norm of the residual over the larger of `|b|` and [`Stop::scale`].
    pub relative_residual: f64,
}

#[inline(always)]
fn widen(v: f32x4) -> f64x4 {
    f64x4::from(v.to_array().map(f64::from))
}

/// Dot product over fixed chunks, summed in order.
#[must_use]
pub fn dot(a: &[f32x4], b: &[f32x4]) -> f64 {
    let mut total = 0.0;
    for (a, b) in a.chunks(NODES_PER_CHUNK).zip(b.chunks(NODES_PER_CHUNK)) {
        let mut sum = f64x4::ZERO;
        for (x, y) in a.iter().zip(b) {
            sum = widen(*x).mul_add(widen(*y), sum);
        }
        let [x, y, z, _] = sum.to_array();
        total += x + y + z;
    }
    total
}

fn add_scaled(y: &mut [f32x4], factor: f32, x: &[f32x4]) {
    let factor = f32x4::splat(factor);
    for (y, x) in y.iter_mut().zip(x) {
        *y = factor.mul_add(*x, *y);
    }
}

impl PcgScratch {
    /// Makes the vectors fit `n` nodes.
    pub fn resize(&mut self, n: usize) {
        for v in [&mut self.r, &mut self.z, &mut self.p, &mut self.ap] {
            v.resize(n, f32x4::ZERO);
        }
    }

    /// Solves `A x = b` from the initial guess in `x` until `stop` says.
    pub fn solve(
        &mut self,
        workers: &Workers<'_>,
        multigrid: &mut Multigrid,
        b: &[f32x4],
        x: &mut [f32x4],
        stop: Stop,
    ) -> PcgReport {
        self.resize(b.len());
        let norm_b = dot(b, b).sqrt();
        if norm_b == 0.0 {
            x.fill(f32x4::ZERO);
            return PcgReport { iterations: 0, relative_residual: 0.0 };
        }
        multigrid.operator_mut().apply(workers, x, &mut self.ap);
        for ((r, b), ap) in self.r.iter_mut().zip(b).zip(&self.ap) {
            *r = *b - *ap;
        }
        let mut norm_r = dot(&self.r, &self.r).sqrt();
        if norm_r > norm_b {
            // The guess is worse than none.
            x.iter_mut().for_each(|v| *v = f32x4::ZERO);
            self.r.copy_from_slice(b);
            norm_r = norm_b;
        }
        let reference = norm_b.max(stop.scale);
        let (mut rz, mut alpha, mut iterations) = (0.0, 0.0, 0);
        let mut repairs = 0;
        let mut fresh = true;
        while norm_r > stop.relative_tolerance * reference && iterations < stop.max_iterations {
            multigrid.precondition(workers, &self.r, &mut self.z);
            let next_rz = dot(&self.r, &self.z);
            if next_rz.is_nan() || next_rz <= 0.0 {
                // The preconditioner lost definiteness. Mended once or twice it is good again;
                // going on without would only make the answer worse.
                if repairs == MAX_REPAIRS {
                    break;
                }
                repairs += 1;
                multigrid.widen_spectrum(workers);
                fresh = true;
                continue;
            }
            // The residual changed by -alpha A p: beta = z . (r - r_previous) / (r . z)_previous.
            let beta = if fresh { 0.0 } else { -alpha * dot(&self.ap, &self.z) / rz };
            rz = next_rz;
            if fresh {
                self.p.copy_from_slice(&self.z);
            } else {
                let beta = f32x4::splat(beta as f32);
                self.p.iter_mut().zip(&self.z).for_each(|(p, z)| *p = beta.mul_add(*p, *z));
            }
            multigrid.operator_mut().apply(workers, &self.p, &mut self.ap);
            let curvature = dot(&self.p, &self.ap);
            // Not positive (or not a number): the matrix is not definite along p.
            if curvature.is_nan() || curvature <= 0.0 {
                break;
            }
            fresh = false;
            alpha = rz / curvature;
            add_scaled(x, alpha as f32, &self.p);
            add_scaled(&mut self.r, -alpha as f32, &self.ap);
            norm_r = dot(&self.r, &self.r).sqrt();
            iterations += 1;
        }
        PcgReport { iterations, relative_residual: norm_r / reference }
    }
}
