//! Places for what takes much memory on its way. When all are taken, one that may still be given up is, for the next.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

/// So many places, over all connections.
pub struct Places {
    most: usize,
    held: Mutex<Held>,
}

#[derive(Default)]
struct Held {
    next_id: u64,
    /// In the order of their coming.
    places: BTreeMap<u64, Holder>,
}

struct Holder {
    connection: Option<SocketAddr>,
    /// What gives the place up by its own end; `None` once nothing takes it away.
    held: Option<oneshot::Sender<()>>,
}

impl Places {
    /// None is taken yet.
    pub fn new(most: usize) -> Arc<Self> {
        Arc::new(Self { most, held: Mutex::default() })
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place. Where all are taken, one that may be is given up: the oldest of the connection that has most of them; `None`
    /// where there is no such.
    pub fn take(self: &Arc<Self>, connection: Option<SocketAddr>) -> Option<Place> {
        let mut held = self.lock();
        if held.places.len() >= self.most {
            let loose = || held.places.iter().filter(|(_, holder)| holder.held.is_some());
            let count = |of| loose().filter(|(_, holder)| holder.connection == of).count();
            let oldest = loose().max_by_key(|(id, holder)| (count(holder.connection), Reverse(**id)));
            let oldest = *oldest?.0;
            held.places.remove(&oldest);
        }
        let (id, (sender, given_up)) = (held.next_id, oneshot::channel());
        held.next_id += 1;
        held.places.insert(id, Holder { connection, held: Some(sender) });
        Some(Place { id, places: Arc::clone(self), given_up })
    }
}

/// A place that is taken while this lives.
pub struct Place {
    id: u64,
    places: Arc<Places>,
    /// Ends when another gets the place.
    given_up: oneshot::Receiver<()>,
}

impl Place {
    /// From now on nothing takes the place away.
    pub fn keep(&self) {
        if let Some(holder) = self.places.lock().places.get_mut(&self.id) {
            holder.held = None;
        }
    }

    /// Returns when another gets the place. Not to be asked of one that is kept.
    pub async fn given_up(&mut self) {
        let _ = (&mut self.given_up).await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.places.lock().places.remove(&self.id);
    }
}
