//! Bodies at rest under their loads.
//!
//! The body's own solve, at a long time step, is the map `x -> x + dx` of a Newton iteration with a mass
//! term; its matrix is in single precision, which near incompressibility is not enough for the softest
//! modes, so the map is accelerated (Anderson 1965, as Walker and Ni 2011 write it). The unbalanced
//! force is the body's, in double precision: the solution is that of its elements.

use std::collections::VecDeque;

use anyhow::{Context, Result, bail};
use kerf_physics::Body;
use kerf_physics::scene::Scene;
use kerf_physics::verification::{self, Nodal, StepParams};
use nalgebra::{DMatrix, DVector};

use super::scenes::largest;

/// Time step of the solves of slender bodies that are held, s: long beside their periods, short enough
/// that the mass shows in the matrix.
pub const HELD_TAU_S: f64 = 0.3;
/// The same for compact bodies that are free: only the mass resists their rigid motion.
pub const FREE_TAU_S: f64 = 0.01;
/// Time step and number of the solves that approach a large deflection.
const APPROACH_TAU_S: f64 = 0.03;
const APPROACH_SOLVES: u32 = 150;
/// Correction over displacement at which a body is at rest.
const REST: f64 = 1e-7;
const MAX_SOLVES: u32 = 80;
/// Earlier corrections that are combined.
const DEPTH: usize = 8;

/// Builds the first object of a scene for [`settle`], with the time step of its solves.
///
/// # Errors
/// The scene is not valid.
pub fn body(scene: &Scene, tau_s: f64) -> Result<Body> {
    let params = StepParams { dt_s: tau_s, relative_tolerance: 1e-4, max_iterations: 1000 };
    verification::body(scene, params).context("the scene of a case")
}

/// Builds the first object of a scene at rest under loads that bend it far.
///
/// # Errors
/// The scene is not valid, or the body did not come to rest.
pub fn far_bent(scene: &Scene) -> Result<Body> {
    let mut near = body(scene, APPROACH_TAU_S)?;
    for _ in 0..APPROACH_SOLVES {
        let change = verification::correction_m(&mut near);
        add(&mut verification::state_mut(&mut near).position_m, &change);
    }
    let mut body = body(scene, HELD_TAU_S)?;
    verification::state_mut(&mut body).position_m.clone_from(&verification::state(&near).position_m);
    settle(&mut body)?;
    Ok(body)
}

/// Takes a body to rest under its loads.
///
/// # Errors
/// It did not come to rest.
pub fn settle(body: &mut Body) -> Result<()> {
    let mut history = History::default();
    let mut sizes = Vec::new();
    for _ in 0..MAX_SOLVES {
        let change = verification::correction_m(body);
        let moved = (0..body.node_count()).map(|n| {
            let rest = body.rest_position_m(n);
            [0, 1, 2].map(|i| verification::state(body).position_m[n][i] - rest[i])
        });
        let displacement = moved.flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
        if largest(&change) < REST * displacement {
            return Ok(());
        }
        sizes.push(format!("{:.0e}", largest(&change) / displacement));
        history.step(&mut verification::state_mut(body).position_m, &change);
    }
    bail!("no rest: relative corrections {sizes:?}")
}

fn add(x: &mut Nodal, by: &Nodal) {
    x.iter_mut().zip(by).for_each(|(x, by)| (0..3).for_each(|i| x[i] += by[i]));
}

/// Earlier positions and corrections, as differences between one solve and the next.
#[derive(Default)]
struct History {
    last: Option<(Nodal, Nodal)>,
    positions: VecDeque<Nodal>,
    corrections: VecDeque<Nodal>,
}

impl History {
    /// Moves `x` to where the combination of corrections vanishes in the sense of least squares.
    fn step(&mut self, x: &mut Nodal, correction: &Nodal) {
        if let Some((last_x, last_f)) = self.last.replace((x.clone(), correction.clone())) {
            self.positions.push_back(difference(x, &last_x));
            self.corrections.push_back(difference(correction, &last_f));
            if self.positions.len() > DEPTH {
                self.positions.pop_front();
                self.corrections.pop_front();
            }
        }
        let shares = self.shares(correction);
        add(x, correction);
        for ((dx, df), share) in self.positions.iter().zip(&self.corrections).zip(shares.iter()) {
            for (n, x) in x.iter_mut().enumerate() {
                (0..3).for_each(|i| x[i] -= share * (dx[n][i] + df[n][i]));
            }
        }
    }

    /// Fractions of the differences that leave the least of `correction`.
    fn shares(&self, correction: &Nodal) -> DVector<f64> {
        let m = self.corrections.len();
        if m == 0 {
            return DVector::zeros(0);
        }
        let scale: Vec<f64> = self.corrections.iter().map(|f| dot(f, f).sqrt()).collect();
        let gram =
            DMatrix::from_fn(m, m, |i, j| dot(&self.corrections[i], &self.corrections[j]) / (scale[i] * scale[j]));
        let side = DVector::from_fn(m, |i, _| dot(&self.corrections[i], correction) / scale[i]);
        // Differences that are nearly dependent are left out: eigenvalues below rounding carry nothing.
        let shares = gram.svd(true, true).solve(&side, 1e-12).unwrap_or_else(|_| DVector::zeros(m));
        DVector::from_fn(m, |i, _| shares[i] / scale[i])
    }
}

fn difference(a: &Nodal, b: &Nodal) -> Nodal {
    a.iter().zip(b).map(|(a, b)| [0, 1, 2].map(|i| a[i] - b[i])).collect()
}

fn dot(a: &Nodal, b: &Nodal) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a * b).sum()
}
