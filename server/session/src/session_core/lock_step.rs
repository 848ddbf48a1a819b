//! Tests of steps that calls ask for, in virtual time.

use kerf_physics::scene::GovernorDesc;
use kerf_physics::{OPEN, Pose, Quat, SceneDesc, Vec3};
use tokio::sync::oneshot;

use super::virtual_session::{MS, S, VirtualSession};
use crate::error::SessionError;
use crate::inbox::{Command, StepAnswer};
use crate::limits::SessionLimits;
use crate::pose_check::PoseSample;
use crate::status::Phase;
use crate::stepping::{StepInput, StepMotion, Stepped, Steps};
use crate::view_message::ViewMessage;

fn block() -> SceneDesc {
    toml::from_str(include_str!("../../tests/block.toml")).unwrap()
}

fn session_with(desc: SceneDesc, step_ns: u64) -> VirtualSession {
    let mut session = VirtualSession::new(desc, SessionLimits::default());
    session.step_ns = step_ns;
    session.ask(Command::Pause);
    session.ask(Command::Reset).unwrap();
    session
}

pub(super) fn session() -> VirtualSession {
    session_with(block(), MS / 10)
}

fn at(height_m: f64) -> StepInput {
    let orientation = Quat::from_axis_angle(&Vec3::y_axis(), 0.4) * Quat::from_axis_angle(&Vec3::z_axis(), 0.3);
    let pose = Pose { position_m: Vec3::new(0.0, height_m, 4e-4), orientation };
    vec![StepMotion { tool: 0, to: Some(PoseSample { seq: 0, client_ns: 0, pose, opening: OPEN }) }]
}

/// Down through the block, a pose a step, and out again.
pub(super) fn stroke() -> Vec<StepInput> {
    let down = (0..110).map(|step| at(0.012 - 2e-4 * f64::from(step)));
    down.chain([vec![StepMotion { tool: 0, to: None }]]).collect()
}

pub(super) fn steps(inputs: &[StepInput]) -> Steps {
    Steps { count: inputs.len() as u32, inputs: inputs.to_vec() }
}

fn ask(session: &VirtualSession, count: u32) -> oneshot::Receiver<Result<Stepped, SessionError>> {
    let (answer, answered): (StepAnswer, _) = oneshot::channel();
    session.inbox.push(Command::Step(Steps { count, inputs: Vec::new() }, answer)).unwrap();
    answered
}

#[test]
fn the_same_inputs_lead_to_the_same_state_however_fast_steps_are_and_however_calls_divide_them() {
    let run = |step_ns, steps_per_call| {
        let governor = Some(GovernorDesc { max_relative_tolerance: 0.1 });
        let mut session = session_with(SceneDesc { governor, ..block() }, step_ns);
        let mut outcomes = Vec::new();
        for inputs in stroke().chunks(steps_per_call) {
            let stepped = session.step_by(steps(inputs)).unwrap();
            outcomes.extend(stepped.outcomes);
            // A client may think for as long as it likes.
            session.run(S);
        }
        let status = session.status();
        assert_eq!((status.step, status.late_steps), (111, 0));
        session.resimulated();
        let hash = status.state_hash;
        assert!(status.topology_version > 0, "it cuts");
        (outcomes, hash)
    };
    let at_once = run(MS / 10, 111);
    assert_eq!(run(50 * MS, 1), at_once);
    assert_eq!(run(MS, 10), at_once);
    let (outcomes, _) = at_once;
    assert!(outcomes.iter().any(|outcome| outcome.tools[0].wrench.force_n.y > 0.01), "the blade feels the block");
    assert!(outcomes.last().unwrap().tools[0].pose.is_none(), "it is lifted");
    let energy = &outcomes.last().unwrap().energy;
    assert!(energy.fracture_j > 0.0 && energy.tool_work_j > energy.fracture_j);
}

#[test]
fn a_call_whose_inputs_are_not_all_valid_takes_no_step_and_names_the_field() {
    let mut session = session();
    let mut refused = |inputs: &[StepInput]| match session.step_by(steps(inputs)) {
        Err(SessionError::Input { path, limit }) => format!("{path}: {limit}"),
        other => panic!("{other:?}"),
    };
    // 9 mm in the 2 ms of a step, at 3 m/s at most.
    let jump = "inputs[2].motions[0].pose.pose.position_m: too fast: 4.500 m/s, limit 3.000 m/s: at most 0.0060 m from \
                the last accepted pose, not 0.0090 m";
    assert_eq!(refused(&[at(0.012), at(0.010), at(0.001)]), jump);
    assert!(refused(&[at(7.0)]).starts_with("inputs[0].motions[0].pose.pose.position_m: within 1 m"));
    let no_tool = [vec![StepMotion { tool: 9, to: None }]];
    assert!(refused(&no_tool).starts_with("inputs[0].motions[0].lift.tool_id: less than "));
    assert_eq!(session.status().step, 0);
    // A tool that was lifted enters anywhere, and one that stays is moved on from where it is.
    let lift = vec![StepMotion { tool: 0, to: None }];
    assert!(session.step_by(steps(&[at(0.012), lift, at(0.1)])).is_ok());
    assert!(session.step_by(Steps { count: 2, inputs: Vec::new() }).is_ok());
    assert!(matches!(session.step_by(steps(&[at(0.05)])), Err(SessionError::Input { .. })));
}

#[test]
fn a_tool_that_somebody_drives_is_not_moved_by_calls_and_steps_follow_the_driver() {
    let mut session = session();
    let driver = session.drive();
    session.run(60 * S);
    session.submit(driver, 1, 0.011).unwrap();
    assert_eq!(session.step_by(steps(&[at(0.012)])), Err(SessionError::ToolTaken { tool: 0, lease_s: 2.0 }));
    let stepped = session.step_by(Steps { count: 1, inputs: Vec::new() }).unwrap();
    let height_m = stepped.outcomes[0].tools[0].pose.map(|pose| pose.position_m.y);
    assert_eq!(height_m, Some(0.011), "the lease is kept while the session stands");
    session.inbox.disconnect_driver(driver);
    let stepped = session.step_by(steps(&[at(0.012)])).unwrap();
    assert!(stepped.outcomes[0].tools[0].pose.is_some(), "the tool is free again, and enters");
}

#[test]
fn calls_take_their_turn_and_each_is_shown_by_its_last_step() {
    let mut session = session();
    let mut viewer = session.view();
    viewer.set_interval_ns(S / 60);
    session.run(S);
    let mut answers = [3, 4].map(|count| ask(&session, count));
    session.run(S);
    let last = answers.each_mut().map(|answer| answer.try_recv().unwrap().unwrap().outcomes.last().unwrap().step);
    assert_eq!(last, [3, 7]);
    let mut shown = || {
        let states = std::iter::from_fn(|| viewer.try_next()).filter_map(|message| match message {
            ViewMessage::State(state) => Some(state.step),
            _ => None,
        });
        states.last()
    };
    assert_eq!(shown(), Some(7));
    // However soon after the last: none may follow it.
    session.step_by(Steps { count: 1, inputs: Vec::new() }).unwrap();
    assert_eq!(shown(), Some(8));
    assert_eq!(session.status().phase, Phase::Paused);
}

#[test]
fn what_else_a_session_is_told_ends_the_steps_that_are_left_and_so_does_a_caller_that_gives_up() {
    let mut session = session();
    let mut cut_short = [100, 5].map(|count| ask(&session, count));
    session.tick();
    session.tick();
    assert_eq!(session.ask(Command::Pause), 2);
    let ended = cut_short.each_mut().map(|answer| answer.try_recv().unwrap());
    let taken = |taken| Err(SessionError::StepsEnded { taken });
    assert_eq!(ended, [taken(2), taken(0)]);

    drop(ask(&session, 100));
    let mut next = ask(&session, 1);
    session.run(S);
    assert_eq!(next.try_recv().unwrap().unwrap().outcomes[0].step, 3);

    let mut resumed = ask(&session, 100);
    session.tick();
    session.ask(Command::Resume).unwrap();
    assert_eq!(resumed.try_recv().unwrap(), taken(1));
}

#[test]
fn a_scene_that_is_reset_or_taken_back_goes_the_same_way_again() {
    use crate::inbox::CheckpointCommand::{Restore, Save};
    let mut session = session();
    let (first, second) = (stroke()[..50].to_vec(), stroke()[50..].to_vec());
    let whole = |session: &mut VirtualSession| session.step_by(steps(&stroke())).unwrap();
    let once = whole(&mut session);
    session.ask(Command::Reset).unwrap();
    assert_eq!(whole(&mut session), once);

    session.ask(Command::Reset).unwrap();
    session.step_by(steps(&first)).unwrap();
    session.ask(|answer| Command::Checkpoint(Save("half way".into(), answer))).unwrap();
    let mut again = || {
        session.ask(|answer| Command::Checkpoint(Restore("half way".into(), answer))).unwrap();
        session.step_by(steps(&second)).unwrap()
    };
    assert_eq!(again(), again());
}

#[test]
fn a_tool_that_a_call_puts_into_tissue_waits_until_it_is_clear_and_the_outcome_says_so() {
    let mut session = session();
    let stepped = session.step_by(steps(&[at(0.008), at(0.0135), at(0.0125)])).unwrap();
    let told = stepped.outcomes.iter().map(|outcome| (outcome.waits[0], outcome.tools[0].pose.is_some()));
    assert_eq!(told.collect::<Vec<_>>(), [(true, false), (false, true), (false, true)]);
}
