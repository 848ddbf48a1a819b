//! Stands in for the vendor's library libHD in tests: the same ABI around simulated devices.
//!
//! It is as strict as the vendor's documents: what is set outside a frame, a frame within a frame or one that is ended
//! twice is an error, and errors go to one stack that whoever asks empties. A test loads the shared library as the
//! station does, gets [`Control`] from the symbol `standInControl`, and steers the devices with it. Each copy of the
//! file is a world of its own. Deliberately absent: joints, torques and everything else that the station does not use.

#![allow(non_snake_case, reason = "the names of the vendor's functions")]

mod exports;
mod scheduler;
mod world;

use std::sync::{Mutex, MutexGuard, PoisonError};

pub use world::{Device, ErrorInfo, World, code};

/// The only control of this copy of the library.
pub(crate) static CONTROL: Control = Control { world: Mutex::new(World::new()) };

/// What a test steers the devices with.
pub struct Control {
    world: Mutex<World>,
}

impl Control {
    /// The devices and all else; nothing moves while it is held.
    pub fn world(&self) -> MutexGuard<'_, World> {
        self.world.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The control of this copy of the library.
#[allow(improper_ctypes_definitions, reason = "both sides are this crate, built once")]
#[unsafe(no_mangle)]
pub extern "system" fn standInControl() -> &'static Control {
    &CONTROL
}
