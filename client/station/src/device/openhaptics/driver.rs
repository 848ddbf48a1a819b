//! One library in the process, its scheduler and its error stack, which all devices share.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::abi::{ErrorInfo, Handle, Hd, INVALID_HANDLE};

/// Where the library is looked for unless the configuration names a file.
#[cfg(target_os = "windows")]
pub const LIBRARIES: [&str; 1] = ["HD.dll"];
/// Where the library is looked for unless the configuration names a file.
#[cfg(target_os = "macos")]
pub const LIBRARIES: [&str; 1] = ["libHD.dylib"];
/// Where the library is looked for unless the configuration names a file.
#[cfg(not(any(target_os = "windows", target_os = "macos")))]
pub const LIBRARIES: [&str; 3] = ["libHD.so", "libHD.so.3.4", "libHD.so.3.0"];

/// Most devices at a time.
const MAX_DEVICES: usize = 8;

/// All libraries that were ever loaded: they stay for good.
static LOADED: Mutex<Vec<(PathBuf, &'static Driver)>> = Mutex::new(Vec::new());

/// A loaded library.
pub struct Driver {
    /// Its functions.
    pub hd: Hd,
    /// The file or name that it was loaded by.
    pub path: PathBuf,
    /// Number of devices that run.
    running: Mutex<usize>,
    mailboxes: [Mailbox; MAX_DEVICES],
}

/// What the error stack held about a device; whoever empties the stack leaves it here.
struct Mailbox {
    handle: AtomicU32,
    /// Code and internal number of the last error, 0: none.
    error: AtomicU64,
}

/// The libraries that were tried and what each answered.
pub type Attempts = Vec<(PathBuf, String)>;

impl Driver {
    /// The library of a file, or the first that is found.
    ///
    /// # Errors
    /// What was tried and how it failed.
    pub fn load(file: Option<&Path>) -> Result<&'static Self, Attempts> {
        let candidates: Vec<PathBuf> = match file {
            Some(file) => vec![file.into()],
            None => LIBRARIES.iter().map(PathBuf::from).collect(),
        };
        let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        let mut attempts = Vec::new();
        for path in candidates {
            if let Some((_, driver)) = loaded.iter().find(|(other, _)| *other == path) {
                return Ok(driver);
            }
            match Hd::load(&path) {
                Ok(hd) => {
                    let mailboxes = std::array::from_fn(|_| Mailbox {
                        handle: AtomicU32::new(INVALID_HANDLE),
                        error: AtomicU64::new(0),
                    });
                    let driver: &'static Self =
                        Box::leak(Box::new(Self { hd, path: path.clone(), running: Mutex::new(0), mailboxes }));
                    loaded.push((path, driver));
                    return Ok(driver);
                }
                Err(answer) => attempts.push((path, answer)),
            }
        }
        Err(attempts)
    }

    /// Does what the library allows only while its scheduler stands. Devices that run pause for as long, with slack
    /// motors.
    pub fn while_stopped<T>(&self, work: impl FnOnce(&Hd) -> T) -> T {
        let running = self.running();
        if *running > 0 {
            self.hd.stop_scheduler();
        }
        let result = work(&self.hd);
        if *running > 0 {
            self.hd.start_scheduler();
        }
        result
    }

    /// One more device runs.
    pub fn start(&self) {
        let mut running = self.running();
        *running += 1;
        if *running == 1 {
            self.hd.start_scheduler();
        }
    }

    /// One device less runs.
    pub fn stop(&self) {
        let mut running = self.running();
        *running -= 1;
        if *running == 0 {
            self.hd.stop_scheduler();
        }
    }

    fn running(&self) -> MutexGuard<'_, usize> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A device wants its errors from now on; false: there are too many.
    pub fn register(&self, handle: Handle) -> bool {
        self.mailboxes.iter().any(|mailbox| {
            let is_taken =
                mailbox.handle.compare_exchange(INVALID_HANDLE, handle, Ordering::AcqRel, Ordering::Relaxed).is_err();
            if !is_taken {
                mailbox.error.store(0, Ordering::Release);
            }
            !is_taken
        })
    }

    /// A device is gone.
    pub fn deregister(&self, handle: Handle) {
        if let Some(mailbox) = self.mailbox(handle) {
            mailbox.handle.store(INVALID_HANDLE, Ordering::Release);
        }
    }

    fn mailbox(&self, handle: Handle) -> Option<&Mailbox> {
        self.mailboxes.iter().find(|mailbox| mailbox.handle.load(Ordering::Acquire) == handle)
    }

    /// Empties the error stack into the devices' mailboxes and takes what is in that of `handle`. What belongs to no
    /// device belongs to whoever asks. Neither waits nor allocates.
    pub fn take_error(&self, handle: Handle) -> Option<ErrorInfo> {
        // The stack has an end even if a broken library never says so.
        for error in std::iter::from_fn(|| self.hd.pop_error()).take(64) {
            let mailbox = self.mailbox(error.handle).or_else(|| self.mailbox(handle));
            if let Some(mailbox) = mailbox {
                let packed = u64::from(error.code) << 32 | u64::from(error.internal.cast_unsigned());
                mailbox.error.store(packed, Ordering::Release);
            }
        }
        let packed = self.mailbox(handle)?.error.swap(0, Ordering::AcqRel);
        let error = ErrorInfo { code: (packed >> 32) as u32, internal: (packed as u32).cast_signed(), handle };
        (error.code != 0).then_some(error)
    }

    /// Empties the error stack after a call about no device yet; the first error that came, if any did.
    pub fn drain(&self) -> Option<ErrorInfo> {
        std::iter::from_fn(|| self.hd.pop_error()).take(64).last()
    }
}
