//! Bodies at rest sleep: a step leaves them as they are.
//!
//! A body that was at rest for [`STILL_S`] is stopped. From then on a step would change nothing, and none is taken:
//! what presses on it presses on as it does. It wakes when a tool that moves comes to touch it or touches it, when
//! tissue that is awake comes to, and when its state or a tool in it is changed. Bodies that
//! press on each other fall asleep together.

use super::activity::Activity;
use super::body_slot::BodySlot;
use super::state::State;
use super::tissue_contact::TissueContacts;
use super::tool::Tool;
use super::tool_contact::ToolContact;
use crate::workers::Workers;

/// How long a body has to be at rest before it sleeps, s: ten times as long as the forces of a cut are sampled apart,
/// and long enough that what creeps towards rest gets nearer to it than the solver tells. No result hangs on it but
/// when a body falls asleep.
const STILL_S: f64 = 0.1;

impl BodySlot {
    pub(super) fn is_asleep(&self) -> bool {
        self.activity == Activity::Asleep
    }

    pub(super) fn wake(&mut self) {
        self.activity = Activity::Awake { still_steps: 0 };
    }

    /// Finds what the tools touch. Of a body that sleeps only those that move are asked, and wake it where they touch
    /// or let go.
    pub(super) fn detect_tools(&mut self, tools: &[Tool]) {
        let sleeps = self.is_asleep();
        let mut touched = false;
        for (tool, contact) in tools.iter().zip(&mut self.contacts) {
            if let Some(path) = tool.path().filter(|path| !(sleeps && path.rests())) {
                touched |= contact.has_springs();
                contact.detect(&self.body, &self.crack, &path);
                touched |= contact.has_springs();
            }
        }
        if sleeps && touched {
            self.rouse(tools);
        }
    }

    /// Wakes a body after the tools that move were asked what they touch.
    pub(super) fn rouse(&mut self, tools: &[Tool]) {
        self.wake();
        for (tool, contact) in tools.iter().zip(&mut self.contacts) {
            if let Some(path) = tool.path().filter(|path| path.rests()) {
                contact.detect(&self.body, &self.crack, &path);
            }
        }
    }

    /// Whether the step found and left the body at rest.
    fn is_still(&mut self, tools: &[Tool], tissue: Option<&TissueContacts>, index: usize, dt_s: f64) -> bool {
        let is_worked = |(tool, contact): (&Tool, &ToolContact)| {
            let moves = tool.path().is_some_and(|path| !path.rests());
            moves && contact.has_springs() || contact.cutting_length_m() > 0.0
        };
        if !self.scratch.parted.is_empty() || tools.iter().zip(&self.contacts).any(is_worked) {
            return false;
        }
        self.scratch.impulses.clear();
        let of_tools = self.contacts.iter().flat_map(ToolContact::acting);
        let cohesive = self.tension.iter().flat_map(|tension| &tension.cohesive.contacts);
        for contact in of_tools.chain(cohesive) {
            let impulse = contact.direction * (dt_s * contact.force_n);
            self.scratch.impulses.extend(contact.ends.weights.iter().map(|(node, w)| (node, (impulse * w).into())));
        }
        self.scratch.impulses.extend(tissue.iter().flat_map(|tissue| tissue.resting_impulses(index, dt_s)));
        self.body.is_at_rest(&self.scratch.impulses, self.applied_n_s, self.ledger.after.kinetic_j)
    }

    /// Stops the body; the ledger takes its kinetic energy for damped.
    fn fall_asleep(&mut self, workers: &Workers<'_>) {
        self.activity = Activity::Asleep;
        let kinetic_j = std::mem::take(&mut self.ledger.after.kinetic_j);
        self.ledger.solved.kinetic_j -= kinetic_j;
        self.ledger.braked_j += kinetic_j;
        self.body.halt(workers);
        self.velocity_change.fill([0.0; 3]);
        self.contacts.iter_mut().for_each(ToolContact::come_to_rest);
        let cohesive = self.tension.iter_mut().flat_map(|tension| &mut tension.cohesive.contacts);
        cohesive.for_each(|contact| contact.come_to_rest());
    }
}

/// Counts the steps that bodies have been at rest for; those that have been long enough fall asleep, with all that
/// they press on.
pub(super) fn let_sleep(workers: &Workers<'_>, dt_s: f64, state: &mut State) {
    let enough = (STILL_S / dt_s).ceil() as u32;
    for (index, slot) in state.slots.iter_mut().enumerate() {
        let Activity::Awake { still_steps } = slot.activity else { continue };
        let is_still = slot.is_still(&state.tools, state.tissue.as_ref(), index, dt_s);
        slot.activity = Activity::Awake { still_steps: if is_still { enough.min(still_steps + 1) } else { 0 } };
    }
    let ready = Activity::Awake { still_steps: enough };
    for island in 0..state.slots.len() {
        if state.slots[island].activity != ready || state.slots[island].scratch.island != island {
            continue;
        }
        let members = || state.slots.iter().filter(|slot| slot.scratch.island == island);
        if members().all(|slot| slot.activity == ready) {
            let members = state.slots.iter_mut().filter(|slot| slot.scratch.island == island);
            members.for_each(|slot| slot.fall_asleep(workers));
        }
    }
    state.tissue.iter_mut().for_each(|tissue| tissue.come_to_rest(&state.slots));
}
