//! How a link is doing, for people.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a link is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinkState {
    /// It dials.
    #[default]
    Connecting,
    /// The stream is open.
    Connected,
    /// The session stands.
    Paused,
    /// It has given up: `LinkStatus::last_fault` says what to do.
    Failed,
}

/// How a link is doing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinkStatus {
    /// What it is doing.
    pub state: LinkState,
    /// The session.
    pub session_id: String,
    /// What went wrong last.
    pub last_fault: Option<String>,
    /// Streams that were opened.
    pub connections: u64,
    /// Contacts that came in.
    pub contacts: u64,
    /// Poses that were sent.
    pub poses: u64,
    /// Messages that were sent, acknowledgements by themselves included.
    pub messages: u64,
    /// Poses that would have been sent without a deadband.
    pub poses_due: u64,
    /// Poses that the server refused.
    pub rejected: u64,
    /// Smoothed round trip, s.
    pub round_trip_s: Option<f64>,
    /// The server's clock less this machine's, s, and by how much that may be off.
    pub clock_offset_s: Option<(f64, f64)>,
    /// Time that the newest contact took from the server to here, by that offset, s.
    pub down_s: Option<f64>,
}

/// A status that the link's threads and the monitor share.
#[derive(Clone, Debug, Default)]
pub struct SharedStatus(Arc<Mutex<LinkStatus>>);

impl SharedStatus {
    /// A copy.
    #[must_use]
    pub fn get(&self) -> LinkStatus {
        self.lock().clone()
    }

    pub(super) fn change(&self, change: impl FnOnce(&mut LinkStatus)) {
        change(&mut self.lock());
    }

    fn lock(&self) -> MutexGuard<'_, LinkStatus> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
