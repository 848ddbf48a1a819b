//! What a step changes of a world and the next one goes on from.

use super::body_slot::BodySlot;
use super::tissue_contact::TissueContacts;
use super::tool::Tool;
use crate::body::Body;
use crate::step_io::EnergyStep;
use crate::walk::WalkError;
use crate::workers::Workers;
use serde::{Deserialize, Serialize};

/// The state of a scene between two steps. The same state and the same inputs lead on to the same bits. A copy leaves
/// out the room that a step works in; [`State::reserve`] makes it anew.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct State {
    /// Steps taken.
    pub(super) step: u64,
    /// Changes of the structure since the scene was at rest.
    pub(super) topology_version: u64,
    pub(super) slots: Vec<BodySlot>,
    /// By part: the tools, and after them what they carry.
    pub(super) tools: Vec<Tool>,
    /// Present from when tissue may meet tissue: in scenes of several objects, and after the first cut.
    pub(super) tissue: Option<TissueContacts>,
    /// What the last step booked: the next one's begins with its levels.
    pub(super) energy: EnergyStep,
    /// Energy in springs that are no front's at the end of the last step, J.
    pub(super) spring_stored_j: f64,
}

impl State {
    /// Completes a state that was read from a file by what never changes of one like it: of the same scene.
    ///
    /// # Errors
    /// What was read does not fit together, or not to the scene.
    pub(super) fn complete(&mut self, like: &Self, workers: &Workers<'_>) -> Result<(), WalkError> {
        let counts = |state: &Self| [state.slots.len(), state.tools.len()];
        if counts(self) != counts(like) {
            return Err(WalkError::new("its objects and tools are not the scene's".into()));
        }
        for (index, (slot, like)) in self.slots.iter_mut().zip(&like.slots).enumerate() {
            let completed = slot.complete(like, workers);
            completed.map_err(|error| WalkError::new(format!("objects[{index}]: {error}")))?;
        }
        if self.tissue.as_ref().is_some_and(|tissue| !tissue.fits(&self.slots)) {
            return Err(WalkError::new("contact of tissue is not between the surfaces".into()));
        }
        Ok(())
    }

    /// The bodies of which a step is taken.
    pub(super) fn awake(&mut self) -> impl Iterator<Item = &mut BodySlot> {
        self.slots.iter_mut().filter(|slot| !slot.is_asleep())
    }

    pub(super) fn bodies(&self) -> impl ExactSizeIterator<Item = &Body> {
        self.slots.iter().map(|slot| &slot.body)
    }

    /// Takes surfaces that were set from outside to the contact of tissue with tissue, where there may be any.
    pub(super) fn follow_tissue_anew(&mut self) {
        match &mut self.tissue {
            Some(tissue) => tissue.follow_anew(&self.slots),
            None => self.tissue = Some(TissueContacts::new(&self.slots)),
        }
        self.reserve_slots();
    }

    /// Takes what the parting of links changed in the surfaces to the contact of tissue with tissue.
    pub(super) fn follow_tissue(&mut self) {
        match &mut self.tissue {
            Some(tissue) => tissue.follow(&self.slots),
            None => self.tissue = Some(TissueContacts::new(&self.slots)),
        }
        self.reserve_slots();
    }

    /// Room for the steps until links part again: they allocate nothing.
    pub(super) fn reserve(&mut self) {
        self.tissue.iter_mut().for_each(|tissue| tissue.reserve(&self.slots));
        self.reserve_slots();
    }

    fn reserve_slots(&mut self) {
        let springs = self.tissue.as_ref().map_or(0, TissueContacts::most_springs);
        self.slots.iter_mut().for_each(|slot| slot.reserve(springs));
    }
}
