//! Clients that read slowly, or not at all: nothing old reaches them as if it were now.

use std::time::{Duration, Instant};

use kerf_proto::v1::view_response::Message;
use kerf_proto::v1::{self, control_response, send_pose_request};
use kerf_session::clock::MonotonicClock;
use tonic::Code;

use super::bystander::Bystander;
use super::harness::{Harness, connect, next, pose, soon};

fn age(contact: &v1::Contact) -> Duration {
    Duration::from_nanos(MonotonicClock::now_ns() - contact.server_ns)
}

/// It used to hold forces ten seconds old.
#[tokio::test]
async fn a_station_that_reads_slowly_holds_no_force_older_than_it_takes_to_read_two() {
    let mut harness = Harness::start().await;
    let bystander = Bystander::start(&mut harness).await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    let (mut read, mut old) = (0, 0);
    let started = Instant::now();
    while started.elapsed() < Duration::from_secs(4) {
        station.send(pose(0, 1 + read, 0.0)).await;
        let Some(Ok(control_response::Message::Contact(contact))) = station.next_unacknowledged().await else {
            continue;
        };
        // Now and then two are sent at once, to see whether the reader has become faster.
        assert!(age(&contact) < Duration::from_millis(550), "{:?} after {read} others", age(&contact));
        old += u32::from(age(&contact) > Duration::from_millis(100));
        read += 1;
        tokio::time::sleep(Duration::from_millis(400)).await;
        station.acknowledge(&contact).await;
    }
    assert!(read >= 8 && old <= 4, "{read} contacts, {old} of them old");
    bystander.check(&mut harness).await;
}

#[tokio::test]
async fn a_station_that_stalls_has_few_old_forces_to_throw_away_and_can_tell_them() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    for seq in 1..300 {
        station.send(pose(0, seq, 0.0)).await;
        station.contact_where(|_| true).await;
    }
    tokio::time::sleep(Duration::from_secs(2)).await;
    let mut old = 0;
    while age(&station.contact_where(|_| true).await) > Duration::from_millis(100) {
        old += 1;
    }
    assert!(old < 25, "{old} contacts, a tenth of a second's at most");
}

#[tokio::test]
async fn who_acknowledges_nothing_gets_no_stream() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut view = harness.view(harness.channel.clone(), &session).await;
    let first = [view.event().await.unwrap().unwrap(), view.event().await.unwrap().unwrap()];
    assert!(matches!(first.map(|event| event.message), [Some(Message::Keyframe(_)), Some(Message::State(_))]));
    assert!(tokio::time::timeout(Duration::from_millis(500), view.event()).await.is_err());
    view.acknowledge(2).await.unwrap();
    let state = soon("a state", view.event()).await.unwrap().unwrap();
    assert_eq!((state.number, matches!(state.message, Some(Message::State(_)))), (3, true));
    // The end is told all the same.
    harness.sessions.close_session(v1::CloseSessionRequest { session_id: session }).await.unwrap();
    while let Some(event) = soon("the end", view.event()).await.unwrap() {
        assert_eq!(event.number, if matches!(event.message, Some(Message::State(_))) { 4 } else { 0 });
    }
    assert_eq!(view.acknowledge(4).await.unwrap_err().code(), Code::NotFound);
}

#[tokio::test]
async fn a_viewer_that_takes_25_of_60_states_stays_in_the_present() {
    let mut harness = Harness::start().await;
    let bystander = Bystander::start(&mut harness).await;
    let session = harness.create().await.unwrap();
    let mut view = harness.view(connect(harness.server.address()).await, &session).await;
    let (mut states, mut behind_s) = (0, f64::NAN);
    for _ in 0..150 {
        if let Message::State(state) = next(&mut view).await {
            let now = harness.server.registry().get(&session).unwrap().describe().await.unwrap();
            behind_s = now.sim_time_s - state.sim_time_s;
            states += 1;
        }
        tokio::time::sleep(Duration::from_millis(40)).await;
    }
    assert!(states > 100 && behind_s < 0.3, "{behind_s} s behind after {states} states");
    bystander.check(&mut harness).await;
}

#[tokio::test]
async fn a_contact_that_is_old_is_not_told_to_who_sends_one_pose_a_call() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut client = v1::control_service_client::ControlServiceClient::new(harness.channel.clone());
    let request = |lease: &str, seq| v1::SendPoseRequest {
        session_id: session.clone(),
        lease: lease.into(),
        motion: Some(send_pose_request::Motion::Pose(pose(0, seq, 0.0))),
    };
    let lease = client.send_pose(request("", 1)).await.unwrap().into_inner().lease;
    // On a busy machine the newest may be old too.
    let mut seq = 1;
    soon("a contact that is not old", async {
        loop {
            tokio::time::sleep(Duration::from_millis(60)).await;
            seq += 1;
            let running = client.send_pose(request(&lease, seq)).await.unwrap().into_inner();
            assert_eq!(running.state(), v1::SessionState::Running);
            if running.contact.is_some() {
                break;
            }
        }
    })
    .await;
    harness.pause(&session).await;
    tokio::time::sleep(Duration::from_millis(150)).await;
    let standing = client.send_pose(request(&lease, seq + 1)).await.unwrap().into_inner();
    assert!(standing.contact.is_none() && standing.state() == v1::SessionState::Paused);
}

#[tokio::test]
async fn drivers_are_told_of_pause_resume_and_reset() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    station.contact_where(|_| true).await;
    let event = |message| match message {
        control_response::Message::Event(event) => Some(event.kind()),
        _ => None,
    };
    harness.pause(&session).await;
    assert_eq!(station.pick(event).await, v1::EventKind::Paused);
    // One that comes while the session stands is told at once.
    let mut later = harness.drive(&session, &[1]).await.unwrap();
    assert_eq!(later.pick(event).await, v1::EventKind::Paused);
    harness.reset(&session).await;
    assert_eq!(station.pick(event).await, v1::EventKind::Reset);
    harness.sessions.resume_session(v1::ResumeSessionRequest { session_id: session.clone() }).await.unwrap();
    assert_eq!(station.pick(event).await, v1::EventKind::Resumed);
    let contact = station.contact_where(|_| true).await;
    assert!(contact.step > 0, "it steps on");
}
