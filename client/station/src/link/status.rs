//! How a link is doing, for people.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long a fault that has passed is told of: long enough to be read, and to be in the report of the second.
pub const FAULT_TOLD: Duration = Duration::from_secs(5);

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
    /// What is wrong, or went wrong not long ago.
    pub last_fault: Option<String>,
    /// When it went wrong.
    faulty_since: Option<Instant>,
    /// Why the tool in hand feels nothing, and what to do about it: it is in tissue that it has not come into by moving.
    pub waits: Option<String>,
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

impl LinkStatus {
    /// Something goes wrong.
    pub(super) fn fail(&mut self, what: String) {
        (self.last_fault, self.faulty_since) = (Some(what), Some(Instant::now()));
    }

    /// All is well: what went wrong before is told of for a while yet.
    pub(super) fn go_well(&mut self, now: Instant) {
        self.state = LinkState::Connected;
        if self.faulty_since.is_some_and(|since| now.duration_since(since) > FAULT_TOLD) {
            (self.last_fault, self.faulty_since) = (None, None);
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_that_has_passed_is_told_of_for_a_while_and_is_past_then() {
        let mut status = LinkStatus::default();
        status.fail("no server".into());
        let now = Instant::now();
        status.go_well(now);
        assert_eq!(status.last_fault.as_deref(), Some("no server"));
        status.go_well(now + FAULT_TOLD + Duration::from_millis(100));
        assert_eq!((status.last_fault, status.state), (None, LinkState::Connected));
    }
}
