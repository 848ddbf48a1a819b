//! What a step changes of a world and the next one goes on from.

use super::body_slot::BodySlot;
use super::tissue_contact::TissueContacts;
use super::tool::Tool;
use crate::body::Body;
use crate::step_io::EnergyStep;

/// The state of a scene between two steps. The same state and the same inputs lead on to the same bits. A copy leaves
/// out the room that a step works in; [`State::reserve`] makes it anew.
#[derive(Clone)]
pub(super) struct State {
    /// Steps taken.
    pub(super) step: u64,
    /// Changes of the structure since the scene was at rest.
    pub(super) topology_version: u64,
    pub(super) slots: Vec<BodySlot>,
    pub(super) tools: Vec<Tool>,
    /// Present from when tissue may meet tissue: in scenes of several objects, and after the first cut.
    pub(super) tissue: Option<TissueContacts>,
    /// What the last step booked: the next one's begins with its levels.
    pub(super) energy: EnergyStep,
    /// Energy in springs that are no front's at the end of the last step, J.
    pub(super) spring_stored_j: f64,
}

impl State {
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
