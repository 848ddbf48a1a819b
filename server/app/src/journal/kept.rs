//! A session that moves between servers: a file of a journal, put down and read.

use std::io::{self, Cursor, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Error, Result};
use kerf_session::{Base, Session, SessionId, TapeEntry};
use tempfile::NamedTempFile;

use super::files::Files;
use crate::convert::scene::scene_summary;
use crate::recording::convert;
use crate::recording::tape::{self, plain};
use crate::recording::tracks::{Track, Tracks};
use crate::recording::writer::LogClock;
use crate::storage::{Storage, create_begun};

/// A file that brings a session back, until its journal goes on with it.
pub struct Kept {
    path: PathBuf,
    /// Its end removes the file, where it is of no journal.
    _temporary: Option<NamedTempFile>,
    is_released: bool,
}

impl Kept {
    /// Writes it to the disk: in the folder of journals, as the first file of the session's.
    pub fn write(journals: Option<(&Path, &dyn Storage)>, session: SessionId, content: &[u8]) -> io::Result<Self> {
        let Some((folder, storage)) = journals else {
            let mut temporary = NamedTempFile::new()?;
            temporary.write_all(content)?;
            return Ok(Self { path: temporary.path().into(), _temporary: Some(temporary), is_released: false });
        };
        let path = Files { folder: folder.into(), session, before: Vec::new() }.next();
        create_begun(storage, &path, |file| {
            file.append(content)?;
            file.sync()
        })?;
        let kept = Self { path, _temporary: None, is_released: false };
        storage.sync_names(folder)?;
        Ok(kept)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Leaves it to the session's journal.
    pub(super) fn release(mut self) -> Vec<PathBuf> {
        self.is_released = true;
        vec![self.path.clone()]
    }
}

impl Drop for Kept {
    /// A session that did not come leaves nothing.
    fn drop(&mut self) {
        if !self.is_released && self._temporary.is_none() {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// What a session goes on from elsewhere, as a file of its journal.
pub fn put_down(session: &Session, base: &Arc<Base>) -> Result<Vec<u8>> {
    let header = kerf_proto::v1::RecordingHeader {
        is_paused: base.is_paused,
        ..convert::header(session, scene_summary(session))?
    };
    let time_ns = LogClock::now()?.unix_ns(kerf_session::clock::MonotonicClock::now_ns());
    let mut file = Vec::new();
    let tracks = Tracks::begin(Cursor::new(&mut file), [Track::Header, Track::Base, Track::Checkpoint], |tracks| {
        tracks.write(Track::Header, time_ns, &header)?;
        tape::write(tracks, time_ns, &TapeEntry::Base(Arc::clone(base)))
    });
    tracks.and_then(Tracks::finish).map_err(|error| Error::msg(plain(&error)))?;
    Ok(file)
}
