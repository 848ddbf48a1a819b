//! A world's state between two steps, to go back to.

use super::World;
use super::body_slot::BodySlot;
use super::contact_model::ToolModel;
use super::tissue_contact::TissueContacts;
use super::tool::Tool;
use crate::ledger::ContactLedger;
use crate::step_io::StepOutput;

/// The state of a world as a step left it: [`World::snapshot`].
///
/// Deliberately absent: the surface, which follows from the state; what a body is made of, which never changes and which
/// the worlds share; and the room that a step works in. The solver's matrices are kept, for they follow the state with a
/// lag: made anew they would lead on to other bits.
pub struct Snapshot {
    slots: Vec<BodySlot>,
    tools: Vec<Tool>,
    tissue: Option<TissueContacts>,
    contact_ledger: ContactLedger,
    springs_before_j: f64,
    output: StepOutput,
}

impl Snapshot {
    /// Steps taken when it was made.
    #[must_use]
    pub fn step(&self) -> u64 {
        self.output.step
    }
}

impl World {
    /// A copy of the state, tools and their contacts included.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            slots: self.slots.iter().map(BodySlot::kept).collect(),
            tools: self.tools.clone(),
            tissue: self.tissue.clone(),
            contact_ledger: self.contact_ledger,
            springs_before_j: self.springs_before_j,
            output: self.output.clone(),
        }
    }

    /// Goes back to a snapshot of this world, or of one of the same scene: the same inputs lead on to the
    /// same bits. The surface is forgotten.
    pub fn restore(&mut self, snapshot: &Snapshot) {
        self.slots = snapshot.slots.iter().map(BodySlot::kept).collect();
        self.tissue.clone_from(&snapshot.tissue);
        // A copy has room for what it holds and no more.
        self.tissue.iter_mut().for_each(|tissue| tissue.reserve(&self.slots));
        let springs = self.tissue.as_ref().map_or(0, TissueContacts::most_springs);
        self.slots.iter_mut().for_each(|slot| slot.reserve(springs));
        self.tools.clone_from(&snapshot.tools);
        self.contact_ledger = snapshot.contact_ledger;
        self.springs_before_j = snapshot.springs_before_j;
        self.models.iter_mut().for_each(|model| *model = ToolModel::default());
        self.output.clone_from(&snapshot.output);
        self.forget_surface();
    }
}
