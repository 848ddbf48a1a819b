//! What leaves a session for its drivers: what a step has led to.

use std::sync::Arc;

use kerf_physics::fault::Fault;
use kerf_physics::step_io::ToolOutput;

use crate::status::Phase;
use crate::tool_slot::Echo;

/// What drivers learn of a step.
#[derive(Clone, Debug, Default)]
pub struct StepReport {
    /// Steps taken.
    pub step: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// When the step ended, ns on the server's monotonic clock.
    pub ended_ns: u64,
    /// How long after the next step was due it ended, ns; 0 in time.
    pub lag_ns: u64,
    /// What the session is doing.
    pub phase: Phase,
    /// Times that the scene was put back to rest.
    pub resets: u64,
    /// Late steps since the session began or was reset.
    pub late_steps: u64,
    /// Times that too many steps were late, and the share of late ones the last time.
    pub overloads: u64,
    /// See [`crate::SceneEvent::Overloaded`].
    pub late_share: f64,
    /// Relative residual that solves end at: the scene's tolerance, or what bounded work has left lately.
    pub relative_tolerance: f64,
    /// Faults since the session began or was reset.
    pub faults: u64,
    /// The newest of them.
    pub last_fault: Option<Fault>,
    /// Times that the session went back to a checkpoint.
    pub restores: u64,
    /// The checkpoint that it went back to last.
    pub last_restored: Option<Arc<str>>,
    /// One entry per tool of the scene.
    pub tools: Vec<ToolReport>,
}

/// What drivers learn of a tool.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToolReport {
    /// Pose, wrench and contact model after the step.
    pub output: ToolOutput,
    /// The newest pose that the step has used.
    pub echo: Option<Echo>,
    /// How often the tool was put down after a jump.
    pub jumps: u64,
    /// It is lifted although a pose has it in the scene: there is tissue. It enters with a pose that is clear of it.
    pub waits: bool,
}
