//! Brings contact models up to date, with the step's own matrices and before anything parts.

use super::description::Description;
use super::scratch::Scratch;
use super::state::State;
use crate::workers::Workers;

/// What `tools` feel.
pub(super) fn update(
    workers: &Workers<'_>,
    tools: &[usize],
    description: &Description,
    state: &mut State,
    scratch: &mut Scratch,
) {
    for &index in tools {
        let Some(pose) = state.tools.get(index).and_then(|tool| tool.pose) else { continue };
        let (shape, model) = (&description.shapes[index], &mut scratch.models[index]);
        model.begin(index, &mut state.slots);
        for (body, slot) in state.slots.iter_mut().enumerate() {
            if slot.contacts[index].pressing().next().is_none() {
                continue;
            }
            let dt_s = slot.body.quasi_static_dt_s();
            let of_tissue = state.tissue.iter().flat_map(|tissue| tissue.point_springs(body, dt_s));
            slot.set_quasi_static_springs(of_tissue, dt_s);
            model.feel(workers, (body, &mut slot.body), (shape, &pose), slot.contacts[index].pressing());
        }
    }
}
