//! What waits for the disk, so that nothing else does.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use super::health::Unsynced;
use crate::recording::Quota;
use crate::storage::{Storage, Stored};

/// A file of a journal.
#[derive(Debug)]
pub struct JournalFile {
    file: Arc<dyn Stored>,
    written_bytes: AtomicU64,
    confirmed_bytes: AtomicU64,
}

impl JournalFile {
    /// A new one.
    pub fn new(file: Arc<dyn Stored>) -> Self {
        Self { file, written_bytes: AtomicU64::new(0), confirmed_bytes: AtomicU64::new(0) }
    }

    /// Bytes that were written to it.
    pub fn written_bytes(&self) -> u64 {
        self.written_bytes.load(Ordering::Acquire)
    }

    /// How many of them the disk has confirmed.
    pub fn confirmed_bytes(&self) -> u64 {
        self.confirmed_bytes.load(Ordering::Acquire)
    }
}

impl Stored for JournalFile {
    fn append(&self, bytes: &[u8]) -> io::Result<()> {
        self.file.append(bytes)?;
        self.written_bytes.fetch_add(bytes.len() as u64, Ordering::Release);
        Ok(())
    }

    fn sync(&self) -> io::Result<()> {
        let written_bytes = self.written_bytes();
        self.file.sync()?;
        self.confirmed_bytes.store(written_bytes, Ordering::Release);
        Ok(())
    }
}

/// Syncs the files of a journal, in order, and removes those that newer ones stand in for.
pub struct Disk {
    jobs: Option<Sender<Job>>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    /// A sync waits for its turn: what is written until then goes with it.
    is_asked: AtomicBool,
    /// Why what was written may not be on the disk.
    failure: Mutex<Option<String>>,
}

enum Job {
    /// What was written to the file is to be on the disk.
    Sync(Arc<JournalFile>),
    /// The file is new, and complete enough to stand in for those before.
    Replace { file: Arc<JournalFile>, folder: PathBuf, before: Vec<PathBuf> },
}

/// Where a journal is written.
#[derive(Clone)]
pub struct Place {
    pub storage: Arc<dyn Storage>,
    /// What it takes, and what it frees by removing files.
    pub quota: Arc<Quota>,
    /// What the disk has yet to confirm.
    pub unsynced: Arc<Unsynced>,
}

impl Place {
    /// Removes a file, and frees its part of the quota.
    pub fn remove(&self, path: &Path) {
        let bytes = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
        match self.storage.remove(path) {
            Ok(()) => self.quota.free(bytes),
            Err(error) => tracing::warn!(path = %path.display(), %error, "an old file of a journal stays"),
        }
    }
}

impl Disk {
    /// A disk, and what is to be done for it.
    pub fn new(place: Place) -> (Self, DiskWork) {
        let (jobs, waiting) = channel();
        let shared = Arc::new(Shared::default());
        let disk = Self { jobs: Some(jobs), shared: Arc::clone(&shared), thread: None };
        (disk, DiskWork { jobs: waiting, shared, place })
    }

    /// A disk whose work a thread of its own does.
    pub fn begin(place: Place) -> io::Result<Self> {
        let (mut disk, work) = Self::new(place);
        disk.thread = Some(std::thread::Builder::new().name("kerf-disk".into()).spawn(move || work.run())?);
        Ok(disk)
    }

    /// Syncs a file soon.
    pub fn sync(&self, file: &Arc<JournalFile>) {
        if !self.shared.is_asked.swap(true, Ordering::AcqRel) {
            self.send(Job::Sync(Arc::clone(file)));
        }
    }

    /// Syncs a new file and its name, and removes those before.
    pub fn replace(&self, file: &Arc<JournalFile>, folder: PathBuf, before: Vec<PathBuf>) {
        self.send(Job::Replace { file: Arc::clone(file), folder, before });
    }

    fn send(&self, job: Job) {
        // Without the thread there is a failure, which says so.
        let _ = self.jobs.as_ref().map(|jobs| jobs.send(job));
    }

    /// Why what was written may not be on the disk. Nothing is tried again: what the system has dropped of a file it
    /// reports once.
    pub fn failure(&self) -> Option<String> {
        self.shared.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits until all that was asked for is done.
    pub fn finish(&mut self) {
        drop(self.jobs.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        self.finish();
    }
}

/// What is to be done for a disk.
pub struct DiskWork {
    jobs: Receiver<Job>,
    shared: Arc<Shared>,
    place: Place,
}

impl DiskWork {
    /// Does all that comes, until something fails.
    fn run(self) {
        while let Ok(job) = self.jobs.recv() {
            if !self.does(job) {
                return;
            }
        }
    }

    /// Does the next job, if there is one: whether it is done.
    #[cfg(test)]
    pub fn next(&self) -> Option<bool> {
        self.jobs.try_recv().ok().map(|job| self.does(job))
    }

    /// Whether a job is done. Why not is the disk's failure.
    fn does(&self, job: Job) -> bool {
        let Place { storage, unsynced, .. } = &self.place;
        let done = match job {
            Job::Sync(file) => {
                self.shared.is_asked.store(false, Ordering::Release);
                unsynced.sync_begins();
                file.sync()
            }
            Job::Replace { file, folder, before } => {
                unsynced.sync_begins();
                let on_disk = file.sync().and_then(|()| storage.sync_names(&folder));
                on_disk.map(|()| before.iter().for_each(|path| self.place.remove(path)))
            }
        };
        match done {
            Ok(()) => unsynced.synced(),
            Err(error) => {
                let mut failure = self.shared.failure.lock().unwrap_or_else(PoisonError::into_inner);
                failure.get_or_insert_with(|| format!("what was written may not be on the disk: {error}"));
                return false;
            }
        }
        true
    }
}
