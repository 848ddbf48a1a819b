//! What comes from outside between two steps: states that were set and poses of tools.

use super::description::Description;
use super::own_view::OwnView;
use super::scratch::Scratch;
use super::state::State;
use crate::ledger::ContactLedger;
use crate::step_io::{FractureStep, StepInputs, StepOutput, ToolMotion};
use crate::workers::Workers;

/// Takes states that were set from outside.
pub(super) fn take_edits(workers: &Workers<'_>, state: &mut State) {
    let mut cut = false;
    for slot in &mut state.slots {
        cut |= slot.take_edits(workers);
    }
    if cut {
        state.follow_tissue_anew();
    }
}

/// Begins a step with its inputs.
pub(super) fn apply(
    description: &Description,
    inputs: &StepInputs<'_>,
    state: &mut State,
    scratch: &mut Scratch,
    output: &mut StepOutput,
) {
    output.fault = None;
    output.fracture = FractureStep::default();
    scratch.ledger = ContactLedger::default();
    scratch.view.iter_mut().for_each(OwnView::begin_step);
    state.slots.iter_mut().for_each(|slot| slot.scratch.parted.clear());
    for tool in &mut state.tools {
        tool.before = tool.pose;
        tool.opening_before = tool.opening;
        tool.entered = false;
    }
    for input in inputs.tools {
        let Some(tool) = state.tools[..output.tools.len()].get_mut(input.tool) else { continue };
        match input.motion {
            ToolMotion::MoveTo { pose, opening } => tool.move_to(pose, opening),
            ToolMotion::EnterAt { pose, opening } => tool.enter_at(pose, opening),
            ToolMotion::Lift => description.parts_of(input.tool).for_each(|part| lift(part, state)),
        }
    }
    for (index, carried) in description.carried() {
        state.tools[index] = state.tools[carried.by].carrying(&carried.place);
    }
}

fn lift(tool: usize, state: &mut State) {
    state.tools[tool].pose = None;
    for slot in &mut state.slots {
        if slot.contacts[tool].has_springs() {
            slot.wake();
        }
        slot.contacts[tool].lift();
    }
}
