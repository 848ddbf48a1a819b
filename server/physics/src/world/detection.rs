//! What touches what in the step that begins.

use super::state::State;
use super::tool_contact::ToolContact;

/// What tools touch.
pub(super) fn tools(state: &mut State) {
    for slot in &mut state.slots {
        slot.detect_tools(&state.tools);
        if slot.tension.is_none() && slot.contacts.iter().any(ToolContact::holds) {
            slot.feel_pull();
        }
    }
}

/// The surfaces that meet. A body that sleeps wakes as one that is awake meets it, and with it what it presses on.
pub(super) fn tissue(dt_s: f64, state: &mut State) {
    let Some(tissue) = &mut state.tissue else { return };
    loop {
        tissue.detect(&state.slots, dt_s);
        if !tissue.rouse(&mut state.slots, &state.tools) {
            return;
        }
    }
}

/// What holds across cuts that tension opens.
pub(super) fn cohesive(dt_s: f64, state: &mut State) {
    state.awake().for_each(|slot| slot.detect_cohesive(dt_s));
}
