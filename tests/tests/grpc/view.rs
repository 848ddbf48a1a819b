//! Viewers: joining, resets, and one that never reads.

use std::time::Duration;

use kerf_physics::Stage;
use kerf_proto::v1;
use kerf_proto::v1::view_response::Message;
use tonic::Code;

use super::harness::{Harness, View, endpoint, next, pose, soon, view_request};

async fn until<T>(view: &mut View, pick: impl Fn(Message) -> Option<T>) -> T {
    soon("the view event", async {
        loop {
            if let Some(picked) = pick(next(view).await) {
                return picked;
            }
        }
    })
    .await
}

async fn event(view: &mut View, kind: v1::EventKind) -> v1::Event {
    until(view, |message| match message {
        Message::Event(event) => Some(event).filter(|event| event.kind() == kind),
        _ => None,
    })
    .await
}

async fn state(view: &mut View) -> v1::State {
    until(view, |message| match message {
        Message::State(state) => Some(state),
        _ => None,
    })
    .await
}

#[tokio::test]
async fn every_viewer_starts_with_a_keyframe_and_a_state_of_its_version() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    for _ in 0..3 {
        let mut view = harness.view(harness.channel.clone(), &session).await;
        let Message::Keyframe(keyframe) = next(&mut view).await else { panic!("a keyframe comes first") };
        let Message::State(state) = next(&mut view).await else { panic!("a state follows") };
        assert_eq!(state.topology_version, keyframe.topology_version);
        assert_eq!((state.bodies.len(), state.profile.unwrap().stage_mean_s.len()), (1, Stage::ALL.len()));
    }
    harness.until(&session, |described| described.viewers == 0).await;
}

#[tokio::test]
async fn after_a_reset_a_keyframe_comes_before_any_state() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut view = harness.view(harness.channel.clone(), &session).await;
    harness.until(&session, |described| described.step > 10).await;
    harness.pause(&session).await;
    event(&mut view, v1::EventKind::Paused).await;
    harness.reset(&session).await;
    event(&mut view, v1::EventKind::Reset).await;
    let Message::Keyframe(keyframe) = next(&mut view).await else { panic!("a keyframe follows the reset") };
    let Message::State(state) = next(&mut view).await else { panic!("a state follows the keyframe") };
    assert_eq!((state.step, state.topology_version), (0, keyframe.topology_version));
}

#[tokio::test]
async fn viewers_are_told_of_tools_pauses_and_the_end() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut view = harness.view(harness.channel.clone(), &session).await;
    next(&mut view).await;
    let station = harness.drive(&session, &[1]).await.unwrap();
    assert_eq!(event(&mut view, v1::EventKind::ToolTaken).await.tool_id, 1);
    drop(station);
    assert_eq!(event(&mut view, v1::EventKind::ToolReleased).await.tool_id, 1);
    harness.pause(&session).await;
    event(&mut view, v1::EventKind::Paused).await;
    harness.sessions.resume_session(v1::ResumeSessionRequest { session_id: session.clone() }).await.unwrap();
    event(&mut view, v1::EventKind::Resumed).await;
    harness.sessions.close_session(v1::CloseSessionRequest { session_id: session }).await.unwrap();
    event(&mut view, v1::EventKind::Closing).await;
    assert!(soon("the end", view.message()).await.expect("a good end").is_none());
}

#[tokio::test]
async fn a_viewer_that_never_reads_slows_nobody_is_not_queued_for_and_gets_a_keyframe_later() {
    let mut harness = Harness::with(|config| config.session.view_rate_hz = 200.0).await;
    let session = harness.create().await.unwrap();
    // A window of a few messages, so that the transport cannot hide what the server queues.
    let narrow = endpoint(harness.server.address()).initial_stream_window_size(1024).connect().await.unwrap();
    let mut stalled = harness.view(narrow, &session).await;
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    tokio::time::sleep(Duration::from_millis(1500)).await;
    let described = harness.describe(&session).await;
    assert!(described.step > 100, "{} steps in 1.5 s of 500 Hz", described.step);
    station.send(pose(0, 1, 0.0)).await;
    station.contact_where(|contact| contact.echo_seq == 1).await;
    let mut brisk = harness.view(harness.channel.clone(), &session).await;
    state(&mut brisk).await;
    // What it missed is gone: a few states from before the stall, then the present.
    let mut from_before = 0;
    while state(&mut stalled).await.step < described.step {
        from_before += 1;
    }
    assert!(from_before < 60, "{from_before} states were kept for a viewer that did not read");
    // Structure that changed while it did not read comes as a keyframe.
    tokio::time::sleep(Duration::from_millis(500)).await;
    harness.reset(&session).await;
    tokio::time::sleep(Duration::from_millis(500)).await;
    let keyframe = until(&mut stalled, |message| match message {
        Message::Keyframe(keyframe) => Some(keyframe),
        _ => None,
    })
    .await;
    assert_eq!(state(&mut stalled).await.topology_version, keyframe.topology_version);
}

#[tokio::test]
async fn viewers_beyond_the_limit_are_refused() {
    let mut harness = Harness::with(|config| config.session.max_viewers = 1).await;
    let session = harness.create().await.unwrap();
    let first = harness.view(harness.channel.clone(), &session).await;
    let refused = harness.view_as(harness.channel.clone(), view_request(&session)).await.err();
    assert_eq!(refused.map(|status| status.code()), Some(Code::ResourceExhausted));
    drop(first);
    harness.until(&session, |described| described.viewers == 0).await;
    assert!(harness.view_as(harness.channel.clone(), view_request(&session)).await.is_ok());
}

#[tokio::test]
async fn who_wants_energies_gets_sums_that_nothing_is_missing_from() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut plain = harness.view(harness.channel.clone(), &session).await;
    assert_eq!(state(&mut plain).await.energy, None);
    let request = v1::ViewRequest { rate_hz: 5.0, wants_energy: true, ..view_request(&session) };
    let mut view = harness.view_as(harness.channel.clone(), request).await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    for seq in 1..=40 {
        let mut down = pose(0, seq, 0.0);
        down.pose.as_mut().unwrap().position_m.as_mut().unwrap().y = 0.0105 - 1e-4 * seq as f32;
        station.send(down).await;
        station.contact_where(|contact| contact.echo_seq == seq).await;
    }
    harness.pause(&session).await;
    let described = harness.describe(&session).await;
    let booked = described.energy.unwrap();
    assert!(booked.tool_work_j > 0.0 && booked.elastic_j > 0.0, "{booked:?}");
    // A viewer of few states has the same sums at the same step as the session.
    let mut states = Vec::new();
    while let Ok(message) = tokio::time::timeout(Duration::from_millis(500), next(&mut view)).await {
        if let Message::State(state) = message {
            states.push(state);
        }
    }
    let last = states.last().unwrap();
    assert!(last.step > states.len() as u64, "{} states of {} steps", states.len(), last.step);
    let energy = last.energy.unwrap();
    assert!(energy.tool_work_j > 0.0 && energy.tool_work_j <= booked.tool_work_j * 1.01, "{energy:?} of {booked:?}");
    let stored = energy.elastic_j + energy.contact_j + energy.kinetic_j;
    let spent = energy.fracture_j + energy.front_slip_j + energy.initiation_j + energy.damping_j;
    let unexplained = energy.tool_work_j + energy.load_work_j
        - stored
        - spent
        - energy.contact_loss_j
        - energy.parting_j
        - energy.numerical_j
        - energy.residual_j;
    assert!(unexplained.abs() < 1e-9 * energy.tool_work_j.abs(), "the sums balance: {unexplained} J");
}
