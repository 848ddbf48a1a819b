//! Journals: what brings sessions back when the server was killed, or the machine lost power.
//!
//! The journal of a session is a recording without pictures: the scene, a state to go on from, and every input and event
//! since. A thread of its own writes a chunk every 50 ms and lets another one sync it, so that no step waits for a disk.
//! Every second of stepping the session gives it a new state; the journal goes on in a new file then, and the file before
//! is removed once the new one is on the disk. So a session comes back about as fast as its scene is built, however
//! long it has gone on.
//!
//! A session that is closed has no journal any more; one whose server stops, or is stopped, is brought back by the next one.

#[cfg(test)]
pub(crate) mod by_hand;
mod disk;
pub(crate) mod files;
mod health;
mod kept;
#[cfg(test)]
mod lives;
pub mod past;
#[cfg(test)]
pub(crate) mod tests;
#[cfg(test)]
pub(crate) mod virtual_disk;
mod writer;

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use anyhow::{Context, Result, anyhow, ensure};
use futures_util::future::join_all;
use kerf_proto::v1;
use kerf_session::priority::stand_back;
use kerf_session::{Registry, Session, SessionId, SessionOptions, TapeReader};
use tonic::Code;

use crate::config::ServerConfig;
use crate::recording::{Going, Quota, Recordings, Told};
use crate::status::session_code;
use crate::storage::{Storage, SystemDisk};
use disk::{Disk, Place};
use files::Files;
use health::Health;
use kept::Kept;
pub use kept::put_down;
use writer::{Account, Writer};

/// Keeps a second server out of the folder.
const LOCK_FILE: &str = "lock";

/// The journals of a server's sessions.
pub struct Journals {
    /// Nothing is written without.
    folder: Option<Folder>,
    quota: Arc<Quota>,
    /// The server stops, and its sessions with it: they are to come back.
    is_stopping: Arc<AtomicBool>,
    going: Going,
    health: Arc<Health>,
    /// Tests have disks that fail.
    storage: Arc<dyn Storage>,
}

/// The journals that a server left, by session.
#[derive(Default)]
pub struct Left(BTreeMap<SessionId, Vec<PathBuf>>);

impl Left {
    /// Whose they are.
    pub fn ids(&self) -> impl Iterator<Item = SessionId> {
        self.0.keys().copied()
    }
}

/// Whether a session would come back to a server with more room, or to the next one.
fn is_want_of_room(error: &anyhow::Error) -> bool {
    let code = error.downcast_ref().map(session_code);
    matches!(code, Some(Code::ResourceExhausted | Code::Unavailable))
}

struct Folder {
    path: PathBuf,
    /// Locked as long as the server runs.
    _lock: File,
}

impl Folder {
    fn take(path: &Path) -> Result<Self> {
        std::fs::create_dir_all(path)?;
        let lock = File::options().create(true).truncate(false).write(true).open(path.join(LOCK_FILE))?;
        ensure!(lock.try_lock().is_ok(), "it is the folder of another server that runs");
        Ok(Self { path: path.into(), _lock: lock })
    }
}

impl Journals {
    /// None yet.
    ///
    /// # Errors
    /// The folder cannot be made, or is another server's.
    pub fn new(config: &ServerConfig) -> Result<Self> {
        let take = |path: &PathBuf| Folder::take(path).with_context(|| format!("journal_dir = {}", path.display()));
        Ok(Self {
            folder: config.journal_dir.as_ref().map(take).transpose()?,
            quota: Arc::new(Quota::of_mib(["journal_dir", "max_journal_mib"], config.max_journal_mib)),
            is_stopping: Arc::default(),
            going: Going::default(),
            health: Arc::default(),
            storage: Arc::new(SystemDisk),
        })
    }

    /// Whether sessions are to have journals.
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.folder.is_some()
    }

    /// What has become of a session's journal so far; `None` where none is kept.
    #[must_use]
    pub fn so_far(&self, session: SessionId) -> Option<v1::Journal> {
        self.going.so_far(session).map(|told| v1::Journal { error: told.error })
    }

    /// How they are doing.
    #[must_use]
    pub fn health(&self) -> &Health {
        &self.health
    }

    /// Begins the journal of a session that was created to have one. What stands in the way of that is logged, and
    /// returned for the client.
    pub fn begin(&self, session: &Arc<Session>) -> Option<String> {
        self.go_on(session, Vec::new())
    }

    /// The sessions of the server before, which are to be brought back.
    pub fn left(&self) -> Result<Left> {
        let Some(folder) = &self.folder else { return Ok(Left::default()) };
        Files::remove_parts(&folder.path).context("journal_dir")?;
        Ok(Left(Files::in_folder(&folder.path).context("journal_dir")?))
    }

    /// Brings sessions back. What does not come back is logged.
    pub async fn bring_back(&self, left: Left, registry: &Registry, recordings: &Recordings) {
        let begun = Instant::now();
        let sessions = left.0.len();
        join_all(left.0.into_iter().map(|(id, files)| async move {
            let options =
                SessionOptions { is_recorded: recordings.is_on(), is_journaled: true, ..SessionOptions::default() };
            let read = {
                let files = files.clone();
                move || past::read(&files)
            };
            match registry.bring_back::<anyhow::Error>(id, read, options).await {
                Ok(session) => {
                    recordings.begin(&session);
                    self.go_on(&session, files);
                }
                Err(error) => {
                    self.health.not_brought_back.add(1);
                    let newest = files.last().map(|path| path.display().to_string());
                    tracing::error!(session = %id, newest, "the session does not come back: {error:#}");
                    if !is_want_of_room(&error) {
                        self.set_aside(&files);
                    }
                }
            }
        }))
        .await;
        if sessions > 0 {
            let seconds = begun.elapsed().as_secs_f64();
            tracing::info!(sessions, seconds, "the sessions of the server before are back, as far as they come");
        }
    }

    /// Puts away what brings no session back here, so that it takes nothing of the quota.
    fn set_aside(&self, files: &[PathBuf]) {
        let Some(folder) = &self.folder else { return };
        if let Err(error) = Files::set_aside(&folder.path, files, self.quota.max_bytes()) {
            tracing::warn!(?files, %error, "files of a journal that brings no session back stay, and take their part of the quota");
        }
    }

    /// Puts down a session that comes from another server: as the first file of its journal, where one is kept.
    pub fn keep(&self, session: SessionId, file: &[u8]) -> io::Result<Kept> {
        let journals = self.folder.as_ref().map(|folder| (folder.path.as_path(), self.storage.as_ref()));
        Kept::write(journals, session, file)
    }

    /// Goes on with the journal of a session that came from another server.
    pub fn go_on_from(&self, session: &Arc<Session>, kept: Kept) -> Option<String> {
        self.go_on(session, kept.release())
    }

    /// Goes on with the journal of a session, or begins it; files `before` are removed once there is a newer one.
    fn go_on(&self, session: &Arc<Session>, before: Vec<PathBuf>) -> Option<String> {
        let (Some(folder), Some(tape)) = (&self.folder, session.take_journal()) else { return None };
        let told = Arc::new(Told::default());
        let thread = self.start(folder, session, (tape, before), &told).map_err(|error| {
            self.health.not_begun.add(1);
            tracing::error!(session = %session.id(), "the session has no journal: {error:#}");
            told.note(|journal| journal.error = format!("{error:#}"));
            format!("the session has no journal: {error:#}")
        });
        let refused = thread.as_ref().err().cloned();
        self.going.add(session, told, thread.ok());
        refused
    }

    fn start(
        &self,
        folder: &Folder,
        session: &Session,
        (tape, before): (TapeReader, Vec<PathBuf>),
        told: &Arc<Told>,
    ) -> Result<JoinHandle<()>> {
        self.quota.measure(&folder.path)?;
        let files = Files { folder: folder.path.clone(), session: session.id(), before };
        let (storage, quota) = (Arc::clone(&self.storage), Arc::clone(&self.quota));
        let place = Place { storage, quota, unsynced: self.health.begin() };
        let disk = Disk::begin(place.clone()).context("a thread for the disk")?;
        let account = Account { health: Arc::clone(&self.health), told: Arc::clone(told) };
        let writer = Writer::begin(files, session, tape, (place, disk), account, &self.is_stopping)?;
        let run = std::thread::Builder::new().name("kerf-journal".into()).spawn(move || {
            stand_back();
            writer.run();
        });
        run.map_err(|error| anyhow!("no thread for the journal: {error}"))
    }

    /// Waits until the journal of a session that was closed is removed.
    pub async fn finish(&self, session: SessionId) {
        self.going.finish(session).await;
    }

    /// From now on sessions end with the server: their journals stay.
    pub fn stop(&self) {
        self.is_stopping.store(true, Ordering::Release);
    }

    /// Waits until all journals are on the disk; all sessions have ended.
    pub async fn finish_all(&self) {
        self.going.finish_all().await;
    }
}
