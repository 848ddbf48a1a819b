//! For simulations by seed: a journal whose threads take turns as a test says.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use kerf_session::Session;
use kerf_session::clock::MonotonicClock;

use super::disk::{Disk, DiskWork, Place};
use super::files::Files;
use super::health::Health;
use super::virtual_disk::VirtualDisk;
use super::writer::{Account, Writer};
use crate::recording::Quota;

/// The journal of a session.
pub struct Journal {
    /// `None` once it has ended.
    writer: Option<Writer>,
    work: Option<DiskWork>,
    /// Images whose way there was written.
    pub written: usize,
    /// How many of them no power cut takes.
    pub confirmed: usize,
    /// What its thread takes for the time.
    pub now_ns: u64,
}

impl Journal {
    /// Begins, or goes on with what is in the folder; so many images are confirmed.
    pub fn begin(folder: &Path, session: &Session, disk: &Arc<VirtualDisk>, confirmed: usize) -> Self {
        let health = Arc::new(Health::default());
        let quota = Arc::new(Quota::of_mib(["journal_dir", "max_journal_mib"], 1000.0));
        let place = Place { storage: Arc::clone(disk) as _, quota, unsynced: health.begin() };
        let (disk, work) = Disk::new(place.clone());
        let before = Files::in_folder(folder).unwrap().remove(&session.id()).unwrap_or_default();
        let is_new = before.is_empty();
        let files = Files { folder: folder.into(), session: session.id(), before };
        let account = Account { health, told: Arc::default() };
        let tape = session.take_journal().unwrap();
        let writer = Writer::begin(files, session, tape, (place, disk), account, &Arc::new(AtomicBool::new(true)));
        // That of a new session begins with a file; others wait for a state to go on from.
        let written = confirmed.max(usize::from(is_new && writer.is_ok()));
        Self { writer: writer.ok(), work: Some(work), written, confirmed, now_ns: MonotonicClock::now_ns() }
    }

    /// Its thread looks at the tape, on which there are so many images.
    pub fn look(&mut self, images: usize) {
        let Some(writer) = &mut self.writer else { return };
        match writer.look(self.now_ns) {
            Ok(None) if writer.is_written() => self.written = images,
            Ok(None) => {}
            Ok(Some(ended)) => self.writer.take().unwrap().end(ended),
            Err(error) => self.writer.take().unwrap().end(Err(error.to_string())),
        }
    }

    /// The thread that waits for the disk does so many of the jobs that wait, at most.
    pub fn sync(&mut self, jobs: usize) {
        for _ in 0..jobs {
            match self.work.as_ref().map(DiskWork::next) {
                Some(Some(true)) => {}
                Some(None) => {
                    self.confirmed = self.written;
                    return;
                }
                Some(Some(false)) => self.work = None,
                None => return,
            }
        }
    }
}

/// Seeds that a simulation tries: as many as the variable `name` says, from the one on that `name` with `_SEED` says.
pub fn seeds(name: &str, otherwise: u64) -> Range<u64> {
    let number = |name: &str, otherwise| std::env::var(name).map_or(otherwise, |value| value.parse().unwrap());
    let first = number(&format!("{name}_SEED"), 0);
    first..first + number(name, otherwise)
}
