//! A disk that forgets: what power cuts, kills and faults leave of the files of journals.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fastrand::Rng;

use crate::storage::{Storage, Stored};

/// A disk under a folder. What programs read there is what was written; what a power cut leaves of it is drawn by seed.
pub struct VirtualDisk {
    state: Arc<Mutex<State>>,
}

#[derive(Debug)]
struct State {
    random: Rng,
    faults: Faults,
    /// Processes that were killed: their files take no more.
    kills: usize,
    files: Vec<Content>,
    /// What is there, by name.
    names: BTreeMap<PathBuf, usize>,
    /// What would be there after a power cut for sure.
    synced_names: BTreeMap<PathBuf, usize>,
    /// Names that were made or removed since.
    unsynced_names: Vec<(PathBuf, Option<usize>)>,
}

/// How likely calls fail.
#[derive(Clone, Copy, Debug, Default)]
pub struct Faults {
    /// Writes that find the disk full.
    pub full: f64,
    /// Syncs that fail.
    pub sync: f64,
}

#[derive(Debug, Default)]
struct Content {
    written: Vec<u8>,
    synced_bytes: usize,
}

#[derive(Debug)]
struct VirtualFile {
    state: Arc<Mutex<State>>,
    index: usize,
    /// Processes that had been killed as it was made.
    kills: usize,
    /// What programs read.
    file: File,
}

impl VirtualDisk {
    /// An empty one.
    pub fn new(seed: u64, faults: Faults) -> Self {
        let state = State {
            random: Rng::with_seed(seed),
            faults,
            kills: 0,
            files: Vec::new(),
            names: BTreeMap::new(),
            synced_names: BTreeMap::new(),
            unsynced_names: Vec::new(),
        };
        Self { state: Arc::new(Mutex::new(state)) }
    }

    /// Kills who writes: what it has not handed over yet is lost.
    pub fn kill(&self) {
        lock(&self.state).kills += 1;
    }

    /// Cuts the power: the folder holds what the disk has then, and all of that is synced.
    ///
    /// Of names that were not synced any may be as before; of content that was not synced any sector may be zero, and the
    /// file may end anywhere in it.
    pub fn cut_power(&self) {
        let mut state = lock(&self.state);
        let State { random, files, names, synced_names, unsynced_names, .. } = &mut *state;
        let mut left = synced_names.clone();
        for (path, index) in unsynced_names.drain(..).filter(|_| random.bool()) {
            match index {
                Some(index) => drop(left.insert(path, index)),
                None => drop(left.remove(&path)),
            }
        }
        for path in names.keys() {
            let _ = std::fs::remove_file(path);
        }
        for (path, &index) in &left {
            let Content { written, synced_bytes } = &mut files[index];
            let end = random.usize(*synced_bytes..=written.len());
            written.truncate(end);
            let sector_bytes = 1 << random.u32(6..=12);
            let lost = random.f64();
            for sector in (0..end).step_by(sector_bytes).filter(|sector| sector + sector_bytes > *synced_bytes) {
                if random.f64() < lost {
                    written[sector.max(*synced_bytes)..(sector + sector_bytes).min(end)].fill(0);
                }
            }
            *synced_bytes = end;
            std::fs::write(path, written).unwrap();
        }
        (*names, *synced_names) = (left.clone(), left);
    }
}

impl Storage for VirtualDisk {
    fn create(&self, path: &Path) -> io::Result<Arc<dyn Stored>> {
        let file = File::create_new(path)?;
        let mut state = lock(&self.state);
        let index = state.files.len();
        state.files.push(Content::default());
        state.names.insert(path.into(), index);
        state.unsynced_names.push((path.into(), Some(index)));
        let kills = state.kills;
        Ok(Arc::new(VirtualFile { state: Arc::clone(&self.state), index, kills, file }))
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)?;
        let mut state = lock(&self.state);
        state.names.remove(path);
        state.unsynced_names.push((path.into(), None));
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)?;
        let mut state = lock(&self.state);
        let index = state.names.remove(from).expect("a file that was made here");
        state.names.insert(to.into(), index);
        state.unsynced_names.extend([(to.into(), Some(index)), (from.into(), None)]);
        Ok(())
    }

    fn sync_names(&self, _: &Path) -> io::Result<()> {
        let mut state = lock(&self.state);
        state.sync_or_fail()?;
        state.synced_names = state.names.clone();
        state.unsynced_names.clear();
        Ok(())
    }
}

impl Stored for VirtualFile {
    fn append(&self, bytes: &[u8]) -> io::Result<()> {
        let mut state = lock(&self.state);
        if state.kills > self.kills {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        let full = state.faults.full;
        if state.random.f64() < full {
            return Err(io::Error::from_raw_os_error(libc::ENOSPC));
        }
        self.file.append(bytes)?;
        state.files[self.index].written.extend_from_slice(bytes);
        Ok(())
    }

    fn sync(&self) -> io::Result<()> {
        let mut state = lock(&self.state);
        state.sync_or_fail()?;
        let content = &mut state.files[self.index];
        content.synced_bytes = content.written.len();
        Ok(())
    }
}

impl State {
    fn sync_or_fail(&mut self) -> io::Result<()> {
        match self.random.f64() < self.faults.sync {
            true => Err(io::Error::from_raw_os_error(libc::EIO)),
            false => Ok(()),
        }
    }
}

fn lock(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}
