//! Where recordings and journals are written to, whole chunks at a time, and how much of the disk they may take together.

use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, Error};

use crate::storage::Stored;

const BYTES_PER_MIB: f64 = 1048576.0;

/// How much the files of a folder may take together.
#[derive(Debug)]
pub struct Quota {
    /// The settings of the folder and of what it may hold.
    names: [&'static str; 2],
    max_mib: f64,
    /// What the folder held when it was last measured, and what was written since.
    kept_bytes: AtomicU64,
}

impl Quota {
    /// So much in the folder of the setting `names[0]`, by the setting `names[1]`.
    #[must_use]
    pub fn of_mib(names: [&'static str; 2], max_mib: f64) -> Self {
        Self { names, max_mib, kept_bytes: AtomicU64::new(0) }
    }

    /// How much the folder may hold.
    #[must_use]
    pub fn max_bytes(&self) -> u64 {
        (self.max_mib * BYTES_PER_MIB) as u64
    }

    /// So much of it was removed.
    pub fn free(&self, bytes: u64) {
        self.kept_bytes.fetch_sub(bytes.min(self.kept_bytes.load(Ordering::Relaxed)), Ordering::Relaxed);
    }

    /// Measures what is in the folder now: people remove what they do not need any more.
    ///
    /// # Errors
    /// The folder cannot be read, or it is full.
    pub fn measure(&self, folder: &Path) -> anyhow::Result<()> {
        let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
        let bytes = entries.filter_map(|entry| entry.ok()?.metadata().ok()).map(|metadata| metadata.len()).sum();
        self.kept_bytes.store(bytes, Ordering::Relaxed);
        self.check().map_err(Error::msg)
    }

    /// Whether another chunk may be written; the one that crosses the border may.
    ///
    /// # Errors
    /// Why not.
    pub fn check(&self) -> Result<(), String> {
        let kept_mib = self.kept_bytes.load(Ordering::Relaxed) as f64 / BYTES_PER_MIB;
        match kept_mib < self.max_mib {
            true => Ok(()),
            false => {
                let [folder, limit] = self.names;
                Err(format!("{folder} holds {kept_mib:.1} MiB, at most {} ({limit})", self.max_mib))
            }
        }
    }
}

/// A file that is written in whole chunks: nothing reaches it before it is flushed.
#[derive(Debug)]
pub struct Sink {
    file: Arc<dyn Stored>,
    quota: Arc<Quota>,
    waiting: Vec<u8>,
    written_bytes: u64,
}

impl Sink {
    /// A new file.
    #[must_use]
    pub fn new(file: Arc<dyn Stored>, quota: Arc<Quota>) -> Self {
        Self { file, quota, waiting: Vec::new(), written_bytes: 0 }
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.waiting.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let written = self.file.append(&self.waiting);
        let bytes = self.waiting.len() as u64;
        self.waiting.clear();
        written?;
        self.written_bytes += bytes;
        self.quota.kept_bytes.fetch_add(bytes, Ordering::Relaxed);
        Ok(())
    }
}

impl Seek for Sink {
    /// Only where it is: nothing that was written is ever changed.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.written_bytes + self.waiting.len() as u64),
            _ => Err(io::Error::new(io::ErrorKind::Unsupported, "recordings are written in order")),
        }
    }
}
