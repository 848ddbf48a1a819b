//! What a session refuses, and why.

use kerf_physics::SceneProblems;

use kerf_scenes::dial::DialError;

use crate::limits::setting;
use crate::pose_refusal::PoseRefusal;

/// A request that a session or the registry could not serve.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum SessionError {
    /// The server holds as many sessions as it may.
    #[error("the server runs {limit} sessions, as many as it may ({})", setting!(max_sessions))]
    TooManySessions {
        /// `session.max_sessions`.
        limit: usize,
    },
    /// The scene, or a checkpoint, needs more memory than is left.
    #[error(
        "memory: about {needed_mib} MiB are needed, and of the {limit_mib} MiB that sessions may take together \
         {taken_mib} are taken ({})",
        setting!(max_memory_mib)
    )]
    Memory {
        /// What it needs, as it is estimated.
        needed_mib: u64,
        /// What others have.
        taken_mib: u64,
        /// `session.max_memory_mib`.
        limit_mib: u64,
    },
    /// What a journal says of a session does not lead to where it stood.
    #[error("the session cannot be brought back: {message}")]
    Unrecoverable {
        /// Why not.
        message: String,
    },
    /// The scene needs more time of the cores than is left.
    #[error(
        "load: steps of the scene keep about {needed:.2} cores busy, and of the {limit:.2} that sessions may keep busy \
         together {taken:.2} are taken ({}): {measured:.2} by steps of the last second, the others for sessions that \
         may begin to cut; lower the step rate or raise the level, or let the client take the steps: a \
         session that is made paused and stepped takes none",
        setting!(max_load)
    )]
    Load {
        /// What it needs, as it is estimated.
        needed: f64,
        /// What others need, at least what they are told to need.
        taken: f64,
        /// What their steps took in the last second.
        measured: f64,
        /// `session.max_load`.
        limit: f64,
    },
    /// The scene takes too long to be built.
    #[error(
        "set-up: the scene takes about {needed_s:.0} s to be built, at most {limit_s:.0} s ({})",
        setting!(max_setup_s)
    )]
    SetupTime {
        /// What it takes, as it is estimated, s.
        needed_s: f64,
        /// `session.max_setup_s`.
        limit_s: f64,
    },
    /// The session has as many drivers as it may.
    #[error("the session has {limit} drivers, as many as it may ({})", setting!(max_drivers))]
    TooManyDrivers {
        /// `session.max_drivers`.
        limit: usize,
    },
    /// The session has as many viewers as it may.
    #[error("the session has {limit} viewers, as many as it may ({})", setting!(max_viewers))]
    TooManyViewers {
        /// `session.max_viewers`.
        limit: usize,
    },
    /// The command queue is full.
    #[error("{limit} commands wait for the session's next tick, as many as may ({})", setting!(max_commands))]
    TooManyCommands {
        /// `session.max_commands`.
        limit: usize,
    },
    /// The session keeps as many checkpoints as it may.
    #[error(
        "the session keeps {limit} checkpoints, as many as it may ({}); delete one, or save over one",
        setting!(max_checkpoints)
    )]
    TooManyCheckpoints {
        /// `session.max_checkpoints`.
        limit: usize,
    },
    /// A name that no checkpoint may have.
    #[error("name: {name:?} is not a checkpoint's name of 1 to {limit} bytes of printable characters")]
    PointName {
        /// The name, shortened.
        name: String,
        /// [`crate::MAX_CHECKPOINT_NAME_BYTES`].
        limit: usize,
    },
    /// The session has no point of this name.
    #[error("name: the session has no checkpoint {name:?}")]
    NoCheckpoint {
        /// The name asked for.
        name: String,
    },
    /// No session has this id.
    #[error("no session {id}")]
    NoSession {
        /// The id asked for.
        id: String,
    },
    /// The session goes on elsewhere.
    #[error("session {id} has moved to {to}")]
    Moved {
        /// The id asked for.
        id: String,
        /// The address of its server.
        to: String,
    },
    /// Its journal is bringing the session back.
    #[error("session {id} is coming back: the server was restarted; ask again in a moment")]
    ComesBack {
        /// The id asked for.
        id: String,
    },
    /// The session is on its way to another server.
    #[error("the session is moving to another server: ask again when it has moved, or has not")]
    Leaving,
    /// A session of this id is here.
    #[error("session_id: session {id} is here already")]
    Here {
        /// Its id.
        id: String,
    },
    /// The scene asks for a step rate that the server does not grant.
    #[error("rate_hz = {rate_hz}: must be 1 to {limit_hz} ({})", setting!(max_rate_hz))]
    Rate {
        /// The scene's rate, Hz.
        rate_hz: f64,
        /// `session.max_rate_hz`.
        limit_hz: f64,
    },
    /// The scene has no such tool.
    #[error("tool {tool}: the scene has {tools} tools")]
    NoTool {
        /// The index asked for.
        tool: usize,
        /// Tools of the scene.
        tools: usize,
    },
    /// Another driver holds the tool.
    #[error("tool {tool} is driven by another client; its lease ends {lease_s} s after that client's last pose")]
    ToolTaken {
        /// The tool asked for.
        tool: usize,
        /// `session.lease_s`.
        lease_s: f64,
    },
    /// The session is a recording that is played.
    #[error(
        "the session is a recording that is played: it can be viewed, paused, stepped and sought, not driven or changed"
    )]
    IsReplay,
    /// The session is no recording.
    #[error("the session is simulated: only a recording that is played goes to another time")]
    NotReplay,
    /// A tool may not do in a step what the call for it says.
    #[error("{path}: {limit}")]
    Input {
        /// Path of the field, as on the wire.
        path: String,
        /// The limit that it broke, for people.
        limit: String,
    },
    /// The session was told something else while it took the steps of a call.
    #[error("a pause, a resume, a reset or a way back ended the steps; {taken} of them were taken before")]
    StepsEnded {
        /// Steps of the call that were taken.
        taken: usize,
    },
    /// The session is closed or closing.
    #[error("the session is closed")]
    Closed,
    /// The server takes no new sessions because it is going down.
    #[error(
        "the server is stopping and takes no new sessions; those that run have {limit_s} s to end ({})",
        setting!(drain_s)
    )]
    Draining {
        /// `session.drain_s`.
        limit_s: f64,
    },
    /// A step panicked; the session waits for a reset or its end.
    #[error("the session failed and waits for a reset: {message}")]
    Failed {
        /// What the panic said.
        message: String,
    },
    /// The scene cannot be simulated.
    #[error(transparent)]
    Scene(#[from] SceneProblems),
    /// The dial cannot be set as asked.
    #[error(transparent)]
    Dial(#[from] DialError),
    /// The operating system refused a thread.
    #[error("no thread for the session: {message}")]
    NoThread {
        /// What the operating system said.
        message: String,
    },
}

impl SessionError {
    /// The setting that was in the way, by the name that `--set` takes.
    #[must_use]
    pub fn setting(&self) -> Option<&'static str> {
        Some(match self {
            Self::TooManySessions { .. } => setting!(max_sessions),
            Self::Memory { .. } => setting!(max_memory_mib),
            Self::Load { .. } => setting!(max_load),
            Self::SetupTime { .. } => setting!(max_setup_s),
            Self::TooManyDrivers { .. } => setting!(max_drivers),
            Self::TooManyViewers { .. } => setting!(max_viewers),
            Self::TooManyCommands { .. } => setting!(max_commands),
            Self::TooManyCheckpoints { .. } => setting!(max_checkpoints),
            _ => return None,
        })
    }

    /// Motion `place` of input `index` was refused.
    pub(crate) fn refused_input(index: usize, place: usize, is_pose: bool, refusal: &PoseRefusal) -> Self {
        let motion = if is_pose { "pose" } else { "lift" };
        let path = format!("inputs[{index}].motions[{place}].{motion}.{}", refusal.field());
        Self::Input { path, limit: refusal.limit() }
    }
}
