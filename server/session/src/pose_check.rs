//! Whether a pose that arrived may move a tool: does it lie in the workspace, and could the tool have moved
//! there since its last accepted pose?

use kerf_physics::tool::{Pose, PoseError};

use crate::limits::PoseLimits;
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
    /// The numbers state no pose.
    #[error(transparent)]
    NoPose(#[from] PoseError),
    /// The position is outside the workspace.
    #[error("position_m: {value_m} m, must be within {limit_m} m of the origin on each axis")]
    OutsideWorkspace {
        /// A coordinate that is outside, m.
        value_m: f64,
        /// `pose.workspace_half_extent_m`.
        limit_m: f64,
    },
    /// The opening is no fraction.
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
        /// `pose.max_tool_speed_m_per_s`.
        max_m_per_s: f64,
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
            Self::NoPose(PoseError::PositionNotFinite) | Self::OutsideWorkspace { .. } | Self::TooFast { .. } => {
                "pose.position_m"
            }
            Self::NoPose(PoseError::OrientationNotFinite | PoseError::NoRotation { .. })
            | Self::TurnedTooFast { .. } => "pose.orientation",
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
            Self::NoPose(PoseError::PositionNotFinite | PoseError::OrientationNotFinite) => "finite".into(),
            Self::NoPose(PoseError::NoRotation { tolerance, .. }) => format!("norm within {tolerance} of 1"),
            Self::OutsideWorkspace { limit_m, .. } => format!("within {limit_m} m of the origin on each axis"),
            Self::NoOpening { .. } => "between 0 and 1".into(),
            Self::TooFast { moved_m, limit_m, max_m_per_s } => {
                // Over the time that the limit is for.
                let m_per_s = max_m_per_s * moved_m / limit_m;
                format!(
                    "too fast: {m_per_s:.3} m/s, limit {max_m_per_s:.3} m/s: at most {limit_m:.4} m from the last \
                     accepted pose, not {moved_m:.4} m"
                )
            }
            Self::TurnedTooFast { turned_rad, limit_rad } => {
                format!("too fast: at most {limit_rad:.4} rad from the last accepted pose, not {turned_rad:.4} rad")
            }
        }
    }
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
