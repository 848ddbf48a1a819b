//! Steps that a session which stands is asked for: as fast as the machine takes them, with the inputs of the call.
//!
//! Nothing in them depends on the time that they take: no step is late, and the governor leaves them alone.

use kerf_physics::{StageClock, Workers};

use super::SessionCore;
use crate::error::SessionError;
use crate::inbox::StepAnswer;
use crate::status::Phase;
use crate::stepping::{StepInput, StepOutcome, Stepped, Steps};
use crate::view_message::SceneEvent;

/// Steps of one call that are still to be taken.
pub(super) struct OwedSteps {
    left: u32,
    /// Of the steps that are left, as far as there are.
    inputs: std::vec::IntoIter<StepInput>,
    /// Of the steps that were taken.
    outcomes: Vec<StepOutcome>,
    answer: StepAnswer,
}

impl SessionCore {
    /// Stands, and is to take steps all the same, after those that it owes already.
    pub(super) fn owe(&mut self, steps: Steps, answer: StepAnswer) {
        let limit = self.limits.max_commands;
        match &self.phase {
            Phase::Failed { message } => {
                let _ = answer.send(Err(SessionError::Failed { message: message.to_string() }));
                return;
            }
            _ if self.owed.len() >= limit => {
                let _ = answer.send(Err(SessionError::TooManyCommands { limit }));
                return;
            }
            Phase::Running => self.set_phase(Phase::Paused, SceneEvent::Paused),
            // As on a resume.
            Phase::Paused if self.owed.is_empty() => self.inbox.tools_stood(),
            Phase::Paused | Phase::Closing => {}
        }
        let Steps { count, inputs } = steps;
        self.owed.push_back(OwedSteps { left: count, inputs: inputs.into_iter(), outcomes: Vec::new(), answer });
    }

    /// What was asked for is not done any more.
    pub(super) fn forget_owed(&mut self) {
        for owed in self.owed.drain(..) {
            let _ = owed.answer.send(Err(SessionError::StepsEnded { taken: owed.outcomes.len() }));
        }
    }

    /// One of the steps that are owed, unless nobody waits for it any more. Viewers see the last one of a call.
    pub(super) fn step_while_standing(&mut self, now_ns: u64, workers: &Workers<'_>, clock: &dyn StageClock) {
        let Some(mut owed) = self.owed.pop_front().filter(|owed| !owed.answer.is_closed()) else { return };
        if let Err(error) = self.take_inputs(&mut owed) {
            let _ = owed.answer.send(Err(error));
            return;
        }
        owed.left -= 1;
        if owed.left == 0 {
            self.views.hasten_state();
        }
        // Leases are kept while a session stands, whether it is stepped or not.
        self.inbox.renew_leases(now_ns);
        self.take_step(now_ns, workers, clock);
        owed.outcomes.push(self.outcome());
        match owed.left {
            0 => self.answer(owed),
            _ => self.owed.push_front(owed),
        }
    }

    /// Moves tools as the next step has them; before the first one all inputs are looked at.
    fn take_inputs(&self, owed: &mut OwedSteps) -> Result<(), SessionError> {
        let dt_s = self.dt_s();
        if owed.outcomes.is_empty() {
            self.inbox.check_inputs(owed.inputs.as_slice(), dt_s)?;
        }
        match owed.inputs.next() {
            Some(input) => self.inbox.follow(owed.outcomes.len(), &input, dt_s),
            None => Ok(()),
        }
    }

    fn outcome(&self) -> StepOutcome {
        let output = self.world.output();
        StepOutcome {
            step: output.step,
            sim_time_s: output.sim_time_s,
            tools: output.tools.clone(),
            waits: self.waits.clone(),
            energy: self.tally.energy,
            tracked_displacement_m: output.tracked_displacement_m.clone(),
        }
    }

    fn answer(&self, owed: OwedSteps) {
        let topology_version = self.world.output().topology_version;
        let stepped = Stepped { outcomes: owed.outcomes, topology_version, state_hash: self.world.state_hash() };
        let _ = owed.answer.send(Ok(stepped));
    }
}
