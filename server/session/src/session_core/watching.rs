//! What a session shows to whoever watches the server, in virtual time.

use kerf_physics::SceneDesc;
use tokio::sync::oneshot;

use super::lock_step::{steps, stroke};
use super::virtual_session::{MS, S, VirtualSession};
use crate::counts::{Count, Counts, Durations};
use crate::inbox::Command;
use crate::limits::SessionLimits;
use crate::status::Phase;

fn session() -> VirtualSession {
    let block: SceneDesc = toml::from_str(include_str!("../../tests/block.toml")).unwrap();
    VirtualSession::new(block, SessionLimits { hangs_after_s: 10.0, max_setup_s: 60.0, ..SessionLimits::default() })
}

fn total(durations: &Durations) -> u64 {
    durations.buckets().iter().sum()
}

fn counts(session: &VirtualSession) -> &Counts {
    &session.core.publisher.counts
}

#[test]
fn a_session_hangs_when_its_thread_stays_away_and_not_while_it_steps_or_stands() {
    let mut session = session();
    assert!(!session.outbox.vitals.hangs(u64::MAX - 1), "it has not begun");
    session.run(S);
    let vitals = |session: &VirtualSession, ahead_ns| {
        let now_ns = session.now_ns() + ahead_ns;
        (session.outbox.vitals.hangs(now_ns), session.outbox.vitals.away_ns(now_ns) / MS)
    };
    assert_eq!((vitals(&session, 9 * S), vitals(&session, 11 * S)), ((false, 9002), (true, 11_002)));
    session.clock.now_ns.fetch_add(11 * S, std::sync::atomic::Ordering::Relaxed);
    assert!(vitals(&session, 0).0);
    session.tick();
    assert!(!vitals(&session, 0).0, "it came by");
    session.ask(Command::Pause);
    session.run(60 * S);
    assert!(!vitals(&session, 0).0, "it stands, and looks after its clients");
}

#[test]
fn a_reset_may_take_as_long_as_a_scene_may_take_to_be_built() {
    let mut session = session();
    session.run(S);
    let (answer, _answered) = oneshot::channel();
    session.inbox.push(Command::Reset(answer)).unwrap();
    session.core.obey_commands();
    let hangs = |session: &VirtualSession, after_s| session.outbox.vitals.hangs(session.now_ns() + after_s * S);
    assert_eq!((hangs(&session, 69), hangs(&session, 71)), (false, true));
    session.tick();
    assert!(hangs(&session, 11), "the reset is over");
}

#[test]
fn steps_are_counted_as_they_were_paced() {
    let mut session = session();
    session.run(S);
    session.one_step_of(9 * MS);
    session.run(S - 9 * MS);
    let (vitals, of) = (session.outbox.vitals.done(), counts(&session));
    assert_eq!((total(&of.paced_steps), total(&of.called_steps), total(&of.lags)), (1000, 0, 4));
    // The long step is in the last whole second.
    assert_eq!((vitals.longest_step_ns, vitals.busy_ns), (9 * MS, 999 * MS / 10 + 9 * MS));
    let lags_ms = of.lags.sum_s() * 1e3;
    assert!((lags_ms - (7.0 + 5.1 + 3.2 + 1.3)).abs() < 1e-6, "{lags_ms} ms");
    let status = session.status();
    assert_eq!((vitals.steps, vitals.late_steps), (status.step, status.late_steps));
}

#[test]
fn a_cut_shows_in_links_energy_and_stages() {
    let mut session = session();
    session.ask(Command::Pause);
    session.step_by(steps(&stroke())).unwrap();
    let (done, of) = (session.outbox.vitals.done(), counts(&session));
    assert_eq!((total(&of.paced_steps), total(&of.called_steps)), (0, stroke().len() as u64));
    assert!(done.parted_links > 0 && done.parted_links == of.parted_links.get());
    let (residual_j, work_j) = (of.residual.get_j(), of.tool_work.get_j());
    assert!(work_j > 0.0 && residual_j < 0.02 * work_j, "{residual_j} J of {work_j} J");
    assert!(done.residual_j.abs() <= residual_j);
    assert_eq!(of.stage_ns.iter().map(Count::get).sum::<u64>(), 0, "a stage takes no time on this clock");
}

#[test]
fn a_panic_is_a_fault() {
    let mut session = session();
    session.run(S);
    session.clock.panics.store(true, std::sync::atomic::Ordering::Relaxed);
    session.tick();
    assert!(matches!(session.outbox.phase(), Phase::Failed { .. }));
    assert_eq!((counts(&session).faults.panic.get(), session.outbox.vitals.done().faults), (1, 1));
}
