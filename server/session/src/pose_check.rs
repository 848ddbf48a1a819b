//! Whether a pose that arrived may move a tool.
//!
//! Two questions: is it a pose at all (finite, a rotation, within the workspace), and could the
//! tool have moved there since its last accepted pose.

use kerf_physics::tool::Pose;
use kerf_physics::{Quat, Vec3};
use nalgebra::Quaternion;

use crate::limits::PoseLimits;

/// A pose as it arrived, unchecked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// Rises with every pose of a driver.
    pub seq: u64,
    /// The client's clock when the pose was measured, ns; echoed.
    pub client_ns: u64,
    /// Reference point, m, scene frame.
    pub position_m: [f64; 3],
    /// Rotation from the tool frame to the scene frame, xyzw.
    pub orientation_xyzw: [f64; 4],
    /// Share of their full opening that the tool's jaws take, 0 (closed) to 1; what has none ignores it.
    pub opening: f64,
}

/// A pose that passed, and when it arrived.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TimedPose {
    pub pose: Pose,
    pub seq: u64,
    pub client_ns: u64,
    pub arrived_ns: u64,
}

/// Why a pose was refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PoseRefusal {
    /// The scene has no such tool.
    #[error("tool {tool}: the scene has {tools} tools")]
    NoTool {
        /// The tool named.
        tool: u64,
        /// Tools of the scene.
        tools: usize,
    },
    /// Another driver holds the tool.
    #[error("tool {tool} is driven by another client until {lease_s} s after its last pose")]
    ToolTaken {
        /// The tool named.
        tool: u64,
        /// `lease_s`.
        lease_s: f64,
    },
    /// The driver did not ask for the tool.
    #[error("tool {tool}: not among the tools that the driver claimed")]
    NotClaimed {
        /// The tool named.
        tool: u64,
    },
    /// The sequence number did not rise.
    #[error("seq {seq}: must be greater than the last accepted {last}")]
    SeqNotRising {
        /// The number that arrived.
        seq: u64,
        /// The last one that was accepted.
        last: u64,
    },
    /// The position is missing or not finite.
    #[error("position_m: must be three finite numbers")]
    PositionNotFinite,
    /// The orientation is missing or not finite.
    #[error("orientation: must be four finite numbers")]
    OrientationNotFinite,
    /// The quaternion is not a rotation.
    #[error("orientation: norm {norm}, must be within {tolerance} of 1")]
    NotUnit {
        /// Its norm.
        norm: f64,
        /// `pose.quaternion_norm_tolerance`.
        tolerance: f64,
    },
    /// The position is outside the workspace.
    #[error("position_m: {value_m} m, must be within {limit_m} m of the origin on each axis")]
    OutsideWorkspace {
        /// The coordinate furthest outside, m.
        value_m: f64,
        /// `pose.workspace_half_extent_m`.
        limit_m: f64,
    },
    /// The opening is no share.
    #[error("opening: {opening}, must be between 0 and 1")]
    NoOpening {
        /// What arrived.
        opening: f64,
    },
    /// The reference point cannot have moved so far in the time.
    #[error("position_m: moved {moved_m} m, at most {limit_m} m is plausible since the last accepted pose")]
    TooFast {
        /// Distance from the last accepted pose, m.
        moved_m: f64,
        /// Plausible distance in the elapsed time, m.
        limit_m: f64,
    },
    /// The tool cannot have turned so far in the time.
    #[error("orientation: turned {turned_rad} rad, at most {limit_rad} rad is plausible since the last accepted pose")]
    TurnedTooFast {
        /// Angle from the last accepted pose, rad.
        turned_rad: f64,
        /// Plausible angle in the elapsed time, rad.
        limit_rad: f64,
    },
}

impl PoseRefusal {
    /// Path of the field that was refused, as on the wire.
    #[must_use]
    pub fn field(&self) -> &'static str {
        match self {
            Self::NoTool { .. } | Self::ToolTaken { .. } | Self::NotClaimed { .. } => "tool_id",
            Self::SeqNotRising { .. } => "seq",
            Self::PositionNotFinite | Self::OutsideWorkspace { .. } | Self::TooFast { .. } => "pose.position_m",
            Self::OrientationNotFinite | Self::NotUnit { .. } | Self::TurnedTooFast { .. } => "pose.orientation",
            Self::NoOpening { .. } => "opening",
        }
    }

    /// The limit that the field broke, for people.
    #[must_use]
    pub fn limit(&self) -> String {
        match self {
            Self::NoTool { tools, .. } => format!("less than {tools}, the scene's number of tools"),
            Self::ToolTaken { lease_s, .. } => format!("driven by another client; lease {lease_s} s"),
            Self::NotClaimed { .. } => "among the tools claimed".into(),
            Self::SeqNotRising { last, .. } => format!("greater than {last}"),
            Self::PositionNotFinite | Self::OrientationNotFinite => "finite".into(),
            Self::NotUnit { tolerance, .. } => format!("norm within {tolerance} of 1"),
            Self::OutsideWorkspace { limit_m, .. } => format!("within {limit_m} m of the origin on each axis"),
            Self::NoOpening { .. } => "between 0 and 1".into(),
            Self::TooFast { limit_m, .. } => format!("at most {limit_m:.4} m from the last accepted pose"),
            Self::TurnedTooFast { limit_rad, .. } => format!("at most {limit_rad:.4} rad from the last accepted pose"),
        }
    }
}

/// The sample as a pose with a unit quaternion, if it is one and lies in the workspace.
pub(crate) fn check_shape(sample: &PoseSample, limits: &PoseLimits) -> Result<Pose, PoseRefusal> {
    if !sample.position_m.iter().all(|v| v.is_finite()) {
        return Err(PoseRefusal::PositionNotFinite);
    }
    if !sample.orientation_xyzw.iter().all(|v| v.is_finite()) {
        return Err(PoseRefusal::OrientationNotFinite);
    }
    let position_m = Vec3::from(sample.position_m);
    let value_m = position_m[position_m.iamax()];
    if value_m.abs() > limits.workspace_half_extent_m {
        return Err(PoseRefusal::OutsideWorkspace { value_m, limit_m: limits.workspace_half_extent_m });
    }
    let [x, y, z, w] = sample.orientation_xyzw;
    let norm = [x, y, z, w].iter().map(|v| v * v).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > limits.quaternion_norm_tolerance {
        return Err(PoseRefusal::NotUnit { norm, tolerance: limits.quaternion_norm_tolerance });
    }
    if !(0.0..=1.0).contains(&sample.opening) {
        return Err(PoseRefusal::NoOpening { opening: sample.opening });
    }
    let orientation = Quat::new_normalize(Quaternion::new(w, x, y, z));
    Ok(Pose { position_m, orientation })
}

/// Whether the tool can have moved from one pose to the other.
pub(crate) fn check_motion(from: &TimedPose, to: &TimedPose, limits: &PoseLimits) -> Result<(), PoseRefusal> {
    let elapsed_s = elapsed_s(from, to).min(limits.speed_window_s);
    let moved_m = (to.pose.position_m - from.pose.position_m).norm();
    let limit_m = limits.max_speed_m_per_s * elapsed_s + limits.position_slack_m;
    if moved_m > limit_m {
        return Err(PoseRefusal::TooFast { moved_m, limit_m });
    }
    let turned_rad = from.pose.orientation.angle_to(&to.pose.orientation);
    let limit_rad = limits.max_angular_speed_rad_per_s * elapsed_s + limits.rotation_slack_rad;
    if turned_rad > limit_rad {
        return Err(PoseRefusal::TurnedTooFast { turned_rad, limit_rad });
    }
    Ok(())
}

/// The longer of what the server's and the client's clock say: poses that a network held up arrive
/// together though they were measured apart. The caller bounds it, so a lying clock gains little.
fn elapsed_s(from: &TimedPose, to: &TimedPose) -> f64 {
    let arrived_ns = to.arrived_ns.saturating_sub(from.arrived_ns);
    let measured_ns = to.client_ns.saturating_sub(from.client_ns);
    arrived_ns.max(measured_ns) as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const AT_REST: PoseSample =
        PoseSample { seq: 1, client_ns: 0, position_m: [0.0; 3], orientation_xyzw: [0.0, 0.0, 0.0, 1.0], opening: 1.0 };

    fn timed(x_m: f64, turned_rad: f64, arrived_ns: u64, client_ns: u64) -> TimedPose {
        let orientation = Quat::from_axis_angle(&Vec3::y_axis(), turned_rad);
        TimedPose { pose: Pose { position_m: Vec3::new(x_m, 0.0, 0.0), orientation }, seq: 0, client_ns, arrived_ns }
    }

    #[test]
    fn a_pose_that_is_none_is_refused_with_its_field() {
        let limits = PoseLimits::default();
        let field = |sample: PoseSample| check_shape(&sample, &limits).unwrap_err().field();
        assert_eq!(field(PoseSample { position_m: [0.0, f64::NAN, 0.0], ..AT_REST }), "pose.position_m");
        assert_eq!(field(PoseSample { position_m: [0.0, 0.0, -1e6], ..AT_REST }), "pose.position_m");
        assert_eq!(field(PoseSample { orientation_xyzw: [0.0, 0.0, 0.0, 0.5], ..AT_REST }), "pose.orientation");
        assert_eq!(field(PoseSample { orientation_xyzw: [1e300; 4], ..AT_REST }), "pose.orientation");
        assert_eq!(field(PoseSample { opening: f64::NAN, ..AT_REST }), "opening");
        assert_eq!(field(PoseSample { opening: 1.1, ..AT_REST }), "opening");
        assert_eq!(
            field(PoseSample { orientation_xyzw: [f64::INFINITY, 0.0, 0.0, 1.0], ..AT_REST }),
            "pose.orientation"
        );
    }

    #[test]
    fn a_nearly_unit_quaternion_is_normalised() {
        let sample = PoseSample { orientation_xyzw: [0.0, 0.0, 0.0, 1.005], ..AT_REST };
        let pose = check_shape(&sample, &PoseLimits::default()).unwrap();
        assert!((pose.orientation.norm() - 1.0).abs() < 1e-15);
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
        let minus = check_shape(&PoseSample { orientation_xyzw: [0.0, 0.0, 0.0, -1.0], ..AT_REST }, &limits).unwrap();
        let to = TimedPose { pose: minus, seq: 0, client_ns: 0, arrived_ns: 0 };
        assert_eq!(check_motion(&timed(0.0, 0.0, 0, 0), &to, &limits), Ok(()));
    }

    proptest! {
        #[test]
        fn what_passes_is_finite_unit_and_inside(
            position_m in prop::array::uniform3(prop::num::f64::ANY),
            orientation_xyzw in prop::array::uniform4(prop_oneof![prop::num::f64::ANY, -1.0..1.0]),
        ) {
            let limits = PoseLimits::default();
            if let Ok(pose) = check_shape(&PoseSample { position_m, orientation_xyzw, ..AT_REST }, &limits) {
                prop_assert!(pose.position_m.amax() <= limits.workspace_half_extent_m);
                prop_assert!((pose.orientation.norm() - 1.0).abs() < 1e-12);
            }
        }
    }
}
