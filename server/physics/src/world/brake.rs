//! Free parts and flaps that would turn too far in a step are braked; the ledger books the work of the brake.

use super::body_slot::BodySlot;
use super::state::State;
use crate::body::Nodal;
use crate::contact::Contact;

/// Brakes what turns too fast, between the solve and the step that it is for.
///
/// The solve balances momentum, `M dv + S (v + dv) = f`. With `d` taken from dv this wants the impulse
/// `(M + S) d` of the brake, which takes its product with the motion that is left. Contacts keep the force of
/// the solve over the motion of the solve: what they did along `d` reached no tissue and is the brake's too. What keeps
/// the momentum of free parts does its work over the motion that is left.
pub(super) fn spins(dt_s: f64, state: &mut State) {
    state.slots.iter_mut().for_each(|slot| slot.ledger.braked_j = 0.0);
    if !state.slots.iter().any(may_turn_too_far) {
        return;
    }
    let taken: Vec<Nodal> = state.slots.iter_mut().map(brake).collect();
    if taken.iter().flatten().flatten().all(|d| *d == 0.0) {
        return;
    }
    for (slot, taken) in state.slots.iter_mut().zip(&taken) {
        let elements = 0..slot.body.base().elements.len();
        let kept = slot.body.impulse_work_j(elements, &slot.velocity_change, |node| taken[node].into());
        let impulse = |c: &Contact| c.applied_n().dot(&c.ends.weights.sum(taken)) * dt_s;
        let acting = slot.contacts.iter().flat_map(|contact| contact.acting());
        let cohesive = slot.pulled.iter().flat_map(|pulled| &pulled.cohesive.contacts).filter(|c| c.force_n != 0.0);
        slot.ledger.momentum_j = slot.body.missing_motion_work_j(&slot.velocity_change);
        slot.ledger.braked_j = kept + acting.chain(cohesive).map(impulse).sum::<f64>();
    }
    for spring in state.tissue.iter().flat_map(|tissue| tissue.springs()).filter(|s| s.force_n != 0.0) {
        let along = spring.ends.relative(|body| &taken[body as usize]);
        state.slots[spring.ends.ends[0].body as usize].ledger.braked_j += dt_s * spring.applied_n().dot(&along);
    }
}

fn may_turn_too_far(slot: &BodySlot) -> bool {
    let dv = &slot.velocity_change;
    !slot.is_asleep() && (slot.body.may_spin_too_fast(dv) || slot.body.may_throw_flaps(dv))
}

/// Returns by how much each node is slower, m/s.
fn brake(slot: &mut BodySlot) -> Nodal {
    let mut taken = vec![[0.0; 3]; slot.body.node_count()];
    if !slot.is_asleep() {
        slot.body.brake_spin(&mut slot.velocity_change, &mut taken);
        slot.body.brake_flaps(&mut slot.velocity_change, &mut taken);
    }
    taken
}
