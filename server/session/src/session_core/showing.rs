//! Tests of what viewers get while the one who shows is slow.

use kerf_physics::SceneDesc;
use kerf_physics::view::View;

use super::virtual_session::{MS, VirtualSession};
use crate::inbox::Command;
use crate::limits::SessionLimits;
use crate::outbox::Viewer;
use crate::view_message::ViewMessage;

fn session() -> VirtualSession {
    let desc: SceneDesc = toml::from_str(include_str!("../../tests/block.toml")).unwrap();
    VirtualSession::new(desc, SessionLimits::default())
}

fn messages(viewer: &mut Viewer) -> Vec<ViewMessage> {
    std::iter::from_fn(|| viewer.try_next()).filter(|message| !matches!(message, ViewMessage::Event(_))).collect()
}

/// Of the world as it is.
fn surface_hash(session: &VirtualSession) -> u64 {
    View::new(session.core.world().structure()).surface_hash()
}

/// A cut, in which nobody shows what is handed over before its end.
fn cut_unseen(session: &mut VirtualSession) {
    let driver = session.drive();
    session.shows = false;
    session.cut(driver, 1..90);
    session.shows = true;
    session.run(2 * MS);
}

#[test]
fn who_shows_too_slowly_misses_states_and_no_structure_and_delays_no_step() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(20 * MS);
    let before = messages(&mut viewer);
    let Some(ViewMessage::State(shown)) = before.last() else { panic!("{before:?}") };
    cut_unseen(&mut session);
    let [ViewMessage::Patch(patch), ViewMessage::State(state), ..] = &messages(&mut viewer)[..] else {
        panic!("all that has changed, and the newest state")
    };
    assert_eq!((patch.from_version, patch.to_version), (0, state.topology_version));
    assert_eq!(u64::from(state.times.steps), state.step - shown.step, "steps that nobody saw are counted");
    session.ask(Command::Pause);
    let status = session.status();
    assert!(status.topology_version > 2 && status.late_steps == 0);
    drop(viewer);
    let mut next = session.view();
    session.run(300 * MS);
    let [ViewMessage::Keyframe(keyframe), ViewMessage::State(state)] = &messages(&mut next)[..] else {
        panic!("the next one is shown the whole")
    };
    assert_eq!((keyframe.topology_version, state.step), (status.topology_version, status.step));
    assert_eq!(keyframe.surface_hash, surface_hash(&session));
}

#[test]
fn who_has_missed_more_than_the_whole_gets_the_whole() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(20 * MS);
    messages(&mut viewer);
    session.core.views.handed_over = Some(1);
    cut_unseen(&mut session);
    session.ask(Command::Pause);
    session.run(30 * MS);
    let shown = messages(&mut viewer);
    assert!(matches!(shown[..], [ViewMessage::Keyframe(_), .., ViewMessage::State(_)]), "{shown:?}");
    let hash = shown.iter().rev().find_map(|message| match message {
        ViewMessage::Keyframe(keyframe) => Some(keyframe.surface_hash),
        ViewMessage::Patch(patch) => Some(patch.surface_hash),
        _ => None,
    });
    assert_eq!(hash, Some(surface_hash(&session)));
}

#[test]
fn what_was_handed_over_before_a_reset_is_not_shown_after_it() {
    let mut session = session();
    let mut viewer = session.view();
    session.run(20 * MS);
    messages(&mut viewer);
    session.shows = false;
    session.run(40 * MS);
    session.ask(Command::Reset).unwrap();
    session.shows = true;
    session.run(20 * MS);
    let [ViewMessage::Keyframe(_), ViewMessage::State(state), ..] = &messages(&mut viewer)[..] else {
        panic!("the scene at rest")
    };
    assert!(state.step < 10, "{}", state.step);
}
