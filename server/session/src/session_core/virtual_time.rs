//! Sessions in virtual time: minutes take milliseconds, and every run is the same.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use kerf_physics::scene::GovernorDesc;
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, SceneDesc, Stage, StageClock, StepInputs, Workers, World};
use tokio::sync::oneshot;

use super::Wake;
use super::virtual_session::{MS, S, VirtualSession};
use crate::error::SessionError;
use crate::inbox::{CheckpointCommand, Command};
use crate::limits::SessionLimits;
use crate::outbox::Viewer;
use crate::pose_refusal::PoseRefusal;
use crate::status::{Phase, SessionStatus};
use crate::stepping::Steps;
use crate::tape::TapeEntry;
use crate::tool_slot::Loss;
use crate::view_message::{SceneEvent, ViewEvent, ViewMessage};

fn block() -> SceneDesc {
    toml::from_str(include_str!("../../tests/block.toml")).unwrap()
}

fn session() -> VirtualSession {
    VirtualSession::new(block(), SessionLimits::default())
}

fn messages(viewer: &mut Viewer) -> Vec<ViewMessage> {
    std::iter::from_fn(|| viewer.try_next()).collect()
}

fn events(viewer: &mut Viewer) -> Vec<SceneEvent> {
    let event = |message| match message {
        ViewMessage::Event(happened) => Some(happened.event),
        _ => None,
    };
    messages(viewer).into_iter().filter_map(event).collect()
}

#[test]
fn minutes_are_stepped_at_the_rate_of_the_scene() {
    let mut desc = block();
    desc.rate_hz = 30.0;
    let mut session = VirtualSession::new(desc, SessionLimits::default());
    session.run(180 * S);
    let status = session.status();
    assert_eq!((status.step, status.late_steps, status.reanchors), (180 * 30, 0, 0));
    assert!((status.sim_time_s - 180.0).abs() < 1e-9);
}

#[test]
fn a_tick_before_its_time_does_nothing() {
    let mut session = session();
    session.tick();
    let wake = session.wake;
    session.tick();
    assert_eq!((wake, session.wake), (Wake::At(2 * MS), Wake::At(2 * MS)));
    assert_eq!(session.core.world().output().step, 1);
}

#[test]
fn a_late_step_is_counted_and_caught_up_and_no_step_is_dropped() {
    let mut session = session();
    session.run(S);
    session.one_step_of(9 * MS);
    session.run(S - 9 * MS);
    assert_eq!(session.wake, Wake::At(2 * S), "the deadlines are where they were");
    let status = session.status();
    // It ended 7 ms late; the next three began and ended late.
    assert_eq!((status.step, status.late_steps, status.reanchors), (1000, 4, 0));
}

#[test]
fn lag_past_the_limit_is_given_up_which_viewers_hear() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(S);
    events(&mut viewer);
    session.one_step_of(250 * MS);
    assert_eq!(events(&mut viewer), [SceneEvent::Reanchored]);
    session.run(S);
    let status = session.status();
    assert_eq!((status.step, status.late_steps, status.reanchors), (501 + 500, 1, 1), "no burst follows");
}

#[test]
fn a_session_that_does_not_keep_its_rate_tells_drivers_and_viewers() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(6 * S);
    assert_eq!((events(&mut viewer), session.reports.borrow().overloads), (vec![], 0));
    session.step_ns = 3 * MS;
    session.run(12 * S);
    let told = |event: &SceneEvent| matches!(event, SceneEvent::Overloaded(late_share) if *late_share > 0.5);
    assert!(events(&mut viewer).iter().any(told));
    session.drive();
    session.run(S);
    let report = session.reports.borrow().clone();
    assert!(report.overloads >= 1 && report.late_share > 0.5, "{report:?}");
    assert!((session.core.admitted.load.measured() - 1.5).abs() < 0.01, "3 ms of every 2");
}

#[test]
fn a_silent_driver_loses_its_tool_after_the_lease_but_not_while_the_session_stands() {
    let mut session = session();
    let mut viewer = session.view();
    let silent = session.drive();
    session.submit(silent, 1, 0.1).unwrap();
    session.run(1900 * MS);
    session.ask(Command::Pause);
    session.run(60 * S);
    session.ask(Command::Resume).unwrap();
    events(&mut viewer);
    session.run(1990 * MS);
    assert_eq!((session.inbox.held_tools(), events(&mut viewer)), (vec![0], vec![]), "the lease began anew");
    session.run(20 * MS);
    assert_eq!(events(&mut viewer), [SceneEvent::ToolReleased(0)]);
    assert_eq!(session.inbox.take_eviction(silent, 0), Some(Loss::Silence));
    assert!(session.core.world().output().tools[0].pose.is_none(), "it is lifted");
    let next = session.drive();
    session.submit(next, 1, 0.3).unwrap();
    assert!(matches!(session.submit(silent, 2, 0.1), Err(PoseRefusal::ToolTaken { .. })));
}

#[test]
fn who_takes_fewer_states_gets_the_one_that_a_session_stands_with() {
    // Whenever it is paused: between two states that the viewer takes there are 16 steps.
    for steps in 0..20 {
        let mut session = session();
        let mut viewer = session.watch_for_the_record();
        let mut shown = None;
        let mut look = |session: &mut VirtualSession| {
            session.run(2 * MS);
            while let Some(message) = viewer.try_next() {
                if let ViewMessage::State(state) = message {
                    shown = Some(state.step);
                }
            }
        };
        (0..30 + steps).for_each(|_| look(&mut session));
        let stood = session.ask(Command::Pause);
        (0..20).for_each(|_| look(&mut session));
        assert_eq!(shown, Some(stood), "paused after {steps} more steps");
    }
}

#[test]
fn a_pause_is_no_lost_time_and_a_reset_starts_over() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(S);
    let stood = session.ask(Command::Pause);
    session.run(60 * S);
    assert_eq!((stood, session.status().step, session.outbox.phase()), (500, 500, Phase::Paused));
    // It steps at once.
    assert_eq!(session.ask(Command::Resume), Ok(500));
    session.run(S - MS);
    let status = session.status();
    assert_eq!((status.step, status.late_steps), (1000, 0));
    session.one_step_of(9 * MS);
    events(&mut viewer);
    session.ask(Command::Reset).unwrap();
    session.run(9 * MS);
    let status = session.status();
    assert_eq!((status.step, status.late_steps, session.outbox.phase()), (5, 0, Phase::Running));
    let [ViewMessage::Event(told), ViewMessage::Keyframe(_), ViewMessage::State(state)] = &messages(&mut viewer)[..]
    else {
        panic!("a reset, and the scene at rest")
    };
    assert!(told.event == SceneEvent::Reset && state.step < 10, "{told:?}, step {}", state.step);
}

#[test]
fn a_session_that_goes_back_to_a_point_goes_on_in_time_and_replays() {
    let mut session = session();
    let driver = session.drive();
    session.cut(driver, 1..35);
    session.ask(Command::Pause);
    let step = session.ask(|answer| Command::Checkpoint(CheckpointCommand::Save("half way".into(), answer))).unwrap();
    let saved = session.status();
    session.ask(Command::Resume).unwrap();
    session.cut(driver, 35..110);
    session.one_step_of(3 * MS);
    session.ask(Command::Pause);
    let gone = session.status();
    let (halfway, after) = (saved.topology_version, gone.topology_version);
    assert!(halfway > 0 && after > halfway, "{halfway} and {after} times links parted");
    let restored = session.ask(|answer| Command::Checkpoint(CheckpointCommand::Restore("half way".into(), answer)));
    assert_eq!(restored, Ok(step));
    // What happened to the session did happen; all else is as it was.
    assert_eq!((saved.late_steps, gone.late_steps), (0, 1));
    assert_eq!(session.status(), SessionStatus { late_steps: 1, ..saved });

    session.ask(Command::Resume).unwrap();
    let report = Arc::clone(&session.reports.borrow());
    assert_eq!((report.step, report.restores, report.last_restored.as_deref()), (step + 1, 1, Some("half way")));
    assert!(report.tools[0].output.pose.is_none(), "hands are not where they were then");
    session.cut(driver, 111..180);
    session.ask(Command::Pause);
    assert_eq!(session.status().late_steps, 1, "going back is no lost time");
    let entries = session.resimulated();
    let went_back = |entry: &TapeEntry| {
        matches!(entry, TapeEntry::Event(ViewEvent { event: SceneEvent::CheckpointRestored(_), .. }))
    };
    let mut after = entries.iter().skip_while(|entry| !went_back(entry)).filter_map(|entry| match entry {
        TapeEntry::Step(taped) => Some(taped),
        TapeEntry::Event(_) | TapeEntry::Checkpoint(..) | TapeEntry::Base(_) => None,
    });
    let first = after.next().expect("a step after the way back");
    assert_eq!(first.report.step, step + 1, "what was undone is in the recording, and the way back after it");
    assert!(first.inputs.tools.iter().all(|input| input.motion == ToolMotion::Lift), "{:?}", first.inputs);
}

#[test]
fn states_come_at_the_view_rate_and_keyframes_for_those_who_fell_behind_at_most_every_interval() {
    let limits = SessionLimits { max_log_patches: 1, ..SessionLimits::default() };
    let mut session = VirtualSession::new(block(), limits.clone());
    let mut viewer = session.view();
    session.run(MS);
    assert!(matches!(messages(&mut viewer)[..], [ViewMessage::Keyframe(_), ViewMessage::State(_)]));
    let mut states = 0;
    for _ in 0..500 {
        session.run(2 * MS);
        states += messages(&mut viewer).len();
    }
    assert!((60..=62).contains(&states), "{states} states in a second");

    let driver = session.drive();
    let mut keyframes_ns = Vec::new();
    for seq in 1..=600 {
        // So slowly that links part throughout.
        session.submit(driver, seq, 0.012 - 0.02 * seq as f64 / 600.0).unwrap();
        session.run(2 * MS);
        if seq % 30 == 0 {
            let keyframes = messages(&mut viewer).iter().filter(|m| matches!(m, ViewMessage::Keyframe(_))).count();
            keyframes_ns.extend(std::iter::repeat_n(session.now_ns(), keyframes));
        }
    }
    // Readers look every 60 ms, after three or four patches.
    let least_ns = (limits.min_keyframe_interval_s * 1e9) as u64 - 60 * MS;
    assert!(keyframes_ns.len() >= 2, "{keyframes_ns:?}");
    assert!(keyframes_ns.windows(2).all(|pair| pair[1] - pair[0] >= least_ns), "{keyframes_ns:?}");
}

#[test]
fn what_steps_change_between_two_states_comes_as_one_patch_and_is_followed_by_a_state_also_in_a_pause() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(10 * MS);
    let driver = session.drive();
    let (mut patches, mut steps_of_patches) = (0, 0);
    for seq in 1..=400 {
        session.submit(driver, seq, 0.012 - 0.02 * seq as f64 / 400.0).unwrap();
        if seq == 400 {
            session.ask(Command::Pause);
        }
        session.run(2 * MS);
        let mut version = None;
        for message in messages(&mut viewer) {
            match message {
                ViewMessage::Patch(patch) => {
                    patches += 1;
                    steps_of_patches += patch.to_version - patch.from_version;
                    version = Some(patch.to_version);
                }
                ViewMessage::State(state) if version.is_some() => {
                    assert_eq!(version.take(), Some(state.topology_version))
                }
                _ => {}
            }
        }
        assert_eq!(version, None, "a state follows");
    }
    assert_eq!(steps_of_patches, session.status().topology_version, "nothing is missing");
    assert!(patches <= 50 && steps_of_patches > patches, "{patches} patches of {steps_of_patches} steps in 0.8 s");
}

#[test]
fn a_session_that_pauses_shows_once_where_it_stands() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(50 * MS);
    // Between two states.
    for _ in 0..3 {
        session.run(2 * MS);
        let stood = session.ask(Command::Pause);
        session.run(100 * MS);
        let steps = messages(&mut viewer).into_iter().filter_map(|message| match message {
            ViewMessage::State(state) => Some(state.step),
            _ => None,
        });
        assert_eq!(steps.filter(|step| *step == stood).count(), 1, "step {stood}");
        session.ask(Command::Resume).unwrap();
    }
}

#[test]
fn after_the_last_viewer_nothing_is_contoured_and_the_next_one_sees_the_surface_as_it_is() {
    let mut session = session();
    let mut first = session.view();
    session.run(10 * MS);
    assert!(matches!(first.try_next(), Some(ViewMessage::Keyframe(_))));
    drop(first);
    session.run(2 * MS);
    let driver = session.drive();
    session.cut(driver, 1..90);
    session.ask(Command::Pause);
    let mut second = session.view();
    session.run(100 * MS);
    let Some(ViewMessage::Keyframe(keyframe)) = second.try_next() else { panic!("a keyframe comes first") };
    let Some(ViewMessage::State(state)) = second.try_next() else { panic!("a state follows") };
    assert!(keyframe.topology_version > 2, "the block was cut");
    // The first state sums up all steps since the one that the first viewer saw.
    assert_eq!(state.times.stage_ns[Stage::Surface as usize], 0);
    assert!(state.times.steps >= 89);
    let mut again = World::new(&session.scene).unwrap();
    for entry in session.resimulated() {
        if let TapeEntry::Step(taped) = entry {
            again.step(&Workers::serial(), &NoClock, &taped.inputs.as_inputs());
        }
    }
    assert_eq!(again.surface_hash(), keyframe.surface_hash);
}

/// Cuts while the machine has time for half of what steps take, and then waits while it has time to spare. What viewers
/// were told of residuals.
fn cut_in_half_of_the_time(max_relative_tolerance: f64) -> (VirtualSession, Vec<f64>) {
    let mut desc = block();
    desc.governor = Some(GovernorDesc { max_relative_tolerance });
    let mut session = VirtualSession::new(desc, SessionLimits::default());
    let mut viewer = session.view();
    session.step_ns = 3 * MS;
    session.run(S);
    let driver = session.drive();
    session.cut(driver, 1..80);
    session.step_ns = MS / 10;
    session.run(10 * S);
    let residual = |event| match event {
        SceneEvent::ToleranceChanged(residual) => Some(residual),
        _ => None,
    };
    let told = events(&mut viewer).into_iter().filter_map(residual).collect();
    (session, told)
}

/// Whether the steps that were recorded lead to the same state when their work is not bounded.
fn is_exact(session: &mut VirtualSession) -> bool {
    let mut exact = World::new(&session.scene).unwrap();
    for entry in session.resimulated() {
        if let TapeEntry::Step(taped) = entry {
            exact.step(&Workers::serial(), &NoClock, &StepInputs::of(&taped.inputs.tools));
        }
    }
    exact.state_hash() == session.status().state_hash
}

#[test]
fn work_that_does_not_fit_the_time_of_a_step_leaves_a_residual_that_is_bounded_told_and_replayed() {
    let (mut session, told) = cut_in_half_of_the_time(0.02);
    let own = session.scene.desc.relative_tolerance();
    let (over, left) = told.split_last().expect("some was left");
    assert_eq!(*over, own, "it is told when it is over");
    assert!(!left.is_empty() && left.iter().all(|residual| *residual > own && *residual <= 0.02), "{told:?}");
    assert_eq!(session.status().relative_tolerance, own);
    assert!(!is_exact(&mut session), "what the governor did is part of the recording");
    session.ask(Command::Reset).unwrap();
    assert_eq!(session.status().relative_tolerance, own);
}

#[test]
fn a_scene_whose_governor_may_give_up_nothing_is_late_and_exact() {
    let (mut session, told) = cut_in_half_of_the_time(block().relative_tolerance());
    assert!(told.is_empty(), "{told:?}");
    assert!(session.status().late_steps > 300, "{}", session.status().late_steps);
    assert!(is_exact(&mut session));
}

#[test]
fn a_panic_in_a_step_fails_the_session_until_a_reset() {
    let mut session = session();
    let mut viewer = session.view();
    let _driver = session.drive();
    session.run(S);
    events(&mut viewer);
    session.clock.panics.store(true, Ordering::Relaxed);
    session.run(S);
    assert_eq!(session.reports.borrow().phase.failure(), Some("a test's panic"));
    assert_eq!(events(&mut viewer), [SceneEvent::Failed]);
    let failed = SessionError::Failed { message: "a test's panic".into() };
    assert_eq!(session.ask(Command::Resume), Err(failed));
    assert!(matches!(session.status().phase, Phase::Failed { .. }));
    session.ask(Command::Reset).unwrap();
    assert_eq!(events(&mut viewer), [SceneEvent::Reset, SceneEvent::Paused]);
    session.ask(Command::Resume).unwrap();
    session.run(S - MS);
    assert_eq!((session.status().step, session.reports.borrow().phase.failure()), (500, None));
}

#[test]
fn a_command_that_panics_fails_the_session_and_those_behind_it_go_unanswered() {
    let mut session = session();
    session.run(S);
    session.inbox.push(Command::Query(Box::new(|_| panic!("a test's panic")))).unwrap();
    let (answer, mut answered) = oneshot::channel();
    session.inbox.push(Command::Describe(answer)).unwrap();
    session.run(S);
    assert!(answered.try_recv().is_err());
    assert!(matches!(session.outbox.phase(), Phase::Failed { .. }));
    assert_eq!(session.core.world().output().step, 500);
}

#[test]
fn a_session_that_closes_tells_its_viewers_obeys_nothing_more_and_is_never_due_again() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(S);
    events(&mut viewer);
    let (answer, mut answered) = oneshot::channel();
    session.inbox.push(Command::Describe(answer)).unwrap();
    session.inbox.close();
    session.run(S);
    assert_eq!((session.wake, session.outbox.phase()), (Wake::Never, Phase::Closing));
    assert!(answered.try_recv().is_err());
    assert_eq!(events(&mut viewer), [SceneEvent::Closing]);
    assert_eq!(session.core.world().output().step, 500);
}

#[test]
fn a_session_that_stands_takes_as_many_steps_as_it_is_told_and_shows_the_last() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(S);
    let stood = session.ask(Command::Pause);
    session.run(S);
    messages(&mut viewer);
    let stepped = session.step_by(Steps { count: 3, inputs: Vec::new() }).unwrap();
    assert_eq!(stepped.outcomes.iter().map(|outcome| outcome.step).collect::<Vec<_>>(), [501, 502, 503]);
    session.run(S);
    let status = session.status();
    assert_eq!((status.step, status.late_steps, status.phase), (stood + 3, 0, Phase::Paused));
    let shown = messages(&mut viewer).into_iter().filter_map(|message| match message {
        ViewMessage::State(state) => Some(state.step),
        _ => None,
    });
    assert_eq!(shown.last(), Some(stood + 3));
    assert_eq!(session.ask(Command::Resume), Ok(stood + 3));
    session.run(S - MS);
    assert_eq!(session.status().late_steps, 0);
}

/// Goes on each time that it is asked.
#[derive(Default)]
struct AdvancingClock(AtomicU64);

impl StageClock for AdvancingClock {
    fn now_ns(&self) -> u64 {
        self.0.fetch_add(MS / 100, Ordering::Relaxed)
    }
}

#[test]
fn a_session_that_has_warmed_up_begins_in_time_and_with_its_work_bounded() {
    let budgets = |warm: bool| {
        let mut session = session();
        if warm {
            session.core.warm_up(&Workers::serial(), &AdvancingClock::default());
        }
        session.tick();
        let status = session.status();
        assert_eq!((status.late_steps, status.reanchors), (0, 0));
        let budget = |entry| match entry {
            TapeEntry::Step(step) => Some(step.inputs.work_units),
            _ => None,
        };
        session.resimulated().into_iter().filter_map(budget).collect::<Vec<_>>()
    };
    assert!(matches!(budgets(true)[..], [.., Some(units)] if units > 0));
    assert_eq!(budgets(false), [None], "a session that has not takes what its steps take");
}
