//! What a step has lost is taken back before anybody has seen it.

use super::body_slot::BodySlot;
use super::state::State;
use crate::fault::Fault;
use crate::step_io::StepOutput;
use crate::workers::Workers;

/// What is not finite by now, positions included, or has energy from nowhere, goes back piece by piece. What pressed on
/// it, or it pressed on, finds nothing to go on from. All else is remembered to go back to.
pub(super) fn take_back_lost(workers: &Workers<'_>, state: &mut State, output: &mut StepOutput) {
    let available_j = state.available_j();
    for index in 0..state.slots.len() {
        let slot = &mut state.slots[index];
        if slot.is_asleep() {
            continue;
        }
        if let Some(lost) = slot.body.find_lost(available_j) {
            slot.roll_back(workers, &lost);
            state.tissue.iter_mut().for_each(|tissue| tissue.release(&state.slots, index, &lost));
            // Of several bodies the first is reported: the others may have failed for it.
            let object = &state.slots[index].body.description.name;
            output.fault.get_or_insert_with(|| Fault { step: state.step, object: object.clone(), what: lost.what });
        }
        state.slots[index].body.save_state(workers);
    }
}

impl State {
    /// Energy that there was in the scene before the step, with what tools and loads did in it, J.
    fn available_j(&self) -> f64 {
        let of_slot =
            |slot: &BodySlot| slot.ledger.before.total_j() + slot.tool_work_j().abs() + slot.ledger.load_work_j.abs();
        self.slots.iter().map(of_slot).sum::<f64>() + self.energy.contact_j
    }
}
