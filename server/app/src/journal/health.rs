//! How journals are doing, for whoever watches the server.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use kerf_session::counts::Count;

/// How the journals of a server are doing.
#[derive(Debug, Default)]
pub struct Health {
    journals: Mutex<Vec<Weak<Unsynced>>>,
    /// Sessions that have no journal, as none could be begun.
    pub not_begun: Count,
    /// Journals that ended before their session.
    pub broken_off: Count,
    /// Journals that brought no session back.
    pub not_brought_back: Count,
}

/// What the disk has yet to confirm, of all journals.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lag {
    /// Journals that are written.
    pub journals: usize,
    /// Bytes that were written.
    pub unsynced_bytes: u64,
    /// How long the oldest record has waited, s; 0 where none does.
    pub oldest_s: f64,
}

impl Health {
    /// Another journal; it counts as long as it is held.
    pub fn begin(&self) -> Arc<Unsynced> {
        let unsynced = Arc::new(Unsynced::default());
        let mut journals = self.journals.lock().unwrap_or_else(PoisonError::into_inner);
        journals.retain(|journal| journal.strong_count() > 0);
        journals.push(Arc::downgrade(&unsynced));
        unsynced
    }

    /// What waits at this time.
    pub fn lag(&self, now_ns: u64) -> Lag {
        let journals = self.journals.lock().unwrap_or_else(PoisonError::into_inner);
        let waiting: Vec<Waiting> = journals.iter().filter_map(Weak::upgrade).map(|journal| journal.all()).collect();
        let oldest_ns = waiting.iter().filter_map(|waiting| waiting.since_ns).min();
        Lag {
            journals: waiting.len(),
            unsynced_bytes: waiting.iter().map(|waiting| waiting.bytes).sum(),
            oldest_s: oldest_ns.map_or(0.0, |since_ns| now_ns.saturating_sub(since_ns) as f64 * 1e-9),
        }
    }
}

/// What of one journal the disk has yet to confirm. Its writer and the thread that waits for the disk tell of it.
#[derive(Debug, Default)]
pub struct Unsynced(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    /// When the oldest record came that is not written yet.
    came_ns: Option<u64>,
    /// Written since the last sync began.
    waiting: Waiting,
    /// What that sync is about; stays if it fails.
    syncing: Waiting,
}

#[derive(Clone, Copy, Debug, Default)]
struct Waiting {
    bytes: u64,
    /// When the oldest of it came.
    since_ns: Option<u64>,
}

impl Unsynced {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records came, and are to be written.
    pub fn came(&self, now_ns: u64) {
        self.lock().came_ns.get_or_insert(now_ns);
    }

    /// What came was written, so much of it.
    pub fn written(&self, bytes: u64) {
        let mut state = self.lock();
        let came_ns = state.came_ns.take();
        state.waiting.bytes += bytes;
        state.waiting.since_ns = state.waiting.since_ns.or(came_ns);
    }

    /// The disk is asked to confirm what was written.
    pub fn sync_begins(&self) {
        let mut state = self.lock();
        let asked = std::mem::take(&mut state.waiting);
        state.syncing.bytes += asked.bytes;
        state.syncing.since_ns = state.syncing.since_ns.or(asked.since_ns);
    }

    /// It has.
    pub fn synced(&self) {
        self.lock().syncing = Waiting::default();
    }

    fn all(&self) -> Waiting {
        let State { came_ns, waiting, syncing } = &*self.lock();
        let since_ns = syncing.since_ns.or(waiting.since_ns).or(*came_ns);
        Waiting { bytes: waiting.bytes + syncing.bytes, since_ns }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    #[test]
    fn records_lag_until_the_disk_has_confirmed_them() {
        let health = Health::default();
        let journal = health.begin();
        let lag = |now_s: u64| {
            let Lag { unsynced_bytes, oldest_s, .. } = health.lag(now_s * S);
            (unsynced_bytes, oldest_s)
        };
        assert_eq!(lag(1), (0, 0.0));
        journal.came(S);
        journal.came(2 * S);
        journal.written(100);
        assert_eq!(lag(3), (100, 2.0));
        journal.came(4 * S);
        journal.sync_begins();
        journal.written(20);
        assert_eq!(lag(5), (120, 4.0), "the disk has not answered yet");
        journal.synced();
        assert_eq!(lag(5), (20, 1.0), "what was written after the question");
    }

    #[test]
    fn the_lag_is_that_of_the_journal_which_is_furthest_behind_and_goes_with_it() {
        let health = Health::default();
        let (first, second) = (health.begin(), health.begin());
        first.came(S);
        second.came(3 * S);
        assert_eq!(health.lag(4 * S), Lag { journals: 2, unsynced_bytes: 0, oldest_s: 3.0 });
        drop(first);
        assert_eq!(health.lag(4 * S), Lag { journals: 1, unsynced_bytes: 0, oldest_s: 1.0 });
    }
}
