//! Steps that a call asks for, and what they led to.

use kerf_proto::v1;
use kerf_proto::v1::tool_motion::Motion;
use kerf_session::PoseLimits;
use kerf_session::stepping::{StepInput, StepMotion, StepOutcome, Stepped, Steps};

use super::contact::{felt, pose_sample};
use super::scene::energy_ledger;
use super::vec3;
use crate::status::RequestError;

/// Most steps of one call: a second at 1 kHz.
const MAX_STEPS: u32 = 1000;

/// Most steps of all sessions in one call: their outcomes stay far below what a message may hold.
const MAX_STEPS_TOGETHER: u32 = 10_000;

/// Refuses a call for many sessions that asks for nothing, or for too much.
pub fn check_steps_together(sessions: &[v1::StepSessionRequest]) -> Result<(), RequestError> {
    let steps = sessions.iter().fold(0, |sum: u32, of_one| sum.saturating_add(of_one.steps));
    match steps {
        _ if sessions.is_empty() => Err(RequestError::Missing { field: "sessions" }),
        0..=MAX_STEPS_TOGETHER => Ok(()),
        _ => Err(RequestError::StepsTogether { steps, limit: MAX_STEPS_TOGETHER }),
    }
}

/// What a call asks for, of tools as the wire states them.
pub fn steps(request: &v1::StepSessionRequest, limits: &PoseLimits) -> Result<Steps, RequestError> {
    let count = request.steps;
    if !(1..=MAX_STEPS).contains(&count) {
        return Err(RequestError::Steps { steps: count, limit: MAX_STEPS });
    }
    if request.inputs.len() > count as usize {
        return Err(RequestError::TooManyInputs { inputs: request.inputs.len(), steps: count });
    }
    let inputs = request.inputs.iter().enumerate().map(|(index, input)| step_input(index, input, limits));
    Ok(Steps { count, inputs: inputs.collect::<Result<_, _>>()? })
}

fn step_input(index: usize, input: &v1::StepInput, limits: &PoseLimits) -> Result<StepInput, RequestError> {
    let motion = |(place, motion): (usize, &v1::ToolMotion)| {
        let refuse = |path, limit| RequestError::Motion { input: index, motion: place, path, limit };
        match &motion.motion {
            Some(Motion::Pose(pose)) => {
                let sample = pose_sample(pose, limits);
                let to = sample.map_err(|refusal| refuse(format!(".pose.{}", refusal.field()), refusal.limit()))?;
                Ok(StepMotion { tool: pose.tool_id as usize, to: Some(to) })
            }
            Some(Motion::Lift(lift)) => Ok(StepMotion { tool: lift.tool_id as usize, to: None }),
            None => Err(refuse(".motion".into(), "is required".into())),
        }
    };
    input.motions.iter().enumerate().map(motion).collect()
}

/// The answer to a call whose steps are taken. The last step alone comes with contact models: only from there on are
/// they of use.
pub fn step_response(stepped: &Stepped) -> v1::StepSessionResponse {
    let mut outcomes: Vec<_> = stepped.outcomes.iter().map(outcome).collect();
    if let Some((_, earlier)) = outcomes.split_last_mut() {
        earlier.iter_mut().flat_map(|outcome| &mut outcome.contacts).for_each(|contact| contact.model = None);
    }
    v1::StepSessionResponse {
        step: stepped.outcomes.last().map_or(0, |outcome| outcome.step),
        outcomes,
        topology_version: stepped.topology_version,
        state_hash: stepped.state_hash,
    }
}

fn outcome(outcome: &StepOutcome) -> v1::StepOutcome {
    let StepOutcome { step, sim_time_s, .. } = *outcome;
    let tools = outcome.tools.iter().zip(outcome.waits.iter().copied()).enumerate();
    let contact = |(tool, of_tool)| felt((step, sim_time_s), tool, of_tool, 0.0);
    v1::StepOutcome {
        step,
        sim_time_s,
        contacts: tools.map(contact).collect(),
        energy: Some(energy_ledger(&outcome.energy)),
        tracked_displacements_m: outcome.tracked_displacement_m.iter().map(vec3).collect(),
    }
}
