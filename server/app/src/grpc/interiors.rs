//! The insides of objects that somebody asked for, kept for a moment: many who ask cost a session what one does.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use kerf_physics::world::Interior;
use kerf_proto::v1;
use kerf_session::{Phase, Session, SessionError, SessionId};

/// How old an answer may be while a session runs: an eye takes this for one moment.
const FRESH: Duration = Duration::from_millis(200);

/// Answers by session and object. Whoever asks while another waits for the session waits for the same answer.
#[derive(Default)]
pub(super) struct Interiors(Mutex<HashMap<(SessionId, usize), Arc<Slot>>>);

type Slot = tokio::sync::Mutex<Option<(Instant, Arc<v1::GetInteriorResponse>)>>;

impl Interiors {
    /// The inside of an object that is in the scene.
    pub async fn of(&self, session: &Session, object: usize) -> Result<Arc<v1::GetInteriorResponse>, SessionError> {
        let slot = self.slot((session.id(), object));
        let mut newest = slot.lock().await;
        // Between steps that wait for a client nothing is old enough: what they did is to be seen.
        if let Some((taken, interior)) = &*newest
            && session.phase() == Phase::Running
            && taken.elapsed() < FRESH
        {
            return Ok(Arc::clone(interior));
        }
        let interior = session.query(move |inspection| inspection.world.interior(object)).await?;
        let interior = Arc::new(message(interior, session.object_stats()[object].voxel_size_m));
        *newest = Some((Instant::now(), Arc::clone(&interior)));
        Ok(interior)
    }

    /// The place of an answer; those that are old and that nobody waits for are given up.
    fn slot(&self, of: (SessionId, usize)) -> Arc<Slot> {
        let mut slots = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_fresh = |slot: &Slot| {
            slot.try_lock().map_or(true, |newest| newest.as_ref().is_some_and(|(taken, _)| taken.elapsed() < FRESH))
        };
        slots.retain(|_, slot| Arc::strong_count(slot) > 1 || is_fresh(slot));
        Arc::clone(slots.entry(of).or_default())
    }
}

fn message(interior: Interior, voxel_size_m: f64) -> v1::GetInteriorResponse {
    v1::GetInteriorResponse {
        step: interior.step,
        topology_version: interior.topology_version,
        voxel_size_m,
        voxel_positions_m: interior.voxel_positions_m.into_flattened(),
        voxel_elements: interior.voxel_elements,
        element_energies_j_per_m3: interior.element_energies_j_per_m3,
        intact_links: interior.intact_links.into_flattened(),
        parted_links: interior.parted_links.into_flattened(),
    }
}
