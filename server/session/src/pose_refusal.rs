//! Why a pose was refused, with the field and the limit.

use kerf_physics::PoseError;

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
