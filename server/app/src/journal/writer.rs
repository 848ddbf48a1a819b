//! The thread that writes the journal of a session.

use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Error, Result};
use kerf_proto::v1;
use kerf_session::clock::MonotonicClock;
use kerf_session::{Session, TapeEntry, TapeReader, TapeState};
use mcap::McapResult;

use super::disk::{Disk, remove};
use super::files::Files;
use super::health::Health;
use crate::convert::scene::scene_summary;
use crate::recording::tape::{self, plain};
use crate::recording::tracks::{Track, Tracks};
use crate::recording::writer::LogClock;
use crate::recording::{Sink, Told, convert};

/// How often the tape is looked at.
const LOOK: Duration = Duration::from_millis(8);
/// A chunk is written out at least this often, ns: with a look, what a kill loses.
const FLUSH_NS: u64 = 50_000_000;
const TRACKS: [Track; 6] = [Track::Header, Track::Base, Track::Step, Track::Events, Track::Faults, Track::Checkpoint];

/// A journal that goes on.
pub struct Writer {
    files: Files,
    header: v1::RecordingHeader,
    /// `None` until there is a state to go on from.
    file: Option<Going>,
    tape: TapeReader,
    disk: Disk,
    account: Account,
    is_stopping: Arc<AtomicBool>,
    clock: LogClock,
    flushed_ns: u64,
    /// Something was written since: a session that stands asks nothing of the disk.
    is_unsynced: bool,
}

/// Where it is told what becomes of the journal.
pub struct Account {
    /// Of all journals.
    pub health: Arc<Health>,
    /// Of this one.
    pub told: Arc<Told>,
}

/// The file that is written to.
struct Going {
    tracks: Tracks<Sink>,
    /// The same, to be synced.
    file: Arc<File>,
    /// What of it was written.
    bytes: u64,
}

impl Going {
    /// Writes what came out; tells how much that is.
    fn flush(&mut self) -> McapResult<u64> {
        self.tracks.flush()?;
        let before = std::mem::replace(&mut self.bytes, self.file.metadata()?.len());
        Ok(self.bytes - before)
    }
}

impl Writer {
    /// Begins the journal of a session at rest; that of one which has files goes on with the next state to go on from.
    pub fn begin(
        files: Files,
        session: &Session,
        tape: TapeReader,
        disk: Disk,
        account: Account,
        is_stopping: &Arc<AtomicBool>,
    ) -> Result<Self> {
        let mut writer = Self {
            header: convert::header(session, scene_summary(session))?,
            file: None,
            tape,
            disk,
            account,
            is_stopping: Arc::clone(is_stopping),
            clock: LogClock::now()?,
            flushed_ns: MonotonicClock::now_ns(),
            is_unsynced: false,
            files,
        };
        if writer.files.before.is_empty() {
            writer.begin_file(None).map_err(|error| Error::msg(plain(&error)))?;
        }
        Ok(writer)
    }

    /// Writes until the session ends or the journal does.
    pub fn run(mut self) {
        let session = self.files.session;
        let ended = loop {
            match self.look() {
                Ok(None) => std::thread::sleep(LOOK),
                Ok(Some(ended)) => break ended,
                Err(error) => break Err(plain(&error)),
            }
        };
        match ended {
            Ok(()) if !self.is_stopping.load(Ordering::Acquire) => {
                self.files.before.iter().for_each(|path| remove(path, &self.disk.quota))
            }
            Ok(()) => tracing::info!(%session, "the journal of the session stays, for the next server"),
            Err(error) => {
                self.account.health.broken_off.add(1);
                self.account.told.note(|journal| journal.error.clone_from(&error));
                tracing::error!(%session, "the journal has ended before its session, which would come back as it was then: {error}");
            }
        }
    }

    /// Writes what has come since the last look. The outcome, once there is one: the session has ended, or why the
    /// journal does before it.
    fn look(&mut self) -> McapResult<Option<Result<(), String>>> {
        let (entries, state) = self.tape.take();
        self.is_unsynced |= !entries.is_empty();
        let now_ns = MonotonicClock::now_ns();
        if self.file.is_some() && !entries.is_empty() {
            self.disk.unsynced.came(now_ns);
        }
        entries.iter().try_for_each(|entry| self.write(entry))?;
        if state != TapeState::Running || now_ns - self.flushed_ns >= FLUSH_NS {
            self.flushed_ns = now_ns;
            let is_unsynced = std::mem::take(&mut self.is_unsynced);
            if let Some(going) = self.file.as_mut().filter(|_| is_unsynced) {
                self.disk.unsynced.written(going.flush()?);
                self.disk.sync(&going.file);
            }
            if let Some(failure) = self.disk.failure() {
                return Ok(Some(Err(failure)));
            }
            if let (TapeState::Running, Err(full)) = (state, self.disk.quota.check()) {
                return Ok(Some(Err(full)));
            }
        }
        Ok(tape::ended(state))
    }

    /// A state to go on from begins a new file.
    fn write(&mut self, entry: &TapeEntry) -> McapResult<()> {
        if let TapeEntry::Base(_) = entry {
            return self.begin_file(Some(entry));
        }
        let Some(Going { tracks, .. }) = &mut self.file else { return Ok(()) };
        tape::write(tracks, self.clock.unix_ns(MonotonicClock::now_ns()), entry)
    }

    /// Goes on in a new file, which begins with a state to go on from, or with the scene at rest.
    fn begin_file(&mut self, base: Option<&TapeEntry>) -> McapResult<()> {
        if let Some(mut going) = self.file.take() {
            self.disk.unsynced.written(going.flush()?);
            going.tracks.abandon();
        }
        let path = self.files.next();
        let file = File::create_new(&path)?;
        let same = Arc::new(file.try_clone()?);
        let before = std::mem::replace(&mut self.files.before, vec![path]);
        let time_ns = self.clock.unix_ns(MonotonicClock::now_ns());
        let tracks = Tracks::begin(Sink::new(file, Arc::clone(&self.disk.quota)), TRACKS, |tracks| {
            tracks.write(Track::Header, time_ns, &self.header)?;
            base.map_or(Ok(()), |base| tape::write(tracks, time_ns, base))
        })?;
        let mut going = Going { tracks, file: same, bytes: 0 };
        self.disk.unsynced.written(going.flush()?);
        self.disk.replace(&going.file, self.files.folder.clone(), before);
        self.file = Some(going);
        Ok(())
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // Ended by its library, a file would get an index, as if its session had come to its end.
        if let Some(Going { tracks, .. }) = self.file.take() {
            tracks.abandon();
        }
    }
}
