//! The step that the solve leads to: new positions, and forces and energies there.

use super::state::State;
use crate::fault::{Fault, FaultKind};
use crate::ledger::BodyLedger;
use crate::step_io::StepOutput;
use crate::workers::Workers;

/// New velocities and positions.
pub(super) fn integrate(workers: &Workers<'_>, state: &mut State) {
    for slot in state.awake() {
        slot.ledger.load_work_j = slot.body.integrate(workers, &slot.velocity_change);
    }
}

/// Rotations, forces and energies where the step has led to. What is not finite by now, positions included, is
/// found here and rolled back: nobody has seen it yet.
pub(super) fn evaluate(workers: &Workers<'_>, state: &mut State, output: &mut StepOutput) {
    let mut rolled_back = false;
    for slot in &mut state.slots {
        if slot.is_asleep() {
            slot.ledger = BodyLedger::at_rest(slot.ledger.after);
            continue;
        }
        slot.front_stored_j = 0.0;
        slot.ledger.before = slot.ledger.after;
        slot.ledger.step = slot.body.evaluate_step(workers, &slot.velocity_change);
        slot.ledger.turned_j = slot.body.turn_velocities(workers);
        slot.ledger.solved = slot.body.energy();
        slot.ledger.after = slot.ledger.solved;
        if slot.body.save_finite_state(workers) {
            continue;
        }
        slot.roll_back(workers);
        rolled_back = true;
        // Of several bodies the first is reported: the others may have failed for it.
        let object = &slot.body.description.name;
        let fault = || Fault { step: state.step, object: object.clone(), what: FaultKind::NodeState };
        output.fault.get_or_insert_with(fault);
    }
    if rolled_back {
        // What pressed on it, or it pressed on, finds nothing to go on from.
        state.tissue.iter_mut().for_each(|tissue| tissue.release(&state.slots));
    }
}
