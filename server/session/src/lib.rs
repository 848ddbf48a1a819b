//! Sessions: each owns one [`kerf_physics::World`], paced by absolute deadlines. What a session does is a core
//! without a clock and without a thread; one named OS thread per session lends it both.
//!
//! In: tool poses, latest-wins per tool, and commands from a bounded queue; both are drained at the
//! start of a tick. Out: the structure of the scene as an ordered bounded log, and its state,
//! latest-wins. Nothing is queued per client, and nothing is computed for viewers while nobody views. Whoever records a
//! session gets all its steps from a bounded tape; what was recorded is played in a session's place.
//!
//! Deliberately absent: locks on the world, steps inside async tasks, dropped or stretched steps,
//! knowledge of the wire and of files.

mod admission;
mod checkpoints;
pub mod clock;
pub mod counts;
pub mod error;
mod feed;
mod governor;
mod inbox;
mod late_steps;
pub mod limits;
mod lock;
mod outbox;
mod overload;
pub mod pacer;
mod past;
pub mod player;
pub mod pose_check;
mod pose_refusal;
mod prepare;
pub mod priority;
mod projector;
mod publisher;
mod reach;
pub mod registry;
pub mod resimulation;
mod seek;
pub mod session;
mod session_core;
mod session_id;
mod session_options;
#[cfg(feature = "virtual-time")]
mod session_task;
mod session_thread;
mod shortfall;
mod showcase;
pub mod status;
mod step_report;
pub mod stepping;
mod structure_log;
pub mod tape;
mod tool_slot;
mod view_message;
#[cfg(feature = "virtual-time")]
pub mod virtual_time;
mod vitals;

pub use checkpoints::{Checkpoint, CheckpointInfo, FileError, MAX_CHECKPOINT_NAME_BYTES};
pub use counts::Counts;
pub use error::SessionError;
pub use inbox::Inspection;
pub use late_steps::{LateStep, MAX_LATE_STEPS};
pub use limits::{PoseLimits, SessionLimits};
pub use outbox::Viewer;
pub use past::{Past, PastEntry};
pub use player::{Footage, Frame, Structure};
pub use pose_check::PoseSample;
pub use pose_refusal::PoseRefusal;
pub use registry::Registry;
pub use resimulation::{Difference, Resimulation};
pub use seek::{Position, Seek};
pub use session::{Driver, Replay, Reports, Session};
pub use session_id::{InstanceId, SessionId};
pub use session_options::{Owner, SessionOptions};
pub use shortfall::Shortfall;
pub use status::{Phase, SessionStatus, StepTallies, StepTally, StepTimes};
pub use step_report::{StepReport, ToolReport};
pub use tape::{Base, LoggedInputs, Reel, TapeEntry, TapeReader, TapeState, TapedStep};
pub use tool_slot::{DriverId, Echo, Loss};
pub use view_message::{SceneEvent, ViewEvent, ViewMessage, ViewState};
pub use vitals::{Done, Watched};

/// Target of the spans that are traced, and of nothing else.
pub const TRACES: &str = "kerf::traces";
