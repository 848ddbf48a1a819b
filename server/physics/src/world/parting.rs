//! Cuts go on, links part, and what they held together is taken apart.

use super::scratch::Scratch;
use super::state::State;
use crate::body::{PartedLinks, TopologyChange};
use crate::fracture::{FrontBook, is_drive_due};
use crate::grow::grow;
use crate::step_io::StepOutput;
use crate::workers::Workers;

/// Fronts of blades go on, and cuts under tension; which links that crosses is found, none is parted yet.
pub(super) fn advance_fronts(dt_s: f64, state: &mut State, scratch: &mut Scratch, output: &mut StepOutput) {
    let is_due = is_drive_due(state.step, dt_s);
    for slot in state.slots.iter_mut().filter(|slot| !slot.is_asleep()) {
        let mut book = FrontBook::default();
        for (tool, contact) in state.tools.iter().zip(&mut slot.contacts) {
            if let Some(path) = tool.path() {
                book.add(&contact.advance(
                    (&slot.body, &mut slot.crack),
                    &path,
                    slot.tension.is_some(),
                    &mut slot.scratch.parting,
                ));
                if is_due {
                    contact.sample_drive(&slot.body);
                }
            }
        }
        if let Some(tension) = &mut slot.tension {
            let (of_tension, looks) = tension.advance((&slot.body, &mut slot.crack), &book, &mut slot.scratch.parting);
            book.add(&of_tension);
            output.fracture.looks += looks;
        }
        slot.front_stored_j = book.stored_j;
        scratch.ledger.front.add(&book);
    }
    output.fracture.cut_area_m2 = scratch.ledger.front.area_m2;
}

/// Parts, nodes, matrices and surfaces where links part.
pub(super) fn update_topology(workers: &Workers<'_>, state: &mut State, output: &mut StepOutput) {
    for slot in &mut state.slots {
        let PartedLinks { parted, spared } = slot.body.part_links(&slot.scratch.parting);
        slot.scratch.parted = parted;
        output.fracture.spared_links += spared as u32;
        slot.scratch.parting.clear();
        slot.scratch.change = TopologyChange::default();
        if slot.scratch.parted.is_empty() {
            continue;
        }
        slot.scratch.change = slot.body.update_topology(workers, &slot.scratch.parted);
        grow(&mut slot.velocity_change, slot.body.node_count(), [0.0; 3]);
        slot.ledger.after = slot.body.energy();
        let (parted, change) = (&slot.scratch.parted, &slot.scratch.change);
        slot.tension.iter_mut().for_each(|tension| tension.follow(&slot.body, parted, change));
        output.fracture.parted_links += parted.len() as u32;
    }
    if output.fracture.parted_links > 0 {
        state.topology_version += 1;
        state.follow_tissue();
    }
}
