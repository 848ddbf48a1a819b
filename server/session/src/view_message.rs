//! What viewers get of a session: structure, states and events.

use std::sync::Arc;

use kerf_physics::fault::Fault;
use kerf_physics::step_io::{EnergyStep, ToolOutput};
use kerf_physics::surface::delta::{AdaptedVertex, Keyframe, TopologyPatch};

use crate::shortfall::Shortfall;
use crate::status::StepTimes;
use crate::structure_log::Place;

/// Where everything is.
#[derive(Clone, Debug, Default)]
pub struct ViewState {
    pub(crate) place: Place,
    /// Version of the structure it belongs to.
    pub topology_version: u64,
    /// Steps taken.
    pub step: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Late steps since the session began or was reset.
    pub late_steps: u64,
    /// Per object: displacement of every node slot, xyz interleaved, m, scene frame.
    pub node_displacements_m: Vec<Vec<f32>>,
    /// Per object: vertices of its surface that are adapted to a blade, ids ascending.
    pub adapted: Vec<Vec<AdaptedVertex>>,
    /// One entry per tool of the scene.
    pub tools: Vec<ToolOutput>,
    /// Energy booked since the scene was at rest: levels as they are, all else summed up, as viewers see a
    /// step in many.
    pub energy: EnergyStep,
    /// Durations of the steps since the state before.
    pub times: StepTimes,
    /// When it was published, ns on the server's monotonic clock.
    pub published_ns: u64,
    /// It is shown whatever a viewer's rate: there may be no later one.
    pub(crate) is_hastened: bool,
}

impl ViewState {
    /// Rises when the scene starts over or goes back: versions, steps and node slots mean something else then.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        self.place.epoch
    }
}

/// Something that happened to a session.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneEvent {
    /// The session stands.
    Paused,
    /// The session steps on.
    Resumed,
    /// The scene is at rest again.
    Reset,
    /// The session ends; nothing follows.
    Closing,
    /// A step panicked; the session stands until it is reset.
    Failed,
    /// A driver took a tool.
    ToolTaken(usize),
    /// A tool has no driver any more.
    ToolReleased(usize),
    /// The session gave up time that it had lost.
    Reanchored,
    /// So large a share of the last seconds' steps was late: the scene runs slower than the hands that drive it.
    Overloaded(f64),
    /// Relative residual that solves end at from now on: bounded work leaves more, or the scene's tolerance is kept again.
    ToleranceChanged(f64),
    /// The state was saved as the checkpoint of this name.
    CheckpointSaved(Arc<str>),
    /// The scene is at the checkpoint of this name again, every tool lifted.
    CheckpointRestored(Arc<str>),
    /// A checkpoint of this name came as a file.
    CheckpointUploaded(Arc<str>),
    /// State that was not finite, or had energy from nowhere, was rolled back.
    Fault(Fault),
    /// Solves fell short of what was asked of them.
    Unsolved(Shortfall),
    /// So many pieces fell out of the scene's reach and were put away.
    PutAway(u32),
}

/// An event and when it happened.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewEvent {
    /// Step after which it happened.
    pub step: u64,
    /// What happened.
    pub event: SceneEvent,
}

/// What a viewer gets.
#[derive(Clone, Debug)]
pub enum ViewMessage {
    /// The whole structure.
    Keyframe(Arc<Keyframe>),
    /// What changed in the structure.
    Patch(Arc<TopologyPatch>),
    /// Where everything is.
    State(Arc<ViewState>),
    /// Something happened.
    Event(ViewEvent),
}
