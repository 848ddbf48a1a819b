//! Drivers that send one pose a call, kept between their calls.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use kerf_session::{Driver, Phase};

use super::pose_budget::PoseBudget;
use super::token;
use crate::status::RequestError;

/// How often drivers are looked for that are silent.
const PURGE_INTERVAL: Duration = Duration::from_secs(1);

/// Drivers by their lease, a text that only their client knows.
pub struct UnaryDrivers {
    drivers: Mutex<HashMap<String, UnaryDriver>>,
    max: usize,
    max_pose_rate_hz: f64,
}

/// A driver that sends one pose a call.
pub struct UnaryDriver {
    /// Its tools.
    pub driver: Driver,
    /// How many poses it may send.
    pub budget: PoseBudget,
    heard: Instant,
}

impl UnaryDrivers {
    /// Without drivers. A task looks after those that come, on the current runtime, while anybody holds this.
    pub fn new(max: usize, max_pose_rate_hz: f64) -> Arc<Self> {
        let drivers = Arc::new(Self { drivers: Mutex::default(), max, max_pose_rate_hz });
        let watched = Arc::downgrade(&drivers);
        tokio::spawn(async move {
            while let Some(drivers) = watched.upgrade() {
                drivers.purge();
                drop(drivers);
                tokio::time::sleep(PURGE_INTERVAL).await;
            }
        });
        drivers
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, UnaryDriver>> {
        self.drivers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Forgets drivers whose leases have run out and those of sessions that end. Nobody says good-bye
    /// in unary calls, so this precedes every call that counts drivers, and comes by itself for sessions that nobody
    /// calls any more.
    pub fn purge(&self) {
        self.lock().retain(|_, kept| {
            let session = kept.driver.session();
            let silent_s = kept.heard.elapsed().as_secs_f64();
            match session.phase() {
                Phase::Closing => false,
                // Leases are kept while a session stands, but not by those who do not come back.
                Phase::Paused | Phase::Failed { .. } => silent_s < session.limits().idle_timeout_s,
                Phase::Running => silent_s < session.limits().lease_s,
            }
        });
    }

    /// Keeps a new driver; answers with its lease.
    pub fn keep(&self, driver: Driver) -> Result<String, RequestError> {
        let mut drivers = self.lock();
        if drivers.len() >= self.max {
            return Err(RequestError::TooManyUnaryDrivers { limit: self.max });
        }
        let (lease, heard) = (token(), Instant::now());
        // One of its tools at a time is what a browser has a hand for.
        let budget = PoseBudget::new(self.max_pose_rate_hz, 1, heard);
        drivers.insert(lease.clone(), UnaryDriver { driver, budget, heard });
        Ok(lease)
    }

    /// Does something with the driver of `lease`, which is one of this session; that counts as a sign of life.
    pub fn with<T>(
        &self,
        lease: &str,
        session_id: &str,
        act: impl FnOnce(&mut UnaryDriver) -> T,
    ) -> Result<T, RequestError> {
        let mut drivers = self.lock();
        let kept = drivers.get_mut(lease).ok_or(RequestError::UnknownLease)?;
        let own = kept.driver.session().id().to_string();
        if own != session_id {
            return Err(RequestError::LeaseOfOther { session: own });
        }
        kept.heard = Instant::now();
        Ok(act(kept))
    }
}
