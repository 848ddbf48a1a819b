//! The end of a step: its energies, and what it reports.

use super::description::Description;
use super::scratch::Scratch;
use super::state::State;
use super::tool_contact::ToolContact;
use crate::ledger;
use crate::step_io::StepOutput;

/// Books the energies and counts the step.
pub(super) fn finish(description: &Description, state: &mut State, scratch: &mut Scratch, output: &mut StepOutput) {
    let contacts = state.slots.iter_mut().flat_map(|s| &mut s.contacts);
    scratch.ledger.front.lost_j += contacts.map(ToolContact::take_dropped_j).sum::<f64>();
    scratch.ledger.front.stored_j = state.slots.iter().map(|s| s.front_stored_j).sum();
    scratch.work.add_fracture(output.fracture.looks, output.fracture.parted_links);
    output.solve.work_units = scratch.work.done();
    let ledgers = state.slots.iter().map(|s| &s.ledger);
    state.energy = ledger::book(ledgers, &scratch.ledger, &state.energy, state.spring_stored_j);
    state.spring_stored_j = scratch.ledger.spring_stored_j;
    state.step += 1;
    read_tracked_points(description, state, output);
    output.energy = state.energy;
    output.topology_version = state.topology_version;
    output.step = state.step;
    output.sim_time_s = state.step as f64 * description.dt_s;
}

/// Where the points are that are followed.
pub(super) fn read_tracked_points(description: &Description, state: &State, output: &mut StepOutput) {
    for (tracked, out) in description.tracked_points.iter().zip(&mut output.tracked_displacement_m) {
        *out = state.slots[tracked.body].body.current_m(&tracked.point) - tracked.point.position_m;
    }
}
