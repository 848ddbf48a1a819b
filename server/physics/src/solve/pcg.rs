//! Preconditioned conjugate gradients in `f32` with `f64` dot products.
//!
//! The flexible form of beta (Polak-Ribiere) costs one more dot product and tolerates a
//! preconditioner that is symmetric only up to rounding.

use super::multigrid::Multigrid;
use super::operator::{NODES_PER_CHUNK, NodeVector};
use crate::workers::Workers;

/// Times that a solve mends a preconditioner that turns out indefinite.
const MAX_REPAIRS: u32 = 3;

/// Vectors of a solve, kept between solves.
#[derive(Default)]
pub struct PcgScratch {
    r: NodeVector,
    z: NodeVector,
    p: NodeVector,
    ap: NodeVector,
    previous_r: NodeVector,
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PcgReport {
    /// Iterations taken.
    pub iterations: u32,
    /// Norm of the residual over the norm of the right side.
    pub relative_residual: f64,
}

/// Dot product over fixed chunks, summed in order.
#[must_use]
pub fn dot(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let mut total = 0.0;
    for (a, b) in a.chunks(NODES_PER_CHUNK).zip(b.chunks(NODES_PER_CHUNK)) {
        let mut sum = [0.0f64; 3];
        for (x, y) in a.iter().zip(b) {
            (0..3).for_each(|i| sum[i] += f64::from(x[i]) * f64::from(y[i]));
        }
        total += sum[0] + sum[1] + sum[2];
    }
    total
}

fn add_scaled(y: &mut [[f32; 3]], factor: f32, x: &[[f32; 3]]) {
    for (y, x) in y.iter_mut().zip(x) {
        (0..3).for_each(|i| y[i] += factor * x[i]);
    }
}

impl PcgScratch {
    fn resize(&mut self, n: usize) {
        for v in [&mut self.r, &mut self.z, &mut self.p, &mut self.ap, &mut self.previous_r] {
            v.resize(n, [0.0; 3]);
        }
    }

    /// Solves `A x = b` from the initial guess in `x` to `tolerance |b|`.
    pub fn solve(
        &mut self,
        workers: &Workers<'_>,
        multigrid: &mut Multigrid,
        b: &[[f32; 3]],
        x: &mut [[f32; 3]],
        tolerance: f64,
        max_iterations: u32,
    ) -> PcgReport {
        self.resize(b.len());
        let norm_b = dot(b, b).sqrt();
        if norm_b == 0.0 {
            x.iter_mut().for_each(|v| *v = [0.0; 3]);
            return PcgReport { iterations: 0, relative_residual: 0.0 };
        }
        multigrid.operator_mut().apply(workers, x, &mut self.ap);
        for ((r, b), ap) in self.r.iter_mut().zip(b).zip(&self.ap) {
            *r = [b[0] - ap[0], b[1] - ap[1], b[2] - ap[2]];
        }
        let mut norm_r = dot(&self.r, &self.r).sqrt();
        if norm_r > norm_b {
            // The guess is worse than none.
            x.iter_mut().for_each(|v| *v = [0.0; 3]);
            self.r.copy_from_slice(b);
            norm_r = norm_b;
        }
        let mut rz = 0.0;
        let mut iterations = 0;
        let mut repairs = 0;
        let mut fresh = true;
        while norm_r > tolerance * norm_b && iterations < max_iterations {
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
            let beta = if fresh { 0.0 } else { (next_rz - dot(&self.previous_r, &self.z)) / rz };
            rz = next_rz;
            for (p, z) in self.p.iter_mut().zip(&self.z) {
                *p = [0, 1, 2].map(|i| if fresh { z[i] } else { z[i] + beta as f32 * p[i] });
            }
            multigrid.operator_mut().apply(workers, &self.p, &mut self.ap);
            let curvature = dot(&self.p, &self.ap);
            // Not positive (or not a number): the matrix is not definite along p.
            if curvature.is_nan() || curvature <= 0.0 {
                break;
            }
            fresh = false;
            let alpha = (rz / curvature) as f32;
            add_scaled(x, alpha, &self.p);
            self.previous_r.copy_from_slice(&self.r);
            add_scaled(&mut self.r, -alpha, &self.ap);
            norm_r = dot(&self.r, &self.r).sqrt();
            iterations += 1;
        }
        PcgReport { iterations, relative_residual: norm_r / norm_b }
    }
}
