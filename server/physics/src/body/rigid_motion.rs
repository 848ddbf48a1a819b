//! The rigid motion of a part: its momentum, and how it turns in a step.

use crate::{Mat3, Vec3};
use nalgebra::Rotation3;
use serde::{Deserialize, Serialize};

/// A free part turns by at most this angle in a step, rad: what it meets is looked for along a straight line.
pub(super) const MOST_TURN_RAD: f64 = 0.25;
/// Newton's iterations for the spin of a step; each gains two digits and more, as turns are small.
const SPIN_ITERATIONS: usize = 8;

/// Mass, and momentum that is missing, of a part or of several as one.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Totals {
    pub(super) mass: f64,
    pub(super) centre: Vec3,
    pub(super) linear: Vec3,
    pub(super) angular: Vec3,
    pub(super) inertia: Mat3,
    pub(super) velocity: Vec3,
    pub(super) spin: Vec3,
}

impl Totals {
    /// Two as one, about their common centre.
    #[must_use]
    pub(crate) fn joined(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        let centre = (self.centre * self.mass + other.centre * other.mass) / mass;
        let mut joined = Self { mass, centre, linear: self.linear + other.linear, ..Self::default() };
        for one in [self, other] {
            let arm = one.centre - centre;
            joined.angular += one.angular + arm.cross(&one.linear);
            joined.inertia += one.inertia + (Mat3::identity() * arm.dot(&arm) - arm * arm.transpose()) * one.mass;
        }
        joined
    }

    /// Velocity of the rigid motion at `x_m`.
    pub(super) fn motion_at(&self, x_m: Vec3) -> Vec3 {
        self.velocity + self.spin.cross(&(x_m - self.centre))
    }

    /// The rigid motion that makes up for what is missing.
    #[must_use]
    pub(crate) fn solved(mut self) -> Self {
        self.velocity = self.linear / self.mass;
        self.spin = self.inertia.lu().solve(&self.angular).unwrap_or_default();
        self
    }
}

/// The share of a spin by which a part turns as far as it may in a step.
pub(super) fn share_of_turn(spin: Vec3, dt_s: f64) -> f64 {
    (MOST_TURN_RAD / (dt_s * spin.norm())).min(1.0)
}

/// How a part turns in a step.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Turn {
    /// The part's motion at the beginning of the step.
    pub(super) motion: Totals,
    pub(super) rotation: Mat3,
}

impl Turn {
    /// By the mean of the spins at both ends of the step, in the frame that turns along (after Simo and Wong 1991). With the
    /// angular momentum L and the inertia J the spin is `J^-1 R^T L` at the end, R = exp(dt w), and w the mean of
    /// both: `R^T L - L` is at right angles to w then, so that the energy `1/2 L . R J^-1 R^T L` stays as it is.
    pub(super) fn of(motion: Totals, dt_s: f64) -> Self {
        let rotation = |spin: Vec3| *Rotation3::new(spin * dt_s).matrix();
        let inertia = motion.inertia.lu();
        let mut spin = motion.spin;
        for _ in 0..SPIN_ITERATIONS {
            let angular = rotation(spin).tr_mul(&motion.angular);
            let Some(after) = inertia.solve(&angular) else { break };
            // Newton's, with what the rotation changes by up to the second order of the turn.
            let turned = dt_s * angular.cross_matrix() * (Mat3::identity() - (0.5 * dt_s) * spin.cross_matrix());
            let change = inertia.solve(&turned).map(|changed| Mat3::identity() - 0.5 * changed);
            let Some(step) = change.and_then(|change| change.lu().solve(&(0.5 * (motion.spin + after) - spin))) else {
                break;
            };
            spin += step;
        }
        Self { motion, rotation: rotation(spin) }
    }
}
