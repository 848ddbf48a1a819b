//! Records of sessions that go on, each written by a thread of its own.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;

use kerf_proto::v1;
use kerf_session::{Session, SessionId};

use super::Told;

/// The records of a server's sessions that go on, or have ended and were not asked about.
#[derive(Default)]
pub struct Going(Mutex<BTreeMap<SessionId, Arc<Record>>>);

struct Record {
    session: Weak<Session>,
    told: Arc<Told>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Going {
    /// Another, with the thread that writes it, if there is one.
    pub fn add(&self, session: &Arc<Session>, told: Arc<Told>, thread: Option<JoinHandle<()>>) {
        let mut records = self.lock();
        // Those of sessions that ended without being asked about, as when a client goes away while its scene is built.
        records.retain(|_, record| record.session.strong_count() > 0);
        let record = Record { session: Arc::downgrade(session), told, thread: Mutex::new(thread) };
        records.insert(session.id(), Arc::new(record));
    }

    /// What has become of a session's record so far; `None` where none is made.
    #[must_use]
    pub fn so_far(&self, session: SessionId) -> Option<v1::Recording> {
        self.lock().get(&session).map(|record| record.told.so_far())
    }

    /// Waits until a session that has ended is written out, and says what became of it.
    pub async fn finish(&self, session: SessionId) -> Option<v1::Recording> {
        let record = self.lock().remove(&session)?;
        let joined = Arc::clone(&record);
        let _ = tokio::task::spawn_blocking(move || joined.join()).await;
        Some(record.told.so_far())
    }

    /// Waits until all sessions are written out; all have ended.
    pub async fn finish_all(&self) {
        let sessions: Vec<_> = self.lock().keys().copied().collect();
        for session in sessions {
            self.finish(session).await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<SessionId, Arc<Record>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Record {
    fn join(&self) {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if thread.is_some_and(|thread| thread.join().is_err()) {
            self.told.note(|recording| recording.error = "the thread that records panicked".into());
        }
    }
}
