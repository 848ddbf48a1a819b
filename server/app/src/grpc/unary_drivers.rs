//! Drivers that send one pose a call, kept between their calls.

use std::collections::HashMap;
use std::collections::hash_map::RandomState;
use std::hash::BuildHasher;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use kerf_session::{Driver, Phase};

use crate::status::RequestError;

/// Drivers by their lease, a text that only their client knows.
pub struct UnaryDrivers {
    drivers: Mutex<HashMap<String, UnaryDriver>>,
    max: usize,
}

struct UnaryDriver {
    driver: Driver,
    heard: Instant,
}

impl UnaryDrivers {
    pub fn new(max: usize) -> Self {
        Self { drivers: Mutex::default(), max }
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, UnaryDriver>> {
        self.drivers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Forgets drivers whose leases have run out and those of sessions that end. Nobody says good-bye
    /// in unary calls, so this precedes every call that counts drivers.
    pub fn purge(&self) {
        self.lock().retain(|_, kept| {
            let session = kept.driver.session();
            match session.phase() {
                Phase::Closing => false,
                // Leases are kept while a session stands.
                Phase::Paused | Phase::Failed { .. } => true,
                Phase::Running => kept.heard.elapsed() < Duration::from_secs_f64(session.limits().lease_s),
            }
        });
    }

    /// Keeps a new driver; answers with its lease.
    pub fn keep(&self, driver: Driver) -> Result<String, RequestError> {
        let mut drivers = self.lock();
        if drivers.len() >= self.max {
            return Err(RequestError::TooManyUnaryDrivers { limit: self.max });
        }
        // Two keyed hashes under fresh keys of the operating system's: not to be guessed.
        let lease = format!("{:016x}{:016x}", RandomState::new().hash_one(0), RandomState::new().hash_one(1));
        drivers.insert(lease.clone(), UnaryDriver { driver, heard: Instant::now() });
        Ok(lease)
    }

    /// Does something with the driver of `lease`, which counts as a sign of life.
    pub fn with<T>(&self, lease: &str, act: impl FnOnce(&mut Driver) -> T) -> Result<T, RequestError> {
        let mut drivers = self.lock();
        let kept = drivers.get_mut(lease).ok_or(RequestError::UnknownLease)?;
        kept.heard = Instant::now();
        Ok(act(&mut kept.driver))
    }
}
