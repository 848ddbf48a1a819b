//! Steps that are asked for one call at a time, and what they lead to.

use kerf_physics::Vec3;
use kerf_physics::step_io::{EnergyStep, ToolOutput};

use crate::pose_check::PoseSample;

/// Steps to take without waiting for their deadlines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Steps {
    /// How many.
    pub count: u32,
    /// What tools do in each of them; in those beyond the last entry tools stay where they are.
    pub inputs: Vec<StepInput>,
}

/// What tools do in one step; of several motions of one tool the last counts.
pub type StepInput = Vec<StepMotion>;

/// What a tool does in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepMotion {
    /// The tool, an index into the scene's.
    pub tool: usize,
    /// Where it goes, or enters if it is lifted; `None`: it is lifted.
    pub to: Option<PoseSample>,
}

/// Steps that were taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Stepped {
    /// One entry per step.
    pub outcomes: Vec<StepOutcome>,
    /// Version of the structure after the last.
    pub topology_version: u64,
    /// Hash of positions, velocities, fronts and topology after the last.
    pub state_hash: u64,
}

/// What a step has led to.
#[derive(Clone, Debug, PartialEq)]
pub struct StepOutcome {
    /// Steps taken, this one included.
    pub step: u64,
    /// Simulated time at its end, s.
    pub sim_time_s: f64,
    /// One entry per tool of the scene.
    pub tools: Vec<ToolOutput>,
    /// By tool: see [`crate::ToolReport::waits`].
    pub waits: Vec<bool>,
    /// Energy booked since the scene was at rest.
    pub energy: EnergyStep,
    /// Displacement of each tracked point, m.
    pub tracked_displacement_m: Vec<Vec3>,
}
