//! The disk, as recordings and journals ask it.

use std::fmt::Debug;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;

/// A file that grows.
pub trait Stored: Debug + Send + Sync {
    /// Writes this at its end; nothing of it stays where not all of it fits.
    ///
    /// # Errors
    /// It is not written.
    fn append(&self, bytes: &[u8]) -> io::Result<()>;

    /// Waits until the disk has what was written.
    ///
    /// # Errors
    /// It may not have it.
    fn sync(&self) -> io::Result<()>;
}

/// Where files are.
pub trait Storage: Send + Sync {
    /// A new file.
    ///
    /// # Errors
    /// It cannot be made, or there is one.
    fn create(&self, path: &Path) -> io::Result<Arc<dyn Stored>>;

    /// Removes a file.
    ///
    /// # Errors
    /// It stays.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// Gives a file another name, in the same folder.
    ///
    /// # Errors
    /// It keeps the one that it has.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Waits until the disk has which files there are in a folder.
    ///
    /// # Errors
    /// It may not have it.
    fn sync_names(&self, folder: &Path) -> io::Result<()>;
}

/// Extension of a file whose beginning is not written yet.
pub const PART: &str = "part";

/// A new file that gets its name once its beginning is written, so that a kill leaves none without one.
///
/// # Errors
/// It cannot be made, or not begun; there is none then.
pub fn create_begun<T, E: From<io::Error>>(
    storage: &dyn Storage,
    path: &Path,
    begin: impl FnOnce(Arc<dyn Stored>) -> Result<T, E>,
) -> Result<T, E> {
    let part = path.with_extension(PART);
    let begun = begin(storage.create(&part)?).and_then(|begun| {
        storage.rename(&part, path)?;
        Ok(begun)
    });
    if begun.is_err() {
        let _ = storage.remove(&part);
    }
    begun
}

/// The disk of the machine.
#[derive(Debug)]
pub struct SystemDisk;

impl Storage for SystemDisk {
    fn create(&self, path: &Path) -> io::Result<Arc<dyn Stored>> {
        Ok(Arc::new(File::create_new(path)?))
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)
    }

    fn sync_names(&self, folder: &Path) -> io::Result<()> {
        File::open(folder)?.sync_all()
    }
}

impl Stored for File {
    fn append(&self, bytes: &[u8]) -> io::Result<()> {
        let mut file = self;
        let before = file.metadata()?.len();
        file.write_all(bytes).inspect_err(|_| {
            let _ = file.set_len(before);
            let _ = file.seek(SeekFrom::Start(before));
        })
    }

    fn sync(&self) -> io::Result<()> {
        self.sync_data()
    }
}
