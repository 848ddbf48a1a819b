//! What a step would turn too far is braked: free parts and flaps. The ledger books the work of the brake.

use super::body_slot::BodySlot;
use super::state::State;
use crate::contact::Contact;

/// Brakes what turns too fast, between the solve and the step that it is for.
pub(super) fn spins(dt_s: f64, state: &mut State) {
    for slot in &mut state.slots {
        slot.ledger.braked_j = 0.0;
        slot.scratch.taken_m_per_s.clear();
    }
    if state.slots.iter().any(may_turn_too_far) {
        state.awake().for_each(brake);
        book(dt_s, state);
    }
}

fn may_turn_too_far(slot: &BodySlot) -> bool {
    let dv = &slot.velocity_change;
    !slot.is_asleep() && (slot.body.may_spin_too_fast(dv) || slot.body.may_throw_flaps(dv))
}

fn brake(slot: &mut BodySlot) {
    let taken = &mut slot.scratch.taken_m_per_s;
    taken.resize(slot.body.node_count(), [0.0; 3]);
    slot.body.brake_spin(&mut slot.velocity_change, taken);
    slot.body.brake_flaps(&mut slot.velocity_change, taken);
}

/// Books the work of all that was taken, where the step begins.
///
/// The solve balances momentum, `M dv + S (v + dv) = f`. With `d` taken from dv this wants the impulse
/// `(M + S) d` of the brake, which takes its product with the motion that is left. Contacts keep the force of
/// the solve over the motion of the solve: what they did along `d` reached no tissue and is the brake's too. What keeps
/// the momentum of free parts does its work over the motion that is left.
pub(super) fn book(dt_s: f64, state: &mut State) {
    for slot in state.slots.iter_mut().filter(|slot| !slot.scratch.taken_m_per_s.is_empty()) {
        let taken = &slot.scratch.taken_m_per_s;
        let elements = 0..slot.body.base().elements.len();
        let velocity = |node| slot.body.velocity_after(node, &slot.velocity_change);
        let kept = slot.body.impulse_work_j(elements, velocity, |node| taken[node].into());
        let impulse = |c: &Contact| c.applied_n().dot(&c.ends.weights.sum(taken)) * dt_s;
        let acting = slot.contacts.iter().flat_map(|contact| contact.acting());
        let cohesive = slot.tension.iter().flat_map(|tension| &tension.cohesive.contacts).filter(|c| c.force_n != 0.0);
        slot.ledger.momentum_j = slot.body.missing_motion_work_j(&slot.velocity_change);
        slot.ledger.braked_j = kept + acting.chain(cohesive).map(impulse).sum::<f64>();
    }
    for spring in state.tissue.iter().flat_map(|tissue| tissue.springs()).filter(|s| s.force_n != 0.0) {
        for end in &spring.ends.ends {
            let slot = &mut state.slots[end.body as usize];
            if !slot.scratch.taken_m_per_s.is_empty() {
                let along = end.weights.sum(&slot.scratch.taken_m_per_s);
                slot.ledger.braked_j += dt_s * spring.applied_n().dot(&along);
            }
        }
    }
}
