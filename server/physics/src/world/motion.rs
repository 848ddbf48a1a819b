//! The step that the solve leads to: new positions, and forces and energies there.

use super::brake;
use super::state::State;
use crate::ledger::BodyLedger;
use crate::workers::Workers;

/// New velocities and positions.
pub(super) fn integrate(workers: &Workers<'_>, state: &mut State) {
    for slot in state.awake() {
        slot.ledger.load_work_j = slot.body.integrate(workers, &slot.velocity_change);
    }
}

/// Rotations, forces and energies where the step has led to.
pub(super) fn evaluate(workers: &Workers<'_>, dt_s: f64, state: &mut State) {
    for slot in &mut state.slots {
        if slot.is_asleep() {
            slot.ledger = BodyLedger::at_rest(slot.ledger.after);
            continue;
        }
        slot.front_stored_j = 0.0;
        slot.ledger.before = slot.ledger.after;
    }
    evaluate_step(workers, state);
    brake::overshoots(workers, dt_s, state);
    for slot in state.awake() {
        slot.ledger.turned_j = slot.body.turn_velocities(workers);
        slot.ledger.solved = slot.body.energy();
        slot.ledger.after = slot.ledger.solved;
    }
}

pub(super) fn evaluate_step(workers: &Workers<'_>, state: &mut State) {
    for slot in state.awake() {
        slot.ledger.step = slot.body.evaluate_step(workers, &slot.velocity_change);
    }
}
