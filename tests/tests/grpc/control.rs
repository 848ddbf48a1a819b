//! Stations: leases, garbage, jumps.

use std::time::Duration;

use kerf_proto::v1::control_service_client::ControlServiceClient;
use kerf_proto::v1::{self, control_request, control_response, send_pose_request};
use tonic::{Code, Status};
use tonic_types::StatusExt as _;

use super::harness::{Cable, Harness, Station, connect, hello, no_expiry, pose};

const REENTERED: u32 = v1::ContactFlag::Reentered as u32;

#[tokio::test]
async fn contacts_echo_poses_at_the_granted_rate() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[1]).await.unwrap();
    assert_eq!(station.hello.contact_rate_hz, 250.0);
    assert_eq!(station.hello.scene.as_ref().unwrap().tools.len(), 2);
    station.send(pose(1, 7, 0.0)).await;
    let first = station.contact_where(|contact| contact.echo_seq == 7).await;
    assert_eq!((first.tool_id, first.echo_ns), (1, 7000));
    let second = station.contact_where(|_| true).await;
    assert!(second.step > first.step);
}

#[tokio::test]
async fn a_second_driver_is_refused_while_the_first_holds_the_tool() {
    let mut harness = Harness::with(no_expiry).await;
    let session = harness.create().await.unwrap();
    let first = harness.drive(&session, &[0]).await.unwrap();
    let refused = harness.drive(&session, &[0]).await.err().unwrap();
    assert_eq!(refused.code(), Code::FailedPrecondition);
    assert!(refused.message().contains("driven by another client"), "{}", refused.message());
    let other_tool = harness.drive(&session, &[1]).await;
    assert!(other_tool.is_ok());
    drop(first);
    harness.until(&session, |described| described.leased_tool_ids == [1]).await;
    assert!(harness.drive(&session, &[0]).await.is_ok());
}

#[tokio::test]
async fn a_client_killed_mid_stream_frees_its_tool_and_harms_nobody() {
    let mut harness = Harness::with(no_expiry).await;
    let session = harness.create().await.unwrap();
    let cable = Cable::to(harness.server.address()).await;
    let mut killed = Station::open(connect(cable.address).await, hello(&session, &[0])).await.unwrap();
    let mut other = harness.drive(&session, &[1]).await.unwrap();
    killed.send(pose(0, 1, 0.0)).await;
    killed.contact_where(|contact| contact.echo_seq == 1).await;
    cable.cut();
    harness.until(&session, |described| described.leased_tool_ids == [1]).await;
    other.send(pose(1, 1, 0.0)).await;
    other.contact_where(|contact| contact.echo_seq == 1).await;
    let mut next = harness.drive(&session, &[0]).await.unwrap();
    next.send(pose(0, 1, 0.2)).await;
    next.contact_where(|contact| contact.echo_seq == 1).await;
}

#[tokio::test]
async fn a_silent_client_is_told_that_its_lease_is_lost_and_has_it_again_with_a_pose() {
    let mut harness = Harness::with(|config| config.session.lease_s = 0.2).await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    station.send(pose(0, 1, 0.0)).await;
    let lost = station
        .pick(|message| match message {
            control_response::Message::LeaseLost(lost) => Some(lost),
            _ => None,
        })
        .await;
    assert_eq!((lost.tool_id, lost.reason()), (0, v1::LeaseLostReason::Silence));
    station.send(pose(0, 2, 0.3)).await;
    station.contact_where(|contact| contact.echo_seq == 2).await;
}

#[tokio::test]
async fn garbage_poses_are_refused_by_field_and_limit_and_the_stream_goes_on() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    station.send(pose(0, 10, 0.0)).await;
    // Before it is in the scene it may come down anywhere.
    station.contact_where(|contact| contact.echo_seq == 10).await;
    let changed = |change: fn(&mut v1::ToolPose)| {
        let mut garbage = pose(0, 11, 0.0);
        change(&mut garbage);
        garbage
    };
    let garbage = [
        (changed(|p| p.pose.as_mut().unwrap().position_m = None), "pose.position_m", "finite"),
        (changed(|p| p.pose = pose(0, 0, f32::NAN).pose), "pose.position_m", "finite"),
        (changed(|p| p.pose = pose(0, 0, 1e9).pose), "pose.position_m", "within 1 m"),
        (changed(|p| p.pose = pose(0, 0, 0.9).pose), "pose.position_m", "at most"),
        (changed(|p| p.pose.as_mut().unwrap().orientation.as_mut().unwrap().w = 0.5), "pose.orientation", "norm"),
        (changed(|p| p.tool_id = 1), "tool_id", "claimed"),
        (changed(|p| p.tool_id = 77), "tool_id", "less than 2"),
        (changed(|p| p.seq = 9), "seq", "greater than 10"),
    ];
    for (sent, field, limit) in garbage {
        let (tool_id, seq) = (sent.tool_id, sent.seq);
        station.send(sent).await;
        let rejected = station.rejection().await;
        assert_eq!((rejected.tool_id, rejected.seq, rejected.field.as_str()), (tool_id, seq, field));
        assert!(rejected.limit.contains(limit), "{:?} names {limit:?}", rejected.limit);
    }
    station.send(pose(0, 12, 0.0)).await;
    station.contact_where(|contact| contact.echo_seq == 12).await;
}

#[tokio::test]
async fn nothing_but_garbage_ends_the_stream() {
    let mut harness = Harness::with(|config| {
        no_expiry(config);
        config.control.max_rejected_in_a_row = 5;
    })
    .await;
    let session = harness.create().await.unwrap();
    let station = harness.drive(&session, &[0]).await.unwrap();
    for seq in 1..=5 {
        station.send(pose(0, seq, f32::INFINITY)).await;
    }
    assert_eq!(station.end().await, Code::InvalidArgument);
    harness.until(&session, |described| described.leased_tool_ids.is_empty()).await;
}

#[tokio::test]
async fn garbage_between_good_poses_never_ends_the_stream() {
    let mut harness = Harness::with(|config| config.control.max_rejected_in_a_row = 3).await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    for round in 1..=10 {
        station.send(pose(0, round, 0.0)).await;
        station.send(pose(0, round, 0.0)).await;
        assert_eq!(station.rejection().await.field, "seq");
    }
}

#[tokio::test]
async fn a_tool_that_teleports_is_put_down_there_and_not_locked_out() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    station.send(pose(0, 1, 0.0)).await;
    station.contact_where(|contact| contact.echo_seq == 1).await;
    station.send(pose(0, 2, 0.8)).await;
    assert_eq!(station.rejection().await.seq, 2);
    station.send(pose(0, 3, 0.8)).await;
    let there = station.contact_where(|contact| contact.echo_seq == 3).await;
    assert_eq!(there.flags & REENTERED, REENTERED);
    station.send(pose(0, 4, 0.801)).await;
    let moved = station.contact_where(|contact| contact.echo_seq == 4).await;
    assert_eq!(moved.flags & REENTERED, 0);
}

fn assert_names(refused: &Status, code: Code, field: &str, limit: &str) {
    let details = refused.get_details_bad_request();
    let named = details.map(|request| request.field_violations[0].field.clone());
    assert_eq!((refused.code(), named.as_deref()), (code, Some(field)), "{refused}");
    assert!(refused.message().contains(limit), "{refused}");
}

#[tokio::test]
async fn a_hello_that_is_refused_is_so_by_its_field_and_limit() {
    let mut harness = Harness::with(|config| config.control.hello_timeout_s = 0.2).await;
    let session = harness.create().await.unwrap();
    let refused = async |hello| Station::open(harness.channel.clone(), hello).await.err().unwrap();
    for id in ["session-00000000-1", "nonsense"] {
        assert_eq!(refused(hello(id, &[0])).await.code(), Code::NotFound);
    }
    let sound = || hello(&session, &[0]);
    let hellos = [
        (v1::ClientHello { protocol_version: 99, ..sound() }, "hello.protocol_version", "must be 3"),
        (hello(&session, &[0, 2]), "hello.tool_ids[1]", "less than 2"),
        (hello(&session, &[]), "hello.tool_ids", "required"),
        (v1::ClientHello { client_key: "k".repeat(65), ..sound() }, "hello.client_key", "more than 64"),
        (v1::ClientHello { contact_rate_hz: f64::NAN, ..sound() }, "hello.contact_rate_hz", "0 or greater"),
        (v1::ClientHello { contact_deadband: -1.0, ..sound() }, "hello.contact_deadband", "0 or greater"),
        (v1::ClientHello { contact_keep_alive_s: -1.0, ..sound() }, "hello.contact_keep_alive_s", "0 or greater"),
    ];
    for (hello, field, limit) in hellos {
        let code = match field {
            "hello.protocol_version" => Code::FailedPrecondition,
            "hello.tool_ids[1]" => Code::NotFound,
            _ => Code::InvalidArgument,
        };
        assert_names(&refused(hello).await, code, field, limit);
    }
    // One that says nothing is not waited for.
    let silent = ControlServiceClient::new(harness.channel.clone()).control(tokio_stream::pending()).await;
    let limit = "within 0.2 s (control.hello_timeout_s)";
    assert_names(&silent.unwrap_err(), Code::InvalidArgument, "hello", limit);
    let no_hello = v1::ControlRequest { message: Some(control_request::Message::Pose(pose(0, 1, 0.0))), received: 0 };
    let pose_first = ControlServiceClient::new(harness.channel.clone()).control(tokio_stream::once(no_hello)).await;
    assert_names(&pose_first.unwrap_err(), Code::InvalidArgument, "hello", "the first message");
    let twice = harness.drive(&session, &[0]).await.unwrap();
    twice.say(control_request::Message::Hello(sound())).await;
    assert_eq!(twice.end().await, Code::InvalidArgument);
}

#[tokio::test]
async fn one_pose_a_call_drives_a_tool_under_its_own_lease() {
    let mut harness = Harness::with(|config| config.session.lease_s = 1.0).await;
    let session = harness.create().await.unwrap();
    let mut client = ControlServiceClient::new(harness.channel.clone());
    let request = |lease: &str, pose: v1::ToolPose| v1::SendPoseRequest {
        session_id: session.clone(),
        lease: lease.into(),
        motion: Some(send_pose_request::Motion::Pose(pose)),
    };
    let first = client.send_pose(request("", pose(0, 1, 0.0))).await.unwrap().into_inner();
    assert!(!first.lease.is_empty() && first.rejected.is_none());
    let stranger = client.send_pose(request("", pose(0, 1, 0.0))).await.unwrap_err();
    assert_eq!(stranger.code(), Code::FailedPrecondition);
    tokio::time::sleep(Duration::from_millis(50)).await;
    let second = client.send_pose(request(&first.lease, pose(0, 1, 0.0))).await.unwrap().into_inner();
    assert_eq!(second.rejected.map(|rejected| rejected.field), Some("seq".into()));
    assert_eq!(second.contact.map(|contact| contact.echo_seq), Some(1));
    tokio::time::sleep(Duration::from_millis(1300)).await;
    let late = client.send_pose(request(&first.lease, pose(0, 2, 0.0))).await.unwrap_err();
    assert_eq!(late.code(), Code::FailedPrecondition);
    assert!(client.send_pose(request("", pose(0, 1, 0.0))).await.is_ok());
}
