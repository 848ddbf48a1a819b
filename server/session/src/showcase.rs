//! Where surfaces and states are laid out for viewers, by whoever makes them: a session's projector, or a player.

use std::sync::{Arc, MutexGuard};

use kerf_physics::surface::delta::{Keyframe, TopologyPatch};
use tokio::sync::watch;

use crate::lock::lock;
use crate::outbox::{Outbox, Shelf};
use crate::view_message::ViewState;

/// One end of a session's outbox. What is of another epoch than the scene's own comes too late and is dropped, as is all
/// while nobody views.
#[derive(Clone)]
pub(crate) struct Showcase {
    outbox: Arc<Outbox>,
    bell: Arc<watch::Sender<u64>>,
}

impl Showcase {
    pub fn new(outbox: Arc<Outbox>, bell: watch::Sender<u64>) -> Self {
        Self { outbox, bell: Arc::new(bell) }
    }

    pub fn patch(&self, epoch: u64, patch: TopologyPatch) {
        if let Some(mut shelf) = self.shelf_of(epoch) {
            shelf.log.push(patch);
        }
    }

    pub fn keyframe(&self, epoch: u64, keyframe: Keyframe) {
        if let Some(mut shelf) = self.shelf_of(epoch) {
            shelf.log.set_keyframe(keyframe);
            self.outbox.note_wish(&shelf.log);
        }
    }

    /// Replaces the state; wakes viewers, also for structure that was published before it.
    pub fn state(&self, state: ViewState) {
        if let Some(mut shelf) = self.shelf_of(state.place.epoch) {
            shelf.state = Some(Arc::new(state));
        }
        self.ring();
    }

    /// Wakes viewers.
    pub fn ring(&self) {
        self.bell.send_modify(|rung| *rung = rung.wrapping_add(1));
    }

    fn shelf_of(&self, epoch: u64) -> Option<MutexGuard<'_, Shelf>> {
        self.shelf().filter(|shelf| shelf.log.epoch() == epoch)
    }

    /// The shelf, while anybody views. The last who left has cleared it, perhaps since it was asked whether anybody
    /// does; what came onto it afterwards would meet the next viewer long after its time.
    pub fn shelf(&self) -> Option<MutexGuard<'_, Shelf>> {
        let shelf = lock(&self.outbox.shelf);
        self.outbox.is_viewed().then_some(shelf)
    }
}
