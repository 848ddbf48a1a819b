//! The thread that writes the journal of a session.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Error, Result};
use kerf_proto::v1;
use kerf_session::clock::MonotonicClock;
use kerf_session::{Session, TapeEntry, TapeReader, TapeState};
use mcap::McapResult;

use super::disk::{Disk, JournalFile, Place};
use super::files::Files;
use super::health::Health;
use crate::convert::scene::scene_summary;
use crate::recording::tape::{self, plain};
use crate::recording::tracks::{Track, Tracks};
use crate::recording::writer::LogClock;
use crate::recording::{Sink, Told, convert};
use crate::storage::{Stored, create_begun};

/// How often the tape is looked at.
const LOOK: Duration = Duration::from_millis(8);
/// A chunk is written out at least this often, ns: with a look, what a kill loses.
const FLUSH_NS: u64 = 50_000_000;
const TRACKS: [Track; 7] =
    [Track::Header, Track::Base, Track::Step, Track::Events, Track::Faults, Track::Checkpoint, Track::Confirmed];

/// A journal that goes on.
pub struct Writer {
    files: Files,
    header: v1::RecordingHeader,
    /// `None` until there is a state to go on from.
    file: Option<Going>,
    tape: TapeReader,
    place: Place,
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
    file: Arc<JournalFile>,
    /// Up to the last entry.
    entries_bytes: u64,
    /// What the disk had confirmed, as the file itself says.
    said_bytes: u64,
}

impl Going {
    /// Writes what came out; tells how much that is.
    fn flush(&mut self, time_ns: u64) -> McapResult<u64> {
        let before = self.file.written_bytes();
        let confirmed = v1::RecordedConfirmed { bytes: self.file.confirmed_bytes() };
        self.tracks.write(Track::Confirmed, time_ns, &confirmed)?;
        self.tracks.flush()?;
        self.said_bytes = confirmed.bytes;
        Ok(self.file.written_bytes() - before)
    }

    /// The same for entries.
    fn flush_entries(&mut self, time_ns: u64) -> McapResult<u64> {
        let written = self.flush(time_ns)?;
        self.entries_bytes = self.file.written_bytes();
        Ok(written)
    }

    /// The disk has confirmed all entries, and the file does not say so yet: damage to the last of them would pass for one
    /// that was never written.
    fn is_unsaid(&self) -> bool {
        self.said_bytes < self.entries_bytes && self.entries_bytes <= self.file.confirmed_bytes()
    }
}

impl Writer {
    /// Begins the journal of a session at rest; that of one which has files goes on with the next state to go on from.
    pub fn begin(
        files: Files,
        session: &Session,
        tape: TapeReader,
        (place, disk): (Place, Disk),
        account: Account,
        is_stopping: &Arc<AtomicBool>,
    ) -> Result<Self> {
        let now_ns = MonotonicClock::now_ns();
        let mut writer = Self {
            header: convert::header(session, scene_summary(session))?,
            file: None,
            tape,
            place,
            disk,
            account,
            is_stopping: Arc::clone(is_stopping),
            clock: LogClock::now()?,
            flushed_ns: now_ns,
            is_unsynced: false,
            files,
        };
        if writer.files.before.is_empty() {
            writer.begin_file(None, now_ns).map_err(|error| Error::msg(plain(&error)))?;
        }
        Ok(writer)
    }

    /// Writes until the session ends or the journal does.
    pub fn run(mut self) {
        let ended = loop {
            match self.look(MonotonicClock::now_ns()) {
                Ok(None) => std::thread::sleep(LOOK),
                Ok(Some(ended)) => break ended,
                Err(error) => break Err(plain(&error)),
            }
        };
        self.end(ended);
    }

    /// Ends the journal: a session that has ended has none any more, unless its server stops.
    pub(super) fn end(mut self, ended: Result<(), String>) {
        let session = self.files.session;
        match ended {
            Ok(()) if !self.is_stopping.load(Ordering::Acquire) => {
                self.files.before.iter().for_each(|path| self.place.remove(path));
                // Else a power cut would bring it back.
                let _ = self.place.storage.sync_names(&self.files.folder);
            }
            Ok(()) => match self.say_confirmed() {
                Ok(()) => tracing::info!(%session, "the journal of the session stays, for the next server"),
                Err(error) => {
                    tracing::warn!(%session, "the journal of the session stays, but its end: {}", plain(&error))
                }
            },
            Err(error) => {
                self.account.health.broken_off.add(1);
                self.account.told.note(|journal| journal.error.clone_from(&error));
                tracing::error!(%session, "the journal has ended before its session, which would come back as it was then: {error}");
            }
        }
    }

    /// Waits for the disk, and lets the file say what it has confirmed.
    fn say_confirmed(&mut self) -> McapResult<()> {
        self.disk.finish();
        if let Some(going) = self.file.as_mut().filter(|going| going.is_unsaid()) {
            going.flush(self.clock.unix_ns(MonotonicClock::now_ns()))?;
            going.file.sync()?;
        }
        Ok(())
    }

    /// Writes what has come since the last look. The outcome, once there is one: the session has ended, or why the
    /// journal does before it.
    pub(super) fn look(&mut self, now_ns: u64) -> McapResult<Option<Result<(), String>>> {
        let (entries, state) = self.tape.take();
        self.is_unsynced |= !entries.is_empty();
        if self.file.is_some() && !entries.is_empty() {
            self.place.unsynced.came(now_ns);
        }
        entries.iter().try_for_each(|entry| self.write(entry, now_ns))?;
        if state != TapeState::Running || now_ns - self.flushed_ns >= FLUSH_NS {
            self.flushed_ns = now_ns;
            let is_unsynced = std::mem::take(&mut self.is_unsynced);
            if let Some(going) = &mut self.file {
                let time_ns = self.clock.unix_ns(now_ns);
                let written = match is_unsynced {
                    true => Some(going.flush_entries(time_ns)?),
                    false if going.is_unsaid() => Some(going.flush(time_ns)?),
                    false => None,
                };
                if let Some(written) = written {
                    self.place.unsynced.written(written);
                    self.disk.sync(&going.file);
                }
            }
            if let Some(failure) = self.disk.failure() {
                return Ok(Some(Err(failure)));
            }
            if let (TapeState::Running, Err(full)) = (state, self.place.quota.check()) {
                return Ok(Some(Err(full)));
            }
        }
        Ok(tape::ended(state))
    }

    /// Whether all that it has read was written out.
    #[cfg(test)]
    pub(super) fn is_written(&self) -> bool {
        self.file.is_some() && !self.is_unsynced
    }

    /// A state to go on from begins a new file.
    fn write(&mut self, entry: &TapeEntry, now_ns: u64) -> McapResult<()> {
        if let TapeEntry::Base(_) = entry {
            return self.begin_file(Some(entry), now_ns);
        }
        let Some(Going { tracks, .. }) = &mut self.file else { return Ok(()) };
        tape::write(tracks, self.clock.unix_ns(now_ns), entry)
    }

    /// Goes on in a new file, which begins with a state to go on from, or with the scene at rest.
    fn begin_file(&mut self, base: Option<&TapeEntry>, now_ns: u64) -> McapResult<()> {
        let time_ns = self.clock.unix_ns(now_ns);
        if let Some(mut going) = self.file.take() {
            self.place.unsynced.written(going.flush_entries(time_ns)?);
            going.tracks.abandon();
        }
        let path = self.files.next();
        let (tracks, file) = create_begun(self.place.storage.as_ref(), &path, |file| {
            let file = Arc::new(JournalFile::new(file));
            let sink = Sink::new(Arc::clone(&file) as _, Arc::clone(&self.place.quota));
            let tracks = Tracks::begin(sink, TRACKS, |tracks| {
                tracks.write(Track::Header, time_ns, &self.header)?;
                base.map_or(Ok(()), |base| tape::write(tracks, time_ns, base))
            })?;
            McapResult::Ok((tracks, file))
        })?;
        let before = std::mem::replace(&mut self.files.before, vec![path]);
        self.place.unsynced.written(file.written_bytes());
        self.disk.replace(&file, self.files.folder.clone(), before);
        let entries_bytes = file.written_bytes();
        self.file = Some(Going { tracks, file, entries_bytes, said_bytes: 0 });
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
