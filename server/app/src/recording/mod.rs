//! Recordings: a session in an MCAP file, from its creation to its end. `proto/kerf/v1/recording.proto` says what is in it.
//!
//! A thread of its own takes what the session has put on its tape, looks on as a viewer, and writes a chunk at least every
//! half second. So a process that is killed loses that much, and a disk that is slow or full costs the record alone: what
//! ends a recording early is logged and told with the session's description at once.

pub mod convert;
mod footage;
mod going;
mod quota;
pub mod reader;
mod schemas;
mod surface;
pub(crate) mod tape;
pub(crate) mod tracks;
pub mod verify;
pub mod writer;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::SystemTime;

use anyhow::{Context, Result, anyhow};
use kerf_proto::v1;
use kerf_session::priority::stand_back;
use kerf_session::{Reel, Session, SessionId};

pub use footage::FileFootage;
pub use going::Going;
pub use quota::{Quota, Sink};
pub use writer::Writer;

use crate::config::ServerConfig;
use crate::convert::scene::scene_summary;

/// The recordings of a server's sessions.
pub struct Recordings {
    /// Where they are kept; nothing is recorded without.
    folder: Option<PathBuf>,
    quota: Arc<Quota>,
    pictures: Pictures,
    going: Going,
}

/// What is recorded for the eye.
#[derive(Clone, Copy, Debug)]
pub struct Pictures {
    /// States a second, Hz.
    pub rate_hz: f64,
    /// Surfaces are recorded too, as a scene that viewers of MCAP files know.
    pub with_surface: bool,
}

/// What has become of a recording.
#[derive(Debug, Default)]
pub struct Told(Mutex<v1::Recording>);

impl Told {
    /// What has become of it so far.
    #[must_use]
    pub fn so_far(&self) -> v1::Recording {
        self.lock().clone()
    }

    /// Changes it.
    pub fn note(&self, change: impl FnOnce(&mut v1::Recording)) {
        change(&mut self.lock());
    }

    fn lock(&self) -> MutexGuard<'_, v1::Recording> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Recordings {
    /// None yet.
    #[must_use]
    pub fn new(config: &ServerConfig) -> Self {
        Self {
            folder: config.record_dir.clone(),
            quota: Arc::new(Quota::of_mib(["record_dir", "max_record_mib"], config.max_record_mib)),
            pictures: Pictures { rate_hz: config.record_rate_hz, with_surface: config.record_surface },
            going: Going::default(),
        }
    }

    /// Whether sessions are to be recorded.
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.folder.is_some()
    }

    /// Begins to record a session that was created to be; what stands in the way of that is logged and told.
    pub fn begin(&self, session: &Arc<Session>) {
        let (Some(folder), Some(reel)) = (&self.folder, session.take_reel()) else { return };
        let told = Arc::new(Told::default());
        let thread = self.start(folder, session, reel, &told).map_err(|error| {
            tracing::error!(session = %session.id(), "the session is not recorded: {error:#}");
            told.note(|recording| recording.error = format!("{error:#}"));
        });
        self.going.add(session, told, thread.ok());
    }

    fn start(&self, folder: &Path, session: &Session, reel: Reel, told: &Arc<Told>) -> Result<JoinHandle<()>> {
        self.quota.measure(folder)?;
        let began_ms = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.as_millis();
        let name = format!("{}-{began_ms}.mcap", session.id());
        let path = folder.join(&name);
        let file = File::create_new(&path).with_context(|| path.display().to_string())?;
        let header = convert::header(session, scene_summary(session))?;
        let (sink, quota) = (Sink::new(Arc::new(file), Arc::clone(&self.quota)), Arc::clone(&self.quota));
        let room = move || quota.check();
        let begun = Writer::begin(sink, &header, reel, self.pictures, Arc::clone(told), room);
        let writer = begun.inspect_err(|_| drop(std::fs::remove_file(&path)))?;
        told.note(|recording| recording.file = name);
        let run = std::thread::Builder::new().name("kerf-recorder".into()).spawn(move || {
            stand_back();
            writer.run();
        });
        run.map_err(|error| anyhow!("no thread for the recording: {error}"))
    }

    /// What has become of a session's recording so far; `None` where none is made.
    #[must_use]
    pub fn so_far(&self, session: SessionId) -> Option<v1::Recording> {
        self.going.so_far(session)
    }

    /// Waits until a session that has ended is written out, and says what became of it.
    pub async fn finish(&self, session: SessionId) -> Option<v1::Recording> {
        self.going.finish(session).await
    }

    /// Waits until all sessions are written out; all have ended.
    pub async fn finish_all(&self) {
        self.going.finish_all().await;
    }
}
