//! What files say, read again when they change. Files that make no sense leave things as they were, with a word in the log.

use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{Duration, SystemTime};

use anyhow::{Context, Result};

/// How often files are looked at: whoever takes a token back waits no longer than this, and a look costs microseconds.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);

/// When a file was changed, how long it is, and which file it is.
type Stamp = (SystemTime, u64, u64);

/// What files say at present.
pub struct Reloaded<T> {
    /// For the log.
    what: &'static str,
    files: Vec<PathBuf>,
    read: Box<dyn Fn() -> Result<T> + Send + Sync>,
    value: RwLock<Arc<T>>,
    seen: Mutex<Seen>,
}

struct Seen {
    stamps: Vec<Stamp>,
    /// Why they could not be read; said once.
    error: Option<String>,
}

impl<T: Send + Sync + 'static> Reloaded<T> {
    /// Reads the files now, and from now on when they change, on the current runtime and while anybody holds this.
    pub fn begin(
        what: &'static str,
        files: Vec<PathBuf>,
        read: impl Fn() -> Result<T> + Send + Sync + 'static,
    ) -> Result<Arc<Self>> {
        let seen = Mutex::new(Seen { stamps: stamps(&files)?, error: None });
        let value = RwLock::new(Arc::new(read()?));
        let reloaded = Arc::new(Self { what, files, read: Box::new(read), value, seen });
        let watched = Arc::downgrade(&reloaded);
        tokio::spawn(async move {
            loop {
                tokio::time::sleep(LOOK_INTERVAL).await;
                let Some(reloaded) = watched.upgrade() else { break };
                // A disk may be slow: no stream waits for it. The runtime may end meanwhile.
                let _ = tokio::task::spawn_blocking(move || reloaded.look()).await;
            }
        });
        Ok(reloaded)
    }

    /// What they say.
    pub fn get(&self) -> Arc<T> {
        Arc::clone(&self.value.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Reads them if they have changed.
    fn look(&self) {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let read = stamps(&self.files).and_then(|stamps| match stamps == seen.stamps && seen.error.is_none() {
            true => Ok(None),
            false => Ok(Some((stamps, (self.read)()?))),
        });
        match read {
            Ok(None) => {}
            Ok(Some((stamps, value))) => {
                *seen = Seen { stamps, error: None };
                *self.value.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(value);
                tracing::info!("{}: read again", self.what);
            }
            Err(error) => {
                let error = format!("{error:#}");
                if seen.error.as_ref() != Some(&error) {
                    tracing::error!("{}: {error}; what was read before stays in force", self.what);
                }
                seen.error = Some(error);
            }
        }
    }
}

fn stamps(files: &[PathBuf]) -> Result<Vec<Stamp>> {
    let stamp = |file: &PathBuf| {
        let metadata = std::fs::metadata(file).with_context(|| file.display().to_string())?;
        Ok((metadata.modified()?, metadata.len(), metadata.ino()))
    };
    files.iter().map(stamp).collect()
}
