//! How many sessions a token has, those among them that are being built.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use kerf_session::Registry;

use crate::security::caller::Caller;
use crate::status::RequestError;

/// Sessions of tokens that are being built, by the name of the token.
type Building = Mutex<HashMap<String, usize>>;

/// Counts the sessions of each token.
#[derive(Clone)]
pub struct Owned {
    max: usize,
    building: Arc<Building>,
}

impl Owned {
    /// As many as `max` of a token.
    pub fn new(max: usize) -> Self {
        Self { max, building: Arc::default() }
    }

    /// A place for a session that is built, unless the caller has as many as it may. Nobody's are not counted.
    pub fn take(&self, registry: &Registry, caller: &Caller) -> Result<Option<Place>, RequestError> {
        let Some(name) = caller.name() else { return Ok(None) };
        let mut building = lock(&self.building);
        let is_own = |session: &Arc<kerf_session::Session>| session.owner().is_some_and(|owner| owner.name == name);
        let built = registry.list().iter().filter(|session| is_own(session)).count();
        if built + building.get(name).copied().unwrap_or_default() >= self.max {
            return Err(RequestError::TooManySessionsOfToken { name: name.into(), limit: self.max });
        }
        *building.entry(name.into()).or_default() += 1;
        Ok(Some(Place { name: name.into(), building: Arc::clone(&self.building) }))
    }
}

fn lock(building: &Building) -> MutexGuard<'_, HashMap<String, usize>> {
    building.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The place of a session while it is built.
pub struct Place {
    name: String,
    building: Arc<Building>,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut building = lock(&self.building);
        if let Some(count) = building.get_mut(&self.name) {
            *count -= 1;
        }
        building.retain(|_, count| *count > 0);
    }
}
