//! The thread that waits for the disk.

use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use super::Sync;
use super::health::Unsynced;
use crate::recording::Quota;

/// Syncs the files of a journal, in order, and removes those that newer ones stand in for.
pub struct Disk {
    jobs: Option<Sender<Job>>,
    shared: Arc<Shared>,
    /// What it frees by removing files.
    pub quota: Arc<Quota>,
    /// What it has yet to confirm.
    pub unsynced: Arc<Unsynced>,
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
    Sync(Arc<File>),
    /// The file is new, and complete enough to stand in for those before.
    Replace { file: Arc<File>, folder: PathBuf, before: Vec<PathBuf> },
}

impl Disk {
    /// A disk that frees what it removes.
    pub fn new(quota: Arc<Quota>, unsynced: Arc<Unsynced>, sync: Sync) -> io::Result<Self> {
        let (jobs, waiting) = channel();
        let shared = Arc::new(Shared::default());
        let thread = {
            let (shared, quota, unsynced) = (Arc::clone(&shared), Arc::clone(&quota), Arc::clone(&unsynced));
            std::thread::Builder::new()
                .name("kerf-disk".into())
                .spawn(move || work(&waiting, &shared, (&quota, &unsynced), sync))?
        };
        Ok(Self { jobs: Some(jobs), shared, quota, unsynced, thread: Some(thread) })
    }

    /// Syncs a file soon.
    pub fn sync(&self, file: &Arc<File>) {
        if !self.shared.is_asked.swap(true, Ordering::AcqRel) {
            self.send(Job::Sync(Arc::clone(file)));
        }
    }

    /// Syncs a new file and its name, and removes those before.
    pub fn replace(&self, file: &Arc<File>, folder: PathBuf, before: Vec<PathBuf>) {
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
}

impl Drop for Disk {
    /// All that was asked for is done.
    fn drop(&mut self) {
        drop(self.jobs.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn work(jobs: &Receiver<Job>, shared: &Shared, (quota, unsynced): (&Quota, &Unsynced), sync: Sync) {
    for job in jobs {
        let done = match job {
            Job::Sync(file) => {
                shared.is_asked.store(false, Ordering::Release);
                unsynced.sync_begins();
                sync(&file)
            }
            Job::Replace { file, folder, before } => {
                unsynced.sync_begins();
                let on_disk = sync(&file).and_then(|()| File::open(folder)?.sync_all());
                on_disk.map(|()| before.iter().for_each(|path| remove(path, quota)))
            }
        };
        if let Err(error) = done {
            let mut failure = shared.failure.lock().unwrap_or_else(PoisonError::into_inner);
            failure.get_or_insert_with(|| format!("what was written may not be on the disk: {error}"));
            return;
        }
        unsynced.synced();
    }
}

/// Removes a file of a journal, and frees its part of the quota.
pub fn remove(path: &PathBuf, quota: &Quota) {
    let bytes = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    match std::fs::remove_file(path) {
        Ok(()) => quota.free(bytes),
        Err(error) => tracing::warn!(path = %path.display(), %error, "an old file of a journal stays"),
    }
}
