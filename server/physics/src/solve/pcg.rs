//! Preconditioned conjugate gradients in `f32` with `f64` dot products.
//!
//! The flexible form of beta (Polak-Ribiere) costs one more dot product and tolerates a
//! preconditioner that is symmetric only up to rounding.
//!
//! Bodies that press on each other are solved as one system: blocks with a matrix and a cycle each, and
//! springs between them.

use super::cycle_level::CycleLevel;
use super::multigrid::Multigrid;
use super::vectors::{NODE_GRAIN, NODES_PER_CHUNK, NodeVector, dot, dot_chunk};
use crate::grow::grow;
use crate::workers::Workers;
use wide::f32x4;

/// Times that a solve mends a preconditioner that turns out indefinite, each time by taking the spectrum 1.3 times as
/// wide at least: three make it twice as wide, and the estimate is never off by more.
const MAX_REPAIRS: u32 = 3;

/// Residual over the tolerance from which on a solution tells what it is going to be. Ours: it decides only when a
/// solve is asked whether its contacts will change, and so how many solves a step takes. Half or twice moves forces
/// by less than 1e-4 and iterations by 0.2 %.
const ROUGH: f64 = 30.0;

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
    /// Present where the solve's work is bounded.
    pub effort: Option<Effort>,
}

/// The work that a solve may take before it is content with less.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Iterations to reach the tolerance in.
    pub iterations: u32,
    /// Residual that will do afterwards, relative as the tolerance is.
    pub relative_residual: f64,
}

impl Stop {
    /// Relative residual at which the solve ends, so many iterations having been taken.
    fn goal(&self, iterations: u32) -> f64 {
        let spent = self.effort.filter(|effort| iterations >= effort.iterations);
        spent.map_or(self.relative_tolerance, |effort| effort.relative_residual.max(self.relative_tolerance))
    }
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PcgReport {
    /// Iterations taken.
    pub iterations: u32,
    /// Norm of the residual over the larger of `|b|` and [`Stop::scale`].
    pub relative_residual: f64,
    /// Norm of the residual that was asked for, N s.
    pub tolerance_n_s: f64,
    /// Whether it got there.
    pub is_converged: bool,
    /// Whether it was given up, see [`Systems::is_moot`].
    pub is_moot: bool,
}

impl PcgScratch {
    /// Makes the vectors fit `n` nodes.
    pub fn resize(&mut self, n: usize) {
        grow(&mut self.p, n, f32x4::ZERO);
        grow(&mut self.ap, n, f32x4::ZERO);
    }
}

/// One block of a system.
pub struct System<'a> {
    /// Its matrix and its preconditioner.
    pub multigrid: &'a mut Multigrid,
    /// Vectors of the solve.
    pub scratch: &'a mut PcgScratch,
    /// Right side.
    pub b: &'a [f32x4],
    /// The guess, then the solution.
    pub x: &'a mut [f32x4],
}

impl System<'_> {
    /// The vector that is multiplied.
    #[must_use]
    pub fn factor(&self, factor: Factor) -> &[f32x4] {
        match factor {
            Factor::Solution => self.x,
            Factor::Direction => &self.scratch.p,
        }
    }
}

/// Which vector of each block is multiplied by the matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Factor {
    /// The solution so far.
    Solution,
    /// The search direction.
    Direction,
}

/// The blocks that are solved as one.
pub trait Systems {
    /// Visits every block, always in the same order.
    fn for_each(&mut self, visit: impl FnMut(&mut System<'_>));

    /// Asked on the way, once the residual is within `ROUGH` times the tolerance: whether the solution so far
    /// shows that another system is to be solved, by more than the residual, N s. The solve then ends.
    fn is_moot(&mut self, workers: &Workers<'_>, residual_n_s: f64) -> bool;

    /// Adds what the blocks' own matrices lack, as springs between blocks, to the products with `factor` that those
    /// have made.
    fn couple(&mut self, factor: Factor);

    /// Mends preconditioners that have turned out indefinite. Returns whether the solve is to go on with them.
    fn mend(&mut self, workers: &Workers<'_>) -> bool {
        self.for_each(|s| s.multigrid.widen_spectrum(workers));
        true
    }
}

/// Sum over the blocks.
fn sum<S: Systems>(systems: &mut S, mut of: impl FnMut(&mut System<'_>) -> f64) -> f64 {
    let mut total = 0.0;
    systems.for_each(|system| total += of(system));
    total
}

/// Solves `A x = b` from the initial guess in `x` until `stop` says.
pub fn solve<S: Systems>(workers: &Workers<'_>, systems: &mut S, stop: Stop) -> PcgReport {
    let norm_b = sum(systems, |s| dot(workers, s.b, s.b)).sqrt();
    if norm_b < NOTHING_N_S {
        systems.for_each(|s| s.x.fill(f32x4::ZERO));
        return PcgReport {
            iterations: 0,
            relative_residual: 0.0,
            tolerance_n_s: 0.0,
            is_converged: true,
            is_moot: false,
        };
    }
    let mut norm_r = begin(workers, systems);
    if norm_r.is_nan() || norm_r > norm_b {
        // The guess is worse than none.
        systems.for_each(|s| {
            s.x.fill(f32x4::ZERO);
            s.multigrid.finest_mut().b.copy_from_slice(s.b);
        });
        norm_r = norm_b;
    }
    let reference = norm_b.max(stop.scale);
    let mut tolerance_n_s = stop.goal(0) * reference;
    let (mut rz, mut alpha, mut iterations) = (0.0, 0.0, 0);
    let mut repairs = 0;
    let mut fresh = true;
    let mut is_moot = false;
    while norm_r > tolerance_n_s && iterations < stop.max_iterations {
        let (next_rz, apz) = precondition(workers, systems);
        if next_rz.is_nan() || next_rz <= 0.0 {
            // The preconditioner lost definiteness. Mended once or twice it is good again;
            // going on without would only make the answer worse.
            if repairs == MAX_REPAIRS || !systems.mend(workers) {
                break;
            }
            repairs += 1;
            fresh = true;
            continue;
        }
        // The residual changed by -alpha A p: beta = z . (r - r_previous) / (r . z)_previous.
        let beta = if fresh { 0.0 } else { -alpha * apz / rz };
        rz = next_rz;
        let curvature = turn(workers, systems, beta);
        // Not positive (or not a number): the matrix is not definite along p.
        if curvature.is_nan() || curvature <= 0.0 {
            break;
        }
        fresh = false;
        alpha = rz / curvature;
        norm_r = sum(systems, |s| advance(workers, s, alpha)).sqrt();
        iterations += 1;
        tolerance_n_s = stop.goal(iterations) * reference;
        if norm_r <= ROUGH * tolerance_n_s && norm_r > tolerance_n_s {
            is_moot = systems.is_moot(workers, norm_r);
            if is_moot {
                break;
            }
        }
    }
    PcgReport {
        iterations,
        relative_residual: norm_r / reference,
        tolerance_n_s,
        is_converged: norm_r <= tolerance_n_s,
        is_moot,
    }
}

/// `z` of each block's own cycle; `r . z` and `A p . z`.
fn precondition<S: Systems>(workers: &Workers<'_>, systems: &mut S) -> (f64, f64) {
    let mut total = (0.0, 0.0);
    systems.for_each(|s| {
        s.multigrid.precondition(workers);
        let finest = s.multigrid.finest_mut();
        let data = (&finest.b[..], &finest.x[..], &s.scratch.ap[..]);
        let of_chunk = |_, (r, z, ap): (&[f32x4], &[f32x4], &[f32x4])| (dot_chunk(r, z), dot_chunk(ap, z));
        let (rz, apz) = workers.reduce_chunks(data, NODE_GRAIN, of_chunk, |a, b| (a.0 + b.0, a.1 + b.1));
        total = (total.0 + rz, total.1 + apz);
    });
    total
}

/// `p = z + beta p`, and `p . A p`.
fn turn<S: Systems>(workers: &Workers<'_>, systems: &mut S, beta: f64) -> f64 {
    let factor = f32x4::splat(beta as f32);
    systems.for_each(|s| {
        let finest = s.multigrid.finest_mut();
        workers.for_chunks((&mut s.scratch.p[..], &finest.x[..]), NODE_GRAIN, |_, (p, z)| {
            // The first direction is not to see what an earlier solve left.
            p.iter_mut().zip(z).for_each(|(p, z)| *p = if beta == 0.0 { *z } else { factor.mul_add(*p, *z) });
        });
        finest.operator.multiply(workers, &s.scratch.p);
    });
    systems.couple(Factor::Direction);
    sum(systems, |s| {
        let operator = s.multigrid.operator();
        let multiply = |chunk: usize, (p, ap): (&[f32x4], &mut [f32x4])| {
            for (node, ap) in (chunk * NODES_PER_CHUNK..).zip(&mut *ap) {
                *ap = operator.product_at(node);
            }
            dot_chunk(p, ap)
        };
        let data = (&s.scratch.p[..], &mut s.scratch.ap[..]);
        workers.reduce_chunks(data, NODE_GRAIN, multiply, |a, b| a + b)
    })
}

/// `x += alpha p`, `r -= alpha A p`, and `r . r`.
fn advance(workers: &Workers<'_>, system: &mut System<'_>, alpha: f64) -> f64 {
    let alpha = f32x4::splat(alpha as f32);
    type Data<'a> = (&'a mut [f32x4], &'a mut [f32x4], &'a [f32x4], &'a [f32x4]);
    let advance = |_, (x, r, p, ap): Data<'_>| {
        x.iter_mut().zip(p).for_each(|(x, p)| *x = alpha.mul_add(*p, *x));
        r.iter_mut().zip(ap).for_each(|(r, ap)| *r = (-alpha).mul_add(*ap, *r));
        dot_chunk(r, r)
    };
    let r = &mut system.multigrid.finest_mut().b[..];
    let data = (&mut system.x[..], r, &system.scratch.p[..], &system.scratch.ap[..]);
    workers.reduce_chunks(data, NODE_GRAIN, advance, |a, b| a + b)
}

/// `r = b - A x`, and its norm.
fn begin<S: Systems>(workers: &Workers<'_>, systems: &mut S) -> f64 {
    systems.for_each(|s| {
        s.scratch.resize(s.b.len());
        s.multigrid.operator_mut().multiply(workers, s.x);
    });
    systems.couple(Factor::Solution);
    sum(systems, |s| {
        let CycleLevel { operator, b: r, .. } = s.multigrid.finest_mut();
        let operator = &*operator;
        let residual = |chunk: usize, (b, r): (&[f32x4], &mut [f32x4])| {
            for (node, (b, r)) in (chunk * NODES_PER_CHUNK..).zip(b.iter().zip(&mut *r)) {
                *r = *b - operator.product_at(node);
            }
            dot_chunk(r, r)
        };
        workers.reduce_chunks((s.b, &mut r[..]), NODE_GRAIN, residual, |a, b| a + b)
    })
    .sqrt()
}
