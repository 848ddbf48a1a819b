//! How far a step may move a tool: no farther than a hand at the limit of speed comes in the time of the step.
//!
//! Poses are judged one by one as they arrive ([`crate::pose_check`]). What they add up to within one step is judged
//! here: each of a burst is plausible after the one before, and together they would throw a blade through the tissue in
//! a millisecond.

use kerf_physics::Pose;

use crate::limits::PoseLimits;
use crate::pose_refusal::PoseRefusal;

/// Where a tool is, and how far its jaws are open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    pub pose: Pose,
    /// Fraction of the full opening, 0 (closed) to 1.
    pub opening: f64,
}

/// How far a tool comes in some time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reach {
    moved_m: f64,
    turned_rad: f64,
    /// Of the jaws, as a fraction of their full opening.
    opened: f64,
    /// The limit of speed that the way is gone at, to be told.
    max_m_per_s: f64,
}

impl Reach {
    /// In `time_s` at the limits of speed.
    pub fn within(time_s: f64, limits: &PoseLimits) -> Self {
        Self {
            moved_m: limits.max_speed_m_per_s * time_s,
            turned_rad: limits.max_angular_speed_rad_per_s * time_s,
            opened: limits.max_opening_rate_per_s * time_s,
            max_m_per_s: limits.max_speed_m_per_s,
        }
    }

    /// What is always plausible, in no time; jaws may have done anything.
    pub fn slack(limits: &PoseLimits) -> Self {
        Self {
            moved_m: limits.position_slack_m,
            turned_rad: limits.rotation_slack_rad,
            opened: f64::INFINITY,
            max_m_per_s: limits.max_speed_m_per_s,
        }
    }

    /// The longer of two ways that are gone one after the other.
    pub fn plus(self, other: Self) -> Self {
        Self {
            moved_m: self.moved_m + other.moved_m,
            turned_rad: self.turned_rad + other.turned_rad,
            opened: self.opened + other.opened,
            max_m_per_s: self.max_m_per_s,
        }
    }

    /// Whether the tool comes from one pose to the other.
    ///
    /// # Errors
    /// The way or the turn is too long.
    pub fn check(&self, from: &Pose, to: &Pose) -> Result<(), PoseRefusal> {
        let moved_m = (to.position_m - from.position_m).norm();
        if moved_m > self.moved_m {
            return Err(PoseRefusal::TooFast { moved_m, limit_m: self.moved_m, max_m_per_s: self.max_m_per_s });
        }
        let turned_rad = from.orientation.angle_to(&to.orientation);
        if turned_rad > self.turned_rad {
            return Err(PoseRefusal::TurnedTooFast { turned_rad, limit_rad: self.turned_rad });
        }
        Ok(())
    }

    /// As far towards `to` as the tool comes: way, turn and jaws each by themselves, so that a button that closes jaws
    /// at once does not hold the hand back.
    pub fn toward(&self, from: &Placement, to: &Placement) -> Placement {
        let way_m = to.pose.position_m - from.pose.position_m;
        let position_m = match share(self.moved_m, way_m.norm()) {
            None => to.pose.position_m,
            Some(share) => from.pose.position_m + way_m * share,
        };
        let turn = to.pose.orientation * from.pose.orientation.inverse();
        let mut orientation = to.pose.orientation;
        if let Some(share) = share(self.turned_rad, turn.angle()) {
            orientation = turn.powf(share) * from.pose.orientation;
            orientation.renormalize();
        }
        let opening = to.opening.clamp(from.opening - self.opened, from.opening + self.opened);
        Placement { pose: Pose { position_m, orientation }, opening }
    }
}

/// Share of a way that is within reach; `None`: all of it.
fn share(reach: f64, way: f64) -> Option<f64> {
    (way > reach).then(|| reach / way)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::{Quat, Vec3};

    fn placement(x_m: f64, turned_rad: f64, opening: f64) -> Placement {
        let orientation = Quat::from_axis_angle(&Vec3::y_axis(), turned_rad);
        Placement { pose: Pose { position_m: Vec3::new(x_m, 0.0, 0.0), orientation }, opening }
    }

    #[test]
    fn what_is_within_reach_is_gone_to_the_last_bit() {
        let reach = Reach::within(1e-3, &PoseLimits::default());
        let (from, to) = (placement(0.0, 0.0, 1.0), placement(2.9e-3, 0.05, 0.99));
        assert_eq!(reach.toward(&from, &to), to);
        assert_eq!(reach.check(&from.pose, &to.pose), Ok(()));
    }

    #[test]
    fn way_turn_and_jaws_go_as_far_as_their_limits_of_speed_allow() {
        let reach = Reach::within(1e-3, &PoseLimits::default());
        let (from, to) = (placement(0.0, 0.0, 1.0), placement(0.06, 1.0, 0.0));
        let next = reach.toward(&from, &to);
        assert!((next.pose.position_m.x - 3e-3).abs() < 1e-15, "{next:?}");
        assert!((next.pose.orientation.angle() - 0.06).abs() < 1e-12, "{next:?}");
        assert!((next.pose.orientation.angle_to(&to.pose.orientation) - 0.94).abs() < 1e-12, "on the shortest way");
        assert!((next.opening - 0.98).abs() < 1e-15, "{next:?}");
        assert!(matches!(reach.check(&from.pose, &to.pose), Err(PoseRefusal::TooFast { .. })));
    }

    #[test]
    fn a_rotation_is_the_same_with_either_sign() {
        let reach = Reach::within(1e-3, &PoseLimits::default());
        let (from, mut to) = (placement(0.0, 0.0, 1.0), placement(0.0, 0.5, 1.0));
        let next = reach.toward(&from, &to);
        to.pose.orientation = Quat::new_unchecked(-to.pose.orientation.into_inner());
        let other = reach.toward(&from, &to);
        assert!(next.pose.orientation.angle_to(&other.pose.orientation) < 1e-12);
        let half_a_turn = placement(0.0, std::f64::consts::PI, 1.0);
        assert!((reach.toward(&from, &half_a_turn).pose.orientation.angle() - 0.06).abs() < 1e-12);
    }
}
