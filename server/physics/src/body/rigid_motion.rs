//! The rigid motion of a part: its momentum, and how it turns in a step.

use crate::{Mat3, Vec3};
use nalgebra::Rotation3;
use serde::{Deserialize, Serialize};

/// A free part turns by at most this angle in a step, rad: what it meets is looked for along a straight line.
pub(super) const MOST_TURN_RAD: f64 = 0.25;
/// Fixed-point iterations for the spin at the middle of a step; each gains as many digits as the turn is small.
const SPIN_ITERATIONS: usize = 4;

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
    pub(super) fn of(motion: Totals, dt_s: f64) -> Self {
        let rotation = |spin: Vec3, share: f64| *Rotation3::new(spin * (share * dt_s)).matrix();
        let mut spin = motion.spin;
        let inertia = motion.inertia.lu();
        for _ in 0..SPIN_ITERATIONS {
            let half = rotation(spin, 0.5);
            spin = half * inertia.solve(&half.tr_mul(&motion.angular)).unwrap_or_default();
        }
        Self { motion, rotation: rotation(spin, 1.0) }
    }
}
