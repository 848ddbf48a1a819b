//! Every limit of a session, with its default and the reason for it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The name of a limit of sessions, as `--set` takes it. One that there is not does not compile.
macro_rules! setting {
    ($limit:ident) => {{
        const _: fn(&$crate::limits::SessionLimits) = |limits| _ = &limits.$limit;
        concat!("session.", stringify!($limit))
    }};
}

pub(crate) use setting;

/// Limits of sessions and of what they queue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SessionLimits {
    /// Sessions at a time. Default 64: what they cost is bounded by `max_memory_mib` and `max_load`, this bounds their
    /// threads.
    pub max_sessions: usize,
    /// Memory of all sessions and their checkpoints together, as it is estimated before they are built, MiB. Default
    /// half of what the machine or its container has: the estimate is near, and what is cut grows.
    pub max_memory_mib: Option<f64>,
    /// Cores that the steps of all sessions together may keep busy, as is estimated before they are built and measured
    /// while they step. Default 0.65 of what the machine has: the rest is for the network and for viewers. The first session
    /// is always admitted.
    pub max_load: Option<f64>,
    /// Time that a scene may take to be built, as it is estimated, s. Default 60: nobody waits longer.
    pub max_setup_s: f64,
    /// How long sessions have to end by themselves when the server is told to stop, s: none begins meanwhile. Default 0:
    /// they end at once. An orchestrator has to wait for as long, and for what `transport.drain_timeout_s` says.
    pub drain_s: f64,
    /// Scenes that are read and built at a time; others wait. Default 2: each takes a core from the sessions.
    pub max_builds: usize,
    /// A session that nobody drives, views or calls by its id for this long is closed, s. Default 300: longer than
    /// a client takes to come back, shorter than those who want its place wait.
    pub idle_timeout_s: f64,
    /// Threads a session steps with. Default 1: the result does not depend on it, and several
    /// sessions fill the cores better than one.
    pub threads_per_session: usize,
    /// Highest step rate a scene may ask for, Hz. Default 4000: beyond it the sleep's own
    /// granularity (about 50 us) is a good part of the step.
    pub max_rate_hz: f64,
    /// Lag that is caught up; more is given up, s. Default 0.1: a burst of steps longer than this
    /// is felt as the scene racing.
    pub max_lag_s: f64,
    /// Commands waiting for the next tick. Default 64: a tick takes milliseconds, so a fuller queue
    /// means that the session does not live.
    pub max_commands: usize,
    /// A tool that no pose arrived for in this time is lifted and its lease freed, s. Default 2:
    /// longer than a Wi-Fi handover, shorter than a surgeon waits for a tool that hangs.
    pub lease_s: f64,
    /// Drivers connected to a session at a time. Default 8: one per tool and spares that wait.
    pub max_drivers: usize,
    /// Viewers connected to a session at a time. Default 16: each costs its share of the network.
    pub max_viewers: usize,
    /// Rate at which state is published for viewers, Hz. Default 60: a screen's.
    pub view_rate_hz: f64,
    /// Topology patches kept for readers that are behind. Default 256: at one per step, a quarter
    /// of a second at 1 kHz; who is further behind is better served by a keyframe.
    pub max_log_patches: usize,
    /// Bytes that these patches may take. Default 16 MiB: ten times a keyframe of the largest scene.
    pub max_log_bytes: usize,
    /// Events (paused, tool taken, fault, ...) kept for readers that are behind. Default 64: they
    /// are rare, and a reader that misses one still has the session's state.
    pub max_log_events: usize,
    /// A session whose thread neither steps nor looks after its clients for this long hangs, s: health checks and metrics
    /// say so, and a reset may take `max_setup_s` more. Default 10: a hundred times the longest step that anybody can
    /// work with, and less than a team waits before it asks.
    pub hangs_after_s: f64,
    /// Shortest time between keyframes taken for readers that fell off the log, s. Default 0.25:
    /// a keyframe costs several steps' time, and everybody shares it.
    pub min_keyframe_interval_s: f64,
    /// Checkpoints that a session keeps to go back to. Default 8: each is a copy of the scene's state, of some
    /// megabytes.
    pub max_checkpoints: usize,
    /// What a plausible pose is.
    pub pose: PoseLimits,
}

impl Default for SessionLimits {
    fn default() -> Self {
        Self {
            max_sessions: 64,
            max_memory_mib: None,
            max_load: None,
            max_setup_s: 60.0,
            drain_s: 0.0,
            max_builds: 2,
            idle_timeout_s: 300.0,
            threads_per_session: 1,
            max_rate_hz: 4000.0,
            max_lag_s: 0.1,
            max_commands: 64,
            lease_s: 2.0,
            max_drivers: 8,
            max_viewers: 16,
            view_rate_hz: 60.0,
            max_log_patches: 256,
            max_log_bytes: 16 << 20,
            max_log_events: 64,
            hangs_after_s: 10.0,
            min_keyframe_interval_s: 0.25,
            max_checkpoints: 8,
            pose: PoseLimits::default(),
        }
    }
}

/// What a plausible pose is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PoseLimits {
    /// A coordinate's largest magnitude, m. Default 1: devices reach 0.2 m, scenes are smaller.
    pub workspace_half_extent_m: f64,
    /// How far a quaternion's norm may be from 1. Default 1e-2: f32 arithmetic and a client that
    /// interpolates linearly between near poses stay well within; what is within is normalised.
    pub quaternion_norm_tolerance: f64,
    /// Highest speed of the reference point, m/s. Default 3: hands reach 2 m/s in free space.
    pub max_speed_m_per_s: f64,
    /// Highest angular speed, rad/s. Default 60: a wrist's flick is 30.
    pub max_angular_speed_rad_per_s: f64,
    /// Rate at which jaws open and close at most, full openings a second. Default 20: fingers tap at 7 Hz, 70 ms a
    /// way. A button closes jaws in no time, and their tips would go through the tissue at 30 m/s.
    pub max_opening_rate_per_s: f64,
    /// Silence counts as this long at most, s. Default 0.05: after a longer one a tool that is far
    /// away has not moved through what lies between.
    pub speed_window_s: f64,
    /// A tool that a step leaves behind its newest pose follows at the limit of speed if it is there within this time,
    /// s; else it is lifted and put down there. Default 0.01, 3 cm: what a hand that cuts, at less than 0.5 m/s, is
    /// ahead by after a hiccup of 60 ms. Half lifts tools where the network merely stutters; twice sweeps through
    /// 6 cm of tissue as no hand did.
    pub catch_up_s: f64,
    /// Distance that is always plausible, m. Default 0.002: arrival times of neighbouring poses
    /// fall together when the network delivers in bursts.
    pub position_slack_m: f64,
    /// Rotation that is always plausible, rad. Default 0.1, for the same reason.
    pub rotation_slack_rad: f64,
}

impl Default for PoseLimits {
    fn default() -> Self {
        Self {
            workspace_half_extent_m: 1.0,
            quaternion_norm_tolerance: 1e-2,
            max_speed_m_per_s: 3.0,
            max_angular_speed_rad_per_s: 60.0,
            max_opening_rate_per_s: 20.0,
            speed_window_s: 0.05,
            catch_up_s: 0.01,
            position_slack_m: 0.002,
            rotation_slack_rad: 0.1,
        }
    }
}

/// A limit whose value makes no sense.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("session.{field} = {value}: must be {must_be}")]
pub struct LimitError {
    /// The limit's name in its section.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
    /// What it must be.
    pub must_be: &'static str,
}

impl SessionLimits {
    /// Refuses values that would stop a session from working.
    ///
    /// # Errors
    /// The first limit whose value makes no sense.
    pub fn validate(&self) -> Result<(), LimitError> {
        let pose = &self.pose;
        let positive = [
            ("max_sessions", self.max_sessions as f64),
            ("max_memory_mib", self.max_memory_mib.unwrap_or(1.0)),
            ("max_load", self.max_load.unwrap_or(1.0)),
            ("max_setup_s", self.max_setup_s),
            ("max_builds", self.max_builds as f64),
            ("idle_timeout_s", self.idle_timeout_s),
            ("threads_per_session", self.threads_per_session as f64),
            ("max_rate_hz", self.max_rate_hz),
            ("max_lag_s", self.max_lag_s),
            ("max_commands", self.max_commands as f64),
            ("lease_s", self.lease_s),
            ("max_drivers", self.max_drivers as f64),
            ("max_viewers", self.max_viewers as f64),
            ("view_rate_hz", self.view_rate_hz),
            ("max_log_patches", self.max_log_patches as f64),
            ("max_log_bytes", self.max_log_bytes as f64),
            ("max_log_events", self.max_log_events as f64),
            ("hangs_after_s", self.hangs_after_s),
            ("min_keyframe_interval_s", self.min_keyframe_interval_s),
            ("max_checkpoints", self.max_checkpoints as f64),
            ("pose.workspace_half_extent_m", pose.workspace_half_extent_m),
            ("pose.quaternion_norm_tolerance", pose.quaternion_norm_tolerance),
            ("pose.max_speed_m_per_s", pose.max_speed_m_per_s),
            ("pose.max_angular_speed_rad_per_s", pose.max_angular_speed_rad_per_s),
            ("pose.max_opening_rate_per_s", pose.max_opening_rate_per_s),
            ("pose.speed_window_s", pose.speed_window_s),
            ("pose.catch_up_s", pose.catch_up_s),
            ("pose.position_slack_m", pose.position_slack_m),
            ("pose.rotation_slack_rad", pose.rotation_slack_rad),
        ];
        match positive.into_iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            Some((field, value)) => Err(LimitError { field, value, must_be: "finite and greater than 0" }),
            None if pose.quaternion_norm_tolerance >= 1.0 => Err(LimitError {
                field: "pose.quaternion_norm_tolerance",
                value: pose.quaternion_norm_tolerance,
                must_be: "less than 1, or the zero quaternion would pass",
            }),
            // Also keeps it within what the runtime can represent.
            None if !(0.0..=1e9).contains(&self.drain_s) => {
                Err(LimitError { field: "drain_s", value: self.drain_s, must_be: "0 to 1e9" })
            }
            None => Ok(()),
        }
    }
}

/// Seconds of a limit as the clock's nanoseconds.
pub(crate) fn to_ns(seconds: f64) -> u64 {
    (seconds * 1e9) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid() {
        assert_eq!(SessionLimits::default().validate(), Ok(()));
    }

    #[test]
    fn a_limit_that_makes_no_sense_is_named() {
        let mut limits = SessionLimits { lease_s: f64::NAN, ..SessionLimits::default() };
        assert_eq!(
            limits.validate().unwrap_err().to_string(),
            "session.lease_s = NaN: must be finite and greater than 0"
        );
        limits.lease_s = 2.0;
        limits.pose.quaternion_norm_tolerance = 1.0;
        assert_eq!(limits.validate().map_err(|e| e.field), Err("pose.quaternion_norm_tolerance"));
        let limits = SessionLimits { drain_s: -1.0, ..SessionLimits::default() };
        assert_eq!(limits.validate().map_err(|e| e.field), Err("drain_s"));
    }

    #[test]
    fn an_unknown_limit_is_refused() {
        let error = toml::from_str::<SessionLimits>("max_sesions = 3").unwrap_err();
        assert!(error.to_string().contains("max_sesions"), "{error}");
    }
}
