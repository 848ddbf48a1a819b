//! Faults: what makes the servo let go.

use super::{Hand, Newest, model};

/// Why the servo let go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// The device gave a pose or a speed that is no number.
    HandNotFinite,
    /// The server sent a contact that is no number.
    ModelNotFinite,
    /// The force that came out of it is no number.
    ForceNotFinite,
    /// The servo was not called for too long, or the clock jumped.
    Gap,
    /// The hand was somewhere else from one call to the next.
    HandJumped,
}

impl Fault {
    /// For people.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::HandNotFinite => "the device gave a pose that is no number",
            Self::ModelNotFinite => "the server sent a contact that is no number",
            Self::ForceNotFinite => "the force was no number",
            Self::Gap => "the servo was not called for too long, or the clock jumped",
            Self::HandJumped => "the device's pose jumped",
        }
    }
}

/// When the servo lets go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultLimits {
    /// Longest time between two calls, s.
    pub max_gap_s: f64,
    /// Greatest speed of the hand between two calls, m/s.
    pub max_speed_m_per_s: f64,
    /// How long after the last fault nothing is rendered, s.
    pub hold_s: f64,
}

/// Holds the force back for some time after a fault.
#[derive(Clone, Copy, Debug)]
pub struct Trip {
    limits: FaultLimits,
    left_s: f64,
    last: Option<Fault>,
    count: u64,
}

impl Trip {
    /// Nothing has happened yet.
    #[must_use]
    pub fn new(limits: FaultLimits) -> Self {
        Self { limits, left_s: 0.0, last: None, count: 0 }
    }

    /// What is wrong with what the servo was given, if anything is; `before` is the hand at the last call.
    #[must_use]
    pub fn examine(&self, dt_s: f64, hand: &Hand, before: Option<&Hand>, newest: Option<&Newest<'_>>) -> Option<Fault> {
        let is_hand_finite = model::is_finite(&hand.pose) && hand.velocity_m_per_s.iter().all(|v| v.is_finite());
        let is_model_finite = newest.is_none_or(|newest| newest.update.is_finite());
        let moved_m = before.map_or(0.0, |before| (hand.pose.position_m - before.pose.position_m).norm());
        if !is_hand_finite {
            Some(Fault::HandNotFinite)
        } else if !is_model_finite {
            Some(Fault::ModelNotFinite)
        } else if !(dt_s > 0.0 && dt_s <= self.limits.max_gap_s) {
            Some(Fault::Gap)
        } else if moved_m > self.limits.max_speed_m_per_s * dt_s.max(1e-3) {
            Some(Fault::HandJumped)
        } else {
            None
        }
    }

    /// Lets go, and counts the fault unless it is the one that still holds.
    pub fn trip(&mut self, fault: Fault) {
        if self.left_s == 0.0 || self.last != Some(fault) {
            self.count += 1;
        }
        (self.left_s, self.last) = (self.limits.hold_s, Some(fault));
    }

    /// Time passes; the fault that still holds the force back.
    pub fn advance(&mut self, dt_s: f64) -> Option<Fault> {
        self.left_s = (self.left_s - dt_s).max(0.0);
        self.last.filter(|_| self.left_s > 0.0)
    }

    /// The last fault, whether it still holds or not, and how many there were.
    #[must_use]
    pub fn history(&self) -> (Option<Fault>, u64) {
        (self.last, self.count)
    }
}
