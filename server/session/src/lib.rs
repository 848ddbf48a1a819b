//! Sessions: each owns one [`kerf_physics::World`] on one named OS thread, paced by absolute
//! deadlines.
//!
//! In: tool poses, latest-wins per tool, and commands from a bounded queue; both are drained at the
//! start of a tick. Out: the structure of the scene as an ordered bounded log, and its state,
//! latest-wins. Nothing is queued per client, and nothing is computed for viewers while nobody views.
//!
//! Deliberately absent: locks on the world, steps inside async tasks, dropped or stretched steps,
//! knowledge of the wire and of files.

pub mod clock;
pub mod error;
mod governor;
mod inbox;
pub mod limits;
mod outbox;
pub mod pacer;
mod points;
pub mod pose_check;
pub mod recorder;
pub mod registry;
mod runner;
pub mod session;
pub mod status;
mod structure_log;
mod tool_slot;

pub use error::SessionError;
pub use inbox::Probe;
pub use limits::{PoseLimits, SessionLimits};
pub use outbox::{SceneEvent, StepReport, ToolReport, ViewEvent, ViewMessage, ViewState, Viewer};
pub use points::{MAX_POINT_NAME_BYTES, PointInfo};
pub use pose_check::{PoseRefusal, PoseSample};
pub use recorder::{InputLog, LoggedInputs};
pub use registry::{Registry, SessionId, SessionOptions};
pub use session::{Driver, Reports, Session};
pub use status::{Phase, SessionStatus, StepTallies, StepTally, StepTimes};
pub use tool_slot::{DriverId, Echo};

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks whatever happened to the last holder: every critical section of this crate leaves its data
/// whole between any two statements that can panic.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
