//! What tools feel of the forces that the solver applied.

use super::contact_model::{self, ContactSum};
use super::description::Description;
use super::scratch::Scratch;
use super::state::State;
use crate::Vec3;
use crate::step_io::{Grasp, StepOutput};

/// Wrenches from the forces the solver applied, models about them; tool work and the springs' energies with them.
pub(super) fn write(description: &Description, state: &mut State, scratch: &mut Scratch, output: &mut StepOutput) {
    for index in 0..output.tools.len() {
        write_of_tool(index, description, state, scratch, output);
    }
    if let Some(tissue) = &mut state.tissue {
        tissue.conclude(&mut scratch.ledger, description.dt_s);
    }
}

fn write_of_tool(
    index: usize,
    description: &Description,
    state: &State,
    scratch: &mut Scratch,
    output: &mut StepOutput,
) {
    let (tool, dt_s) = (&state.tools[index], description.dt_s);
    let of_part = |part: usize| state.slots.iter().map(move |slot| &slot.contacts[part]);
    let contacts = || description.parts_of(index).flat_map(of_part);
    let mut sum = tool.pose.map(ContactSum::new);
    for part in description.parts_of(index) {
        for contact in of_part(part) {
            scratch.ledger.tool_work_j += contact.work_j();
            contact.acting().for_each(|c| sum.iter_mut().for_each(|sum| sum.push(c)));
            if let Some(sum) = &mut sum {
                sum.bound(&description.parts[part].shape, contact.pressing());
            }
            contact.beside_fronts().for_each(|c| scratch.ledger.add(c, dt_s));
        }
    }
    let output = &mut output.tools[index];
    (output.pose, output.opening) = (tool.pose, tool.opening);
    output.wrench = sum.as_ref().map(ContactSum::wrench).unwrap_or_default();
    output.touches = sum.as_ref().is_some_and(|sum| sum.touches);
    let model = &mut scratch.models[index];
    if !output.touches {
        model.forget();
    }
    let about = sum.zip(tool.path()).zip(model.felt.as_ref());
    output.contact = about.map(|((sum, path), felt)| {
        let give = contact_model::give(|| contacts().flat_map(|contact| contact.pressing()));
        sum.model(&path, dt_s, felt, give)
    });
    output.cutting_length_m = contacts().map(|contact| contact.cutting_length_m()).sum();
    let holds = contacts().any(|contact| contact.holds());
    output.grasp = if holds { Grasp::Holding } else { Grasp::Nothing };
}

/// What is held with more force than a grasper has slips out of it, all at once. What presses on its handle does not count.
pub(super) fn slip(description: &Description, state: &mut State, output: &mut StepOutput) {
    for (index, (part, output)) in description.parts.iter().zip(&mut output.tools).enumerate() {
        let acting = || state.slots.iter().flat_map(|slot| slot.contacts[index].acting());
        let held_n = || acting().fold(Vec3::zeros(), |sum, contact| sum + contact.applied_n());
        if output.grasp == Grasp::Holding && held_n().norm() > part.shape.max_hold_n() {
            state.slots.iter_mut().for_each(|slot| slot.contacts[index].lift());
            output.grasp = Grasp::Slipped;
        }
    }
}
