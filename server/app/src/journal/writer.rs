//! The thread that writes the journal of a session.

use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Error, Result};
use kerf_proto::v1;
use kerf_proto::v1::view_response::Message;
use kerf_session::clock::MonotonicClock;
use kerf_session::{Base, Session, TapeEntry, TapeReader, TapeState};
use mcap::McapResult;

use super::disk::{Disk, remove};
use super::files::Files;
use crate::convert::scene::scene_summary;
use crate::convert::view;
use crate::recording::tracks::{Track, Tracks};
use crate::recording::writer::{LogClock, base_messages, plain};
use crate::recording::{Quota, Sink, Told, convert};

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
    quota: Arc<Quota>,
    told: Arc<Told>,
    is_stopping: Arc<AtomicBool>,
    clock: LogClock,
    flushed_ns: u64,
}

/// The file that is written to.
struct Going {
    tracks: Tracks<Sink>,
    /// The same, to be synced.
    file: Arc<File>,
}

impl Writer {
    /// Begins the journal of a session at rest; that of one which has files goes on with the next state to go on from.
    pub fn begin(
        files: Files,
        session: &Session,
        tape: TapeReader,
        quota: &Arc<Quota>,
        told: &Arc<Told>,
        is_stopping: &Arc<AtomicBool>,
    ) -> Result<Self> {
        let mut writer = Self {
            header: convert::header(session, scene_summary(session))?,
            file: None,
            tape,
            disk: Disk::new(Arc::clone(quota)).context("a thread for the disk")?,
            quota: Arc::clone(quota),
            told: Arc::clone(told),
            is_stopping: Arc::clone(is_stopping),
            clock: LogClock::now()?,
            flushed_ns: MonotonicClock::now_ns(),
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
                self.files.before.iter().for_each(|path| remove(path, &self.quota))
            }
            Ok(()) => tracing::info!(%session, "the journal of the session stays, for the next server"),
            Err(error) => {
                tracing::error!(%session, "the journal has ended before its session, which would come back as it was then: {error}");
                self.told.note(|journal| (journal.is_cut_off, journal.error) = (true, error));
            }
        }
    }

    /// Writes what has come since the last look. The outcome, once there is one: the session has ended, or why the
    /// journal does before it.
    fn look(&mut self) -> McapResult<Option<Result<(), String>>> {
        let (entries, state) = self.tape.take();
        for entry in &entries {
            self.write(entry)?;
        }
        let now_ns = MonotonicClock::now_ns();
        if state != TapeState::Running || now_ns - self.flushed_ns >= FLUSH_NS {
            self.flushed_ns = now_ns;
            if let Some(Going { tracks, file }) = &mut self.file {
                tracks.flush()?;
                self.disk.sync(file);
            }
            if let Some(failure) = self.disk.failure() {
                return Ok(Some(Err(failure)));
            }
            if let (TapeState::Running, Err(full)) = (state, self.quota.check()) {
                return Ok(Some(Err(full)));
            }
        }
        Ok(match state {
            TapeState::Running => None,
            TapeState::Ended => Some(Ok(())),
            TapeState::Overrun { capacity } => Some(Err(format!(
                "the disk is slower than the session: {capacity} steps and events waited to be written"
            ))),
        })
    }

    fn write(&mut self, entry: &TapeEntry) -> McapResult<()> {
        if let TapeEntry::Base(base) = entry {
            return self.begin_file(Some(base));
        }
        let Some(Going { tracks, .. }) = &mut self.file else { return Ok(()) };
        let now_ns = self.clock.unix_ns(MonotonicClock::now_ns());
        match entry {
            TapeEntry::Step(taped) => tracks.write(Track::Step, now_ns, &convert::step(taped)),
            TapeEntry::Checkpoint(name, file) => {
                tracks.write(Track::Checkpoint, now_ns, &convert::checkpoint(name, file))
            }
            TapeEntry::Event(happened) => match view::event(happened) {
                Message::Event(event) => tracks.write(Track::Events, now_ns, &event),
                Message::Fault(fault) => tracks.write(Track::Faults, now_ns, &fault),
                _ => Ok(()),
            },
            TapeEntry::Base(_) => Ok(()),
        }
    }

    /// Goes on in a new file, which begins with a state to go on from, or with the scene at rest.
    fn begin_file(&mut self, base: Option<&Base>) -> McapResult<()> {
        if let Some(Going { mut tracks, .. }) = self.file.take() {
            tracks.flush()?;
            tracks.abandon();
        }
        let path = self.files.next();
        let file = File::create_new(&path)?;
        let same = Arc::new(file.try_clone()?);
        let before = std::mem::replace(&mut self.files.before, vec![path]);
        let mut tracks = Tracks::begin(Sink::new(file, Arc::clone(&self.quota)), TRACKS)?;
        let time_ns = self.clock.unix_ns(MonotonicClock::now_ns());
        let written = tracks.write(Track::Header, time_ns, &self.header);
        let written = written.and_then(|()| base.map_or(Ok(()), |base| base_messages(&mut tracks, time_ns, base)));
        if let Err(error) = written.and_then(|()| tracks.flush()) {
            tracks.abandon();
            return Err(error);
        }
        self.disk.replace(&same, self.files.folder.clone(), before);
        self.file = Some(Going { tracks, file: same });
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
