//! Clients that ask for too much, or send what is none: they are refused, and others do not notice.

use std::net::IpAddr;
use std::time::{Duration, Instant};

use kerf_physics::{Scene, SceneDesc};
use kerf_proto::codec::StrictCodec;
use kerf_proto::v1::control_service_client::ControlServiceClient;
use kerf_proto::v1::{self, send_pose_request};
use kerf_scenes::cost::Cost;
use tokio::net::TcpStream;
use tonic::transport::Channel;
use tonic::{Code, Request, Status};
use tonic_types::StatusExt;

use super::bystander::Bystander;
use super::cut::{ABOVE_M, MIDDLE_M, Stroke, Watcher};
use super::harness::{BLOCK, Harness, Station, endpoint, no_expiry, pose, soon};

/// The block with so many voxels a side, each an element of its own.
fn block_of(voxels: u32) -> String {
    let finer = BLOCK.replace("resolution = 6", &format!("resolution = {voxels}")).replace("level = 1", "level = 0");
    finer.replace("fracture_energy_j_per_m2 = 5.0", "fracture_energy_j_per_m2 = 0.1")
}

fn limit(refused: &Status) -> String {
    assert_eq!(refused.code(), Code::ResourceExhausted, "{refused}");
    refused.get_details_quota_failure().expect("details").violations[0].subject.clone()
}

#[tokio::test]
async fn a_scene_that_needs_more_memory_than_is_left_is_refused_before_it_is_built() {
    let mut harness = Harness::with(|config| {
        config.session.max_memory_mib = Some(300.0);
        config.session.max_load = Some(100.0);
    })
    .await;
    let bystander = Bystander::start(&mut harness).await;
    let begun = Instant::now();
    // Three gigabytes; and as many cells as a lattice may have, a hundred and ten minutes.
    for (voxels, named) in [(70, "max_memory_mib"), (250, "max_setup_s")] {
        assert_eq!(limit(&harness.create_of(block_of(voxels)).await.unwrap_err()), named);
    }
    // 80 MiB each: three fit.
    let mut ids = Vec::new();
    let refused = loop {
        match harness.create_of(block_of(20)).await {
            Ok(id) => ids.push(id),
            Err(refused) => break refused,
        }
    };
    assert_eq!((limit(&refused).as_str(), ids.len()), ("max_memory_mib", 3), "{refused}");
    harness.sessions.close_session(v1::CloseSessionRequest { session_id: ids[0].clone() }).await.unwrap();
    assert!(harness.create_of(block_of(20)).await.is_ok());
    assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", begun.elapsed());
    bystander.check(&mut harness).await;
}

#[tokio::test]
async fn sessions_beyond_what_the_cores_can_do_are_refused() {
    let scene =
        Scene { desc: SceneDesc::from_toml("block.toml", BLOCK).unwrap(), meshes: Default::default() }.judge().unwrap();
    let load = Cost::of(&scene).unwrap().step_s * scene.desc.rate_hz;
    let mut harness = Harness::with(|config| config.session.max_load = Some(2.5 * load)).await;
    let bystander = Bystander::start(&mut harness).await;
    harness.create().await.unwrap();
    let refused = harness.create().await.unwrap_err();
    assert_eq!(limit(&refused), "max_load");
    assert!(harness.create_of(BLOCK.replace("500.0", "100.0")).await.is_ok(), "a slower one fits");
    bystander.check(&mut harness).await;
}

#[tokio::test]
async fn creations_that_are_given_up_hold_no_place() {
    let mut harness = Harness::with(|config| {
        config.session.max_sessions = 4;
        config.session.max_load = Some(100.0);
    })
    .await;
    let bystander = Bystander::start(&mut harness).await;
    for _ in 0..7 {
        let given_up = tokio::time::timeout(Duration::from_millis(50), harness.create_of(block_of(24))).await;
        assert!(given_up.is_err(), "{given_up:?}");
    }
    soon("places", async {
        while harness.create().await.is_err() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
    assert_eq!(harness.server.registry().list().len(), 2);
    // Those that were being built have ended when they were.
    soon("all places", async {
        while harness.server.registry().list().len() < 4 {
            let _ = harness.create().await;
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
    bystander.check(&mut harness).await;
}

#[tokio::test]
async fn a_session_that_nobody_has_to_do_with_is_closed() {
    let mut harness = Harness::with(|config| {
        config.session.idle_timeout_s = 0.5;
        config.session.lease_s = 0.5;
    })
    .await;
    let bystander = Bystander::start(&mut harness).await;
    let viewed = harness.create().await.unwrap();
    let _view = harness.view(harness.channel.clone(), &viewed).await;
    let abandoned = harness.create().await.unwrap();
    // A browser that was closed: nobody says good-bye in single calls.
    let motion = Some(send_pose_request::Motion::Pose(pose(0, 1, 0.0)));
    let request = v1::SendPoseRequest { session_id: abandoned, lease: String::new(), motion };
    ControlServiceClient::new(harness.channel.clone()).send_pose(request).await.unwrap();
    assert_eq!(harness.server.registry().list().len(), 3);
    soon("its end", async {
        while harness.server.registry().list().len() > 2 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
    tokio::time::sleep(Duration::from_millis(1200)).await;
    assert_eq!(harness.server.registry().list().len(), 2, "one is driven, one is viewed");
    bystander.check(&mut harness).await;
}

#[tokio::test]
async fn silent_sockets_keep_nobody_out() {
    let mut harness = Harness::with(|config| {
        config.transport.max_connections = 40;
        config.transport.max_connections_per_peer = 20;
        config.transport.handshake_timeout_s = 1.0;
    })
    .await;
    let bystander = Bystander::start(&mut harness).await;
    let address = harness.server.address();
    let mut silent = Vec::new();
    for _ in 0..60 {
        silent.push(TcpStream::connect(address).await.unwrap());
    }
    let from = |host: [u8; 4]| endpoint(address).local_address(Some(IpAddr::from(host)));
    let other = from([127, 0, 0, 2]);
    let elsewhere = tokio::time::timeout(Duration::from_millis(500), other.connect()).await;
    assert!(elsewhere.is_ok_and(|connected| connected.is_ok()), "another address is served");
    soon("a place", async {
        let list = async |channel| {
            v1::session_service_client::SessionServiceClient::new(channel)
                .list_sessions(v1::ListSessionsRequest {})
                .await
        };
        loop {
            if let Ok(channel) = from([127, 0, 0, 1]).connect().await
                && list(channel).await.is_ok()
            {
                break;
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    })
    .await;
    bystander.check(&mut harness).await;
}

#[tokio::test]
async fn addresses_with_many_connections_make_room_for_one_with_few() {
    let mut harness = Harness::with(|config| {
        config.transport.max_connections = 24;
        config.transport.max_connections_per_peer = 12;
    })
    .await;
    let address = harness.server.address();
    let from = |host: [u8; 4]| endpoint(address).local_address(Some(IpAddr::from(host)));
    // Connections that answer pings, as many as there may be.
    let mut many = Vec::new();
    // The harness has one already.
    for (peer, connections) in [(1, 11), (2, 12)] {
        for _ in 0..connections {
            many.push(soon("a connection", from([127, 0, 0, peer]).connect()).await.unwrap());
        }
    }
    let list = async |channel: Channel| {
        let mut client = v1::session_service_client::SessionServiceClient::new(channel);
        client.list_sessions(v1::ListSessionsRequest {}).await
    };
    // Three addresses share 24.
    let mut few = Vec::new();
    for _ in 0..7 {
        let channel = soon("a place", from([127, 0, 0, 3]).connect()).await.unwrap();
        soon("a list", list(channel.clone())).await.unwrap();
        few.push(channel);
    }
    for channel in few {
        soon("a list", list(channel)).await.unwrap();
    }
    assert!(harness.create().await.is_ok(), "who came first stays");
}

#[tokio::test]
async fn ids_of_one_run_of_a_server_are_none_of_the_next() {
    let (mut first, mut second) = (Harness::start().await, Harness::start().await);
    let (of_first, of_second) = (first.create().await.unwrap(), second.create().await.unwrap());
    assert_ne!(of_first, of_second);
    assert_eq!(second.drive(&of_first, &[0]).await.err().map(|refused| refused.code()), Some(Code::NotFound));
    let instance = async |harness: &mut Harness| {
        harness.sessions.list_sessions(v1::ListSessionsRequest {}).await.unwrap().into_inner().server_instance
    };
    assert_ne!(instance(&mut first).await, instance(&mut second).await);
}

/// The longest that a pose of these numbers waits for its contact.
async fn longest_round_trip(station: &mut Station, seqs: std::ops::Range<u64>) -> Duration {
    let mut longest = Duration::ZERO;
    for seq in seqs {
        let sent = Instant::now();
        station.send(pose(1, seq, 0.0)).await;
        station.contact_where(|contact| contact.echo_seq == seq).await;
        longest = longest.max(sent.elapsed());
    }
    longest
}

#[tokio::test]
async fn texts_that_take_long_to_read_hold_up_nobody() {
    let mut harness = Harness::start().await;
    let bystander = Bystander::start(&mut harness).await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[1]).await.unwrap();
    let long = format!("{BLOCK}\nnumbers = [{}]", "1,".repeat(450_000));
    // What else the machine does holds a pose up too, but not each time.
    let mut waits = Vec::new();
    for first in [1, 201, 401] {
        let undisturbed = longest_round_trip(&mut station, first..first + 100).await;
        let sending: Vec<_> = (0..12)
            .map(|_| {
                let (mut sessions, long) = (harness.sessions.clone(), long.clone());
                tokio::spawn(async move {
                    let scene = Some(v1::create_session_request::Scene::SceneToml(long));
                    sessions.create_session(v1::CreateSessionRequest { scene, ..Default::default() }).await
                })
            })
            .collect();
        let held_up = longest_round_trip(&mut station, first + 100..first + 200).await;
        for sent in sending {
            let refused = sent.await.unwrap().unwrap_err();
            assert!([Code::InvalidArgument, Code::ResourceExhausted].contains(&refused.code()), "{refused}");
        }
        waits.push((held_up, undisturbed));
        if held_up < Duration::from_millis(300).max(10 * undisturbed) {
            return bystander.check(&mut harness).await;
        }
    }
    panic!("poses were held up each time, and undisturbed: {waits:?}");
}

#[tokio::test]
async fn a_large_message_comes_in_parts() {
    let mut harness = Harness::with(|config| {
        no_expiry(config);
        config.view.max_message_bytes = 1000;
    })
    .await;
    let session = harness.create().await.unwrap();
    let mut watcher = Watcher::join(&harness, harness.channel.clone(), &session).await;
    let mut stroke = Stroke::begin(&harness, &session).await;
    watcher.during(stroke.press(ABOVE_M, MIDDLE_M)).await;
    let version = harness.describe(&session).await.topology_version;
    watcher.until(|replica| replica.topology_version() == Some(version)).await;
    assert!(version > 0);
}

#[tokio::test]
async fn a_lease_moves_no_tool_of_another_session() {
    let mut harness = Harness::start().await;
    let [own, other] = [harness.create().await.unwrap(), harness.create().await.unwrap()];
    let mut client = ControlServiceClient::new(harness.channel.clone());
    let request = |session: &str, lease: &str, seq| v1::SendPoseRequest {
        session_id: session.into(),
        lease: lease.into(),
        motion: Some(send_pose_request::Motion::Pose(pose(0, seq, 0.0))),
    };
    let lease = client.send_pose(request(&own, "", 1)).await.unwrap().into_inner().lease;
    let refused = client.send_pose(request(&other, &lease, 2)).await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument);
    assert_eq!(refused.get_details_bad_request().unwrap().field_violations[0].field, "session_id");
    assert!(client.send_pose(request(&own, &lease, 2)).await.unwrap().into_inner().rejected.is_none());
}

#[tokio::test]
async fn bytes_that_are_no_message_are_the_senders_mistake() {
    let harness = Harness::start().await;
    let mut client = tonic::client::Grpc::new(harness.channel.clone());
    client.ready().await.unwrap();
    // A number where a text belongs.
    let codec = StrictCodec::<v1::LiftTool, v1::DescribeSessionResponse>::default();
    let path = "/kerf.v1.SessionService/DescribeSession".parse().unwrap();
    let refused = client.unary(Request::new(v1::LiftTool { tool_id: 5 }), path, codec).await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
}

#[tokio::test]
async fn poses_beyond_the_rate_are_rejected_by_its_name_and_the_stream_goes_on() {
    let mut harness = Harness::with(|config| config.control.max_pose_rate_hz = 50.0).await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    for seq in 1..=300 {
        station.send(pose(0, seq, 0.0)).await;
    }
    let rejected = station.rejection().await;
    assert!(rejected.limit.contains("max_pose_rate_hz"), "{rejected:?}");
    tokio::time::sleep(Duration::from_millis(300)).await;
    station.send(pose(0, 1000, 0.0)).await;
    station.contact_where(|contact| contact.echo_seq == 1000).await;
}
