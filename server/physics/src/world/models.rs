//! Makes the contact models that are asked for, with the step's own matrices and before anything parts.

use super::body_slot::BodySlot;
use super::contact_model::{Placed, ToolModel, presses};
use super::description::Description;
use super::scratch::Scratch;
use super::state::State;
use crate::workers::Workers;

/// Asks for a model of what each of these tools feels.
pub(super) fn ask(tools: &[usize], scratch: &mut Scratch) {
    for tool in tools {
        scratch.models.get_mut(*tool).into_iter().for_each(ToolModel::ask);
    }
}

/// Goes on with the models that are asked for, as far as the step's work allows.
pub(super) fn go_on(workers: &Workers<'_>, description: &Description, state: &mut State, scratch: &mut Scratch) {
    let State { slots, tools, tissue, .. } = state;
    let Scratch { models, work, .. } = scratch;
    for (index, model) in models.iter_mut().enumerate().filter(|(_, model)| model.is_asked()) {
        // Before it touches: the step in which it does allocates nothing.
        model.fit(description.parts_of(index), slots);
        let parts = || {
            let placed = |part| Some(Placed { part, shape: &description.parts[part].shape, pose: tools[part].pose? });
            description.parts_of(index).filter_map(placed)
        };
        let Some(pose) = tools[index].pose.filter(|_| slots.iter().any(|slot| presses(slot, parts()))) else {
            model.forget();
            continue;
        };
        if work.is_spent() && model.waits() {
            continue;
        }
        let load = |body: usize, slot: &mut BodySlot| {
            let dt_s = slot.body.quasi_static_dt_s();
            slot.set_quasi_static_springs(tissue.iter().flat_map(|tissue| tissue.point_springs(body, dt_s)), dt_s);
        };
        model.go_on(workers, (&pose, parts), slots, work, load);
    }
}
