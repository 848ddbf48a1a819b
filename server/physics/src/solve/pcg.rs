//! Preconditioned conjugate gradients in `f32` with `f64` dot products.
//!
//! The flexible form of beta (Polak-Ribiere) costs one more dot product and tolerates a
//! preconditioner that is symmetric only up to rounding.

use super::cycle_level::CycleLevel;
use super::multigrid::Multigrid;
use super::operator::{NODES_PER_CHUNK, NodeVector};
use crate::workers::Workers;
use wide::{f32x4, f64x4};

/// Times that a solve mends a preconditioner that turns out indefinite.
const MAX_REPAIRS: u32 = 3;

/// Norm of a right side that counts as none, N s: far below any impulse that moves anything, and so far
/// above the least `f32` that the vectors of a solve keep their digits. A body of micrometres that comes
/// to rest would otherwise be solved for its rounding, to the cap of iterations in each step.
const NOTHING_N_S: f64 = 1e-30;

/// Vectors of a solve, kept between solves; the residual and what the preconditioner makes of it are the
/// cycle's own.
#[derive(Clone, Default)]
pub struct PcgScratch {
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

/// Dot product of two chunks.
#[inline(always)]
fn dot_chunk(a: &[f32x4], b: &[f32x4]) -> f64 {
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
    workers.reduce_chunks((a, b), NODES_PER_CHUNK, |_, (a, b)| dot_chunk(a, b), |x, y| x + y)
}

impl PcgScratch {
    /// Makes the vectors fit `n` nodes.
    pub fn resize(&mut self, n: usize) {
        self.p.resize(n, f32x4::ZERO);
        self.ap.resize(n, f32x4::ZERO);
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
        let norm_b = dot(workers, b, b).sqrt();
        if norm_b < NOTHING_N_S {
            x.fill(f32x4::ZERO);
            return PcgReport { iterations: 0, relative_residual: 0.0 };
        }
        let mut norm_r = begin(workers, multigrid, b, x);
        if norm_r > norm_b {
            // The guess is worse than none.
            x.fill(f32x4::ZERO);
            multigrid.finest_mut().b.copy_from_slice(b);
            norm_r = norm_b;
        }
        let reference = norm_b.max(stop.scale);
        let (mut rz, mut alpha, mut iterations) = (0.0, 0.0, 0);
        let mut repairs = 0;
        let mut fresh = true;
        while norm_r > stop.relative_tolerance * reference && iterations < stop.max_iterations {
            multigrid.precondition(workers);
            let (next_rz, apz) = self.products(workers, multigrid.finest_mut());
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
            let beta = if fresh { 0.0 } else { -alpha * apz / rz };
            rz = next_rz;
            let curvature = self.turn(workers, multigrid.finest_mut(), beta);
            // Not positive (or not a number): the matrix is not definite along p.
            if curvature.is_nan() || curvature <= 0.0 {
                break;
            }
            fresh = false;
            alpha = rz / curvature;
            norm_r = self.advance(workers, &mut multigrid.finest_mut().b, x, alpha).sqrt();
            iterations += 1;
        }
        PcgReport { iterations, relative_residual: norm_r / reference }
    }

    /// `r . z` and `A p . z`.
    fn products(&self, workers: &Workers<'_>, finest: &CycleLevel) -> (f64, f64) {
        let data = (&finest.b[..], &finest.x[..], &self.ap[..]);
        let of_chunk = |_, (r, z, ap): (&[f32x4], &[f32x4], &[f32x4])| (dot_chunk(r, z), dot_chunk(ap, z));
        workers.reduce_chunks(data, NODES_PER_CHUNK, of_chunk, |a, b| (a.0 + b.0, a.1 + b.1))
    }

    /// `p = z + beta p`, and `p . A p`.
    fn turn(&mut self, workers: &Workers<'_>, finest: &mut CycleLevel, beta: f64) -> f64 {
        let factor = f32x4::splat(beta as f32);
        workers.for_chunks((&mut self.p[..], &finest.x[..]), NODES_PER_CHUNK, |_, (p, z)| {
            // The first direction is not to see what an earlier solve left.
            p.iter_mut().zip(z).for_each(|(p, z)| *p = if beta == 0.0 { *z } else { factor.mul_add(*p, *z) });
        });
        finest.operator.multiply(workers, &self.p);
        let operator = &finest.operator;
        let multiply = |chunk: usize, (p, ap): (&[f32x4], &mut [f32x4])| {
            for (node, ap) in (chunk * NODES_PER_CHUNK..).zip(&mut *ap) {
                *ap = operator.product_at(node);
            }
            dot_chunk(p, ap)
        };
        workers.reduce_chunks((&self.p[..], &mut self.ap[..]), NODES_PER_CHUNK, multiply, |a, b| a + b)
    }

    /// `x += alpha p`, `r -= alpha A p`, and `r . r`.
    fn advance(&self, workers: &Workers<'_>, r: &mut [f32x4], x: &mut [f32x4], alpha: f64) -> f64 {
        let alpha = f32x4::splat(alpha as f32);
        type Data<'a> = (&'a mut [f32x4], &'a mut [f32x4], &'a [f32x4], &'a [f32x4]);
        let advance = |_, (x, r, p, ap): Data<'_>| {
            x.iter_mut().zip(p).for_each(|(x, p)| *x = alpha.mul_add(*p, *x));
            r.iter_mut().zip(ap).for_each(|(r, ap)| *r = (-alpha).mul_add(*ap, *r));
            dot_chunk(r, r)
        };
        workers.reduce_chunks((x, r, &self.p[..], &self.ap[..]), NODES_PER_CHUNK, advance, |a, b| a + b)
    }
}

/// `r = b - A x`, and its norm.
fn begin(workers: &Workers<'_>, multigrid: &mut Multigrid, b: &[f32x4], x: &[f32x4]) -> f64 {
    let CycleLevel { operator, b: r, .. } = multigrid.finest_mut();
    operator.multiply(workers, x);
    let operator = &*operator;
    let residual = |chunk: usize, (b, r): (&[f32x4], &mut [f32x4])| {
        for (node, (b, r)) in (chunk * NODES_PER_CHUNK..).zip(b.iter().zip(&mut *r)) {
            *r = *b - operator.product_at(node);
        }
        dot_chunk(r, r)
    };
    workers.reduce_chunks((b, &mut r[..]), NODES_PER_CHUNK, residual, |a, b| a + b).sqrt()
}
