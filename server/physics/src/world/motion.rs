//! The step that the solve leads to: new positions, and forces and energies there. Pieces that it would lead uphill are
//! braked.

use super::body_slot::BodySlot;
use super::brake;
use super::state::State;
use crate::ledger::BodyLedger;
use crate::workers::Workers;

/// The motion of a piece that a step leads uphill is halved at most so many times. Ours: one is enough nearly always, and
/// what is left is a thousandth of it.
const MOST_HALVINGS: u32 = 10;
/// Halvings after which the motion as the brakes have left it counts as one that leads uphill however short it is. With 1
/// chips that are strained severalfold, and braked from many turns a step, take longer to spring back.
const WHOLE_AFTER: u32 = 5;

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
    brake_overshoots(workers, dt_s, state);
    for slot in state.awake() {
        slot.ledger.turned_j = slot.body.turn_velocities(workers);
        slot.ledger.solved = slot.body.energy();
        slot.ledger.after = slot.ledger.solved;
    }
}

fn evaluate_step(workers: &Workers<'_>, state: &mut State) {
    for slot in state.awake() {
        slot.ledger.step = slot.body.evaluate_step(workers, &slot.velocity_change);
    }
}

/// Takes a step that has led pieces uphill back, and half of their motion from it, until it leads none uphill; see
/// [`crate::body::Body::find_overshot`]. Where a small share of the motion leads uphill too, the brakes have
/// bent it: see [`crate::body::Body::brake_as_a_whole`].
fn brake_overshoots(workers: &Workers<'_>, dt_s: f64, state: &mut State) {
    for halving in 0..MOST_HALVINGS {
        // Nearly always empty, and then without memory of its own.
        let overshot: Vec<(usize, Vec<bool>)> = state.slots.iter().enumerate().filter_map(overshot).collect();
        if overshot.is_empty() {
            return;
        }
        state.awake().for_each(|slot| slot.body.take_back_step(workers, &slot.velocity_change));
        for (index, parts) in overshot {
            let slot = &mut state.slots[index];
            let taken = &mut slot.scratch.taken_m_per_s;
            taken.resize(slot.body.node_count(), [0.0; 3]);
            let dv = &mut slot.velocity_change;
            match halving {
                WHOLE_AFTER => slot.body.brake_as_a_whole(&parts, dv, taken),
                _ => slot.body.halve_motion(&parts, dv, taken),
            }
        }
        brake::book(dt_s, state);
        integrate(workers, state);
        evaluate_step(workers, state);
    }
}

fn overshot((index, slot): (usize, &BodySlot)) -> Option<(usize, Vec<bool>)> {
    let parts = if slot.is_asleep() { None } else { slot.body.find_overshot(&slot.scratch.taken_m_per_s) };
    parts.map(|parts| (index, parts))
}
