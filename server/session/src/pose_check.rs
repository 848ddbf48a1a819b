//! Whether a pose that arrived may move a tool: does it lie in the workspace, and could the tool have moved
//! there since its last accepted pose?

use kerf_physics::Pose;

use crate::limits::PoseLimits;
use crate::pose_refusal::PoseRefusal;
use crate::reach::{Placement, Reach};

/// Where a driver says that a tool is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// Rises with every pose of a driver.
    pub seq: u64,
    /// The client's clock when the pose was measured, ns; echoed.
    pub client_ns: u64,
    /// The pose.
    pub pose: Pose,
    /// Fraction of their full opening that the tool's jaws take, 0 (closed) to 1; what has none ignores it.
    pub opening: f64,
}

impl PoseSample {
    pub(crate) fn placement(&self) -> Placement {
        Placement { pose: self.pose, opening: self.opening }
    }
}

/// A sample that passed, and when it arrived.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TimedPose {
    pub sample: PoseSample,
    pub arrived_ns: u64,
}

/// Whether a tool may be where the sample says, wherever it was before.
pub(crate) fn check_place(sample: &PoseSample, limits: &PoseLimits) -> Result<(), PoseRefusal> {
    let limit_m = limits.workspace_half_extent_m;
    let within = -limit_m..=limit_m;
    if let Some(&value_m) = sample.pose.position_m.iter().find(|value_m| !within.contains(value_m)) {
        return Err(PoseRefusal::OutsideWorkspace { value_m, limit_m });
    }
    match (0.0..=1.0).contains(&sample.opening) {
        true => Ok(()),
        false => Err(PoseRefusal::NoOpening { opening: sample.opening }),
    }
}

/// Whether the tool can have moved from one pose to the other.
pub(crate) fn check_motion(from: &TimedPose, to: &TimedPose, limits: &PoseLimits) -> Result<(), PoseRefusal> {
    let elapsed_s = elapsed_s(from, to).min(limits.speed_window_s);
    let reach = Reach::within(elapsed_s, limits).plus(Reach::slack(limits));
    reach.check(&from.sample.pose, &to.sample.pose)
}

/// The longer of what the server's and the client's clock say: poses that a network held up arrive
/// together though they were measured apart. The caller bounds it, so a lying clock gains little.
fn elapsed_s(from: &TimedPose, to: &TimedPose) -> f64 {
    let arrived_ns = to.arrived_ns.saturating_sub(from.arrived_ns);
    let measured_ns = to.sample.client_ns.saturating_sub(from.sample.client_ns);
    arrived_ns.max(measured_ns) as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::{Quat, Vec3};

    fn timed(x_m: f64, turned_rad: f64, arrived_ns: u64, client_ns: u64) -> TimedPose {
        let orientation = Quat::from_axis_angle(&Vec3::y_axis(), turned_rad);
        let pose = Pose { position_m: Vec3::new(x_m, 0.0, 0.0), orientation };
        TimedPose { sample: PoseSample { seq: 0, client_ns, pose, opening: 1.0 }, arrived_ns }
    }

    #[test]
    fn what_lies_outside_the_workspace_or_opens_too_far_is_refused_with_its_field() {
        let sample = timed(0.0, 0.0, 0, 0).sample;
        let at = |z_m| PoseSample { pose: Pose { position_m: Vec3::new(0.0, 0.0, z_m), ..sample.pose }, ..sample };
        let refused = |sample| check_place(&sample, &PoseLimits::default()).map_err(|refusal| refusal.field());
        assert_eq!(refused(at(-1.0)), Ok(()));
        assert_eq!([refused(at(-1e6)), refused(at(f64::NAN))], [Err("pose.position_m"); 2]);
        let opened = |opening| refused(PoseSample { opening, ..sample });
        assert_eq!([opened(f64::NAN), opened(1.1)], [Err("opening"); 2]);
    }

    #[test]
    fn motion_is_judged_by_elapsed_time() {
        let limits = PoseLimits::default();
        let from = timed(0.0, 0.0, 0, 0);
        assert!(matches!(
            check_motion(&from, &timed(0.01, 0.0, 1_000_000, 0), &limits),
            Err(PoseRefusal::TooFast { .. })
        ));
        assert_eq!(check_motion(&from, &timed(0.01, 0.0, 10_000_000, 0), &limits), Ok(()));
        let turned = check_motion(&from, &timed(0.0, 3.0, 1_000_000, 0), &limits);
        assert!(matches!(turned, Err(PoseRefusal::TurnedTooFast { .. })));
    }

    #[test]
    fn poses_that_a_network_held_up_are_judged_by_the_clients_clock() {
        let held_up = timed(0.01, 0.0, 1_000, 10_000_000);
        assert_eq!(check_motion(&timed(0.0, 0.0, 0, 0), &held_up, &PoseLimits::default()), Ok(()));
    }

    #[test]
    fn neither_silence_nor_a_lying_clock_makes_a_far_jump_plausible() {
        let far = timed(0.9, 0.0, 3_600_000_000_000, u64::MAX);
        assert!(check_motion(&timed(0.0, 0.0, 0, 0), &far, &PoseLimits::default()).is_err());
    }

    #[test]
    fn the_same_rotation_with_the_opposite_sign_has_not_turned() {
        let limits = PoseLimits::default();
        let mut to = timed(0.0, 0.0, 0, 0);
        to.sample.pose.orientation = Quat::new_unchecked(-to.sample.pose.orientation.into_inner());
        assert_eq!(check_motion(&timed(0.0, 0.0, 0, 0), &to, &limits), Ok(()));
    }
}
