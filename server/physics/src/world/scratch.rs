//! What a world works with and derives from its state, made anew whenever it is gone.

use super::contact_model::ToolModel;
use super::own_view::OwnView;
use crate::ledger::ContactLedger;
use crate::work::WorkMeter;

/// Nothing that a step does to the state depends on what the step before left here.
#[derive(Default)]
pub(super) struct Scratch {
    /// Present from when the surface is first asked for until it is forgotten: nobody watches,
    /// nothing is contoured.
    pub(super) view: Option<OwnView>,
    /// By tool.
    pub(super) models: Vec<ToolModel>,
    /// Of the step that is being taken.
    pub(super) work: WorkMeter,
    /// What contact adds to the energies of the step that is being taken.
    pub(super) ledger: ContactLedger,
}
