//! Files of checkpoints over the wire: what is refused, and that it costs nobody anything.

use std::time::Duration;

use kerf_proto::v1;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_server::config::ServerConfig;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Status, Streaming};
use tonic_types::StatusExt;

use super::harness::{BLOCK, Harness, connect, endpoint, soon};

async fn parts(
    harness: &mut Harness,
    session_id: &str,
    name: &str,
) -> Result<Streaming<v1::DownloadCheckpointResponse>, Status> {
    let request = v1::DownloadCheckpointRequest { session_id: session_id.into(), name: name.into() };
    Ok(harness.sessions.download_checkpoint(request).await?.into_inner())
}

async fn download(harness: &mut Harness, session_id: &str, name: &str) -> Result<Vec<u8>, Status> {
    let (mut parts, mut file) = (parts(harness, session_id, name).await?, Vec::new());
    while let Some(part) = parts.message().await? {
        assert!((1..=256 << 10).contains(&part.data.len()), "{} bytes", part.data.len());
        file.extend(part.data);
    }
    Ok(file)
}

/// Sends a file in parts of so many bytes.
async fn upload_in(
    harness: &mut Harness,
    session_id: &str,
    name: &str,
    file: &[u8],
    bytes: usize,
) -> Result<u64, Status> {
    let part = |data: &[u8]| v1::UploadCheckpointRequest {
        session_id: session_id.into(),
        name: name.into(),
        data: data.to_vec(),
    };
    let first = part(&[]);
    let parts: Vec<_> = std::iter::once(first).chain(file.chunks(bytes).map(part)).collect();
    let answer = harness.sessions.upload_checkpoint(tokio_stream::iter(parts));
    Ok(soon("an answer", answer).await?.into_inner().step)
}

async fn upload(harness: &mut Harness, session_id: &str, name: &str, file: &[u8]) -> Result<u64, Status> {
    upload_in(harness, session_id, name, file, 64 << 10).await
}

async fn names(harness: &mut Harness, session_id: &str) -> Vec<String> {
    let request = v1::ListCheckpointsRequest { session_id: session_id.into() };
    let listed = harness.sessions.list_checkpoints(request).await.unwrap().into_inner().checkpoints;
    listed.into_iter().map(|checkpoint| checkpoint.name).collect()
}

async fn save(harness: &mut Harness, session_id: &str, name: &str) {
    let request = v1::SaveCheckpointRequest { session_id: session_id.into(), name: name.into() };
    harness.sessions.save_checkpoint(request).await.unwrap();
}

/// It is refused with this code, and words that name the field or the limit.
fn assert_refused(refused: Result<u64, Status>, code: Code, names: &str, says: &str) {
    let status = refused.expect_err(says);
    assert_eq!(status.code(), code, "{status:?}");
    assert!(status.message().contains(says), "{says}: {}", status.message());
    let named = match code {
        Code::InvalidArgument => status.get_details_bad_request().unwrap().field_violations[0].field.clone(),
        Code::ResourceExhausted => status.get_details_quota_failure().unwrap().violations[0].subject.clone(),
        _ => String::new(),
    };
    assert_eq!(named, names, "{}", status.message());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_has_come_to_harm_is_refused_and_the_session_steps_on() {
    let mut harness = Harness::start().await;
    let from = harness.create().await.unwrap();
    harness.until(&from, |described| described.step > 10).await;
    let file = download(&mut harness, &from, "").await.unwrap();
    let session = harness.create().await.unwrap();
    save(&mut harness, &session, "mine").await;
    let before = harness.describe(&session).await.step;
    for place in 0..40 {
        let cut = &file[..file.len() * place / 40];
        let says = if place == 0 { "does not begin with" } else { "cut off or changed" };
        assert_refused(upload(&mut harness, &session, "other", cut).await, Code::InvalidArgument, "data", says);
        let mut changed = file.clone();
        changed[(file.len() - 1) * place / 39] ^= 1 << (place % 8);
        let says = if place == 0 { "does not begin with" } else { "cut off or changed" };
        assert_refused(upload(&mut harness, &session, "other", &changed).await, Code::InvalidArgument, "data", says);
    }
    let other_format: Vec<u8> = file.iter().enumerate().map(|(at, byte)| byte ^ u8::from(at == 9)).collect();
    let refused = upload(&mut harness, &session, "other", &other_format).await;
    assert_refused(refused, Code::InvalidArgument, "data", "data: format: it is ");
    let longer = [&file[..], &[0]].concat();
    let refused = upload(&mut harness, &session, "other", &longer).await;
    assert_refused(refused, Code::InvalidArgument, "data", "cut off or changed");

    let described = harness.describe(&session).await;
    assert!(described.step > before && described.state == v1::SessionState::Running as i32, "{described:?}");
    assert_eq!(names(&mut harness, &session).await, ["mine"]);
    // Parts of any size are the same file.
    let step = upload_in(&mut harness, &session, "other", &file, 999).await.unwrap();
    assert!(step > 10);
    assert_eq!(names(&mut harness, &session).await, ["mine", "other"]);
    assert!(download(&mut harness, &session, "other").await.unwrap() == file, "what was kept is what was sent");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_of_another_scene_is_refused_by_what_differs() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let changes = [
        (
            "name = \"block\"\nrate_hz",
            "name = \"brick\"\nrate_hz",
            "scene.name: the file is of `brick`, and this is `block`",
        ),
        ("rate_hz = 500.0", "rate_hz = 400.0", "scene.rate_hz: the file is of 400 Hz, and this is 500 Hz"),
        ("3.0e4", "3.1e4", "scene.objects[0].material.young_modulus_pa: the scene that the file is of"),
        ("height_m = 0.01 } }\n\n", "height_m = 0.011 } }\n\n", "scene.tools[0].shape"),
    ];
    for (stated, otherwise, says) in changes {
        assert!(BLOCK.contains(stated), "{stated:?}");
        let other = harness.create_of(BLOCK.replacen(stated, otherwise, 1)).await.unwrap();
        let file = download(&mut harness, &other, "").await.unwrap();
        assert_refused(upload(&mut harness, &session, "a", &file).await, Code::InvalidArgument, "data", says);
    }
    assert!(names(&mut harness, &session).await.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn names_slots_and_sizes_are_bounded() {
    let mut harness = Harness::with(|config| config.session.max_checkpoints = 1).await;
    let session = harness.create().await.unwrap();
    let file = download(&mut harness, &session, "").await.unwrap();
    for name in ["", &"x".repeat(65)] {
        let refused = upload(&mut harness, &session, name, &file).await;
        assert_refused(refused, Code::InvalidArgument, "name", "name of 1 to 64 bytes");
    }
    assert_eq!(download(&mut harness, &session, "none").await.unwrap_err().code(), Code::NotFound);
    assert_eq!(upload(&mut harness, "none", "a", &file).await.unwrap_err().code(), Code::NotFound);
    let nothing = harness.sessions.upload_checkpoint(tokio_stream::empty()).await.map(|_| 0);
    assert_refused(nothing, Code::InvalidArgument, "session_id", "session_id: is required");
    upload(&mut harness, &session, "a", &file).await.unwrap();
    let refused = upload(&mut harness, &session, "b", &file).await;
    assert_refused(refused, Code::ResourceExhausted, "max_checkpoints", "keeps 1 checkpoints");
    upload(&mut harness, &session, "a", &file).await.unwrap();

    let limit = file.len() - 1;
    let mut harness = Harness::with(|config| config.transport.max_upload_bytes = limit).await;
    let session = harness.create().await.unwrap();
    let says = format!("more than {limit} bytes");
    let refused = upload(&mut harness, &session, "a", &file).await;
    assert_refused(refused, Code::ResourceExhausted, "max_upload_bytes", &says);
    let refused = download(&mut harness, &session, "").await.map(|_| 0);
    assert_refused(refused, Code::ResourceExhausted, "max_upload_bytes", &says);
    // One that never ends is refused as soon as it is too large.
    let (sender, endless) = mpsc::channel(1);
    tokio::spawn({
        let session_id = session.clone();
        async move {
            let part = v1::UploadCheckpointRequest { session_id, name: "a".into(), data: vec![0; 4096] };
            while sender.send(part.clone()).await.is_ok() {}
        }
    });
    let refused = soon("a refusal", harness.sessions.upload_checkpoint(ReceiverStream::new(endless))).await;
    assert_refused(refused.map(|_| 0), Code::ResourceExhausted, "max_upload_bytes", &says);
    assert!(names(&mut harness, &session).await.is_empty());
}

fn two(config: &mut ServerConfig) {
    config.transport.max_uploads = 2;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_is_not_fetched_gives_way_to_those_who_come_later() {
    let mut harness = Harness::with(two).await;
    // Larger than what waits in sockets and queues.
    let session = harness.create_of(BLOCK.replacen("resolution = 6", "resolution = 36", 1)).await.unwrap();
    harness.pause(&session).await;
    let file = download(&mut harness, &session, "").await.unwrap();
    assert!(file.len() > 1 << 20, "{} bytes", file.len());
    let narrow = endpoint(harness.server.address()).initial_stream_window_size(65_535);
    let mut slow = SessionServiceClient::new(narrow.connect().await.unwrap());
    let request = v1::DownloadCheckpointRequest { session_id: session.clone(), ..Default::default() };
    let mut first = slow.download_checkpoint(request.clone()).await.unwrap().into_inner();
    let mut second = slow.download_checkpoint(request).await.unwrap().into_inner();
    tokio::time::sleep(Duration::from_millis(200)).await;
    assert!(download(&mut harness, &session, "").await.unwrap() == file);
    let refused = loop {
        match soon("a part", first.message()).await {
            Ok(part) => assert!(part.is_some(), "it does not end as if it were whole"),
            Err(status) => break status,
        }
    };
    assert_refused(Err(refused), Code::ResourceExhausted, "max_uploads", "this one gives way");
    let mut fetched = Vec::new();
    while let Some(part) = soon("a part", second.message()).await.unwrap() {
        fetched.extend(part.data);
    }
    assert!(fetched == file, "the other goes on");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_not_whole_gives_way_to_those_who_come_later() {
    let mut harness = Harness::with(two).await;
    let session = harness.create().await.unwrap();
    let file = download(&mut harness, &session, "").await.unwrap();
    let mut crowd = harness.sessions.clone();
    let mut waiting = Vec::new();
    for name in ["first", "second"] {
        let (sender, trickle) = mpsc::channel(1);
        let part = v1::UploadCheckpointRequest { session_id: session.clone(), name: name.into(), data: vec![1; 100] };
        sender.send(part).await.unwrap();
        let mut client = crowd.clone();
        let call = tokio::spawn(async move { client.upload_checkpoint(ReceiverStream::new(trickle)).await });
        // Held open, and in this order.
        tokio::time::sleep(Duration::from_millis(200)).await;
        waiting.push((sender, call));
    }
    // Somebody else, over another connection, finds a place.
    let channel = connect(harness.server.address()).await;
    harness.sessions = SessionServiceClient::new(channel);
    upload(&mut harness, &session, "third", &file).await.unwrap();
    let (_sender, first) = waiting.remove(0);
    let refused = soon("the refusal of the oldest", first).await.unwrap().map(|_| 0);
    assert_refused(refused, Code::ResourceExhausted, "max_uploads", "this one gives way");
    // One that breaks off leaves nothing.
    let (_, second) = waiting.remove(0);
    assert_eq!(soon("the end of the other", second).await.unwrap().unwrap_err().code(), Code::InvalidArgument);
    assert_eq!(names(&mut harness, &session).await, ["third"]);
    let listed = crowd.list_sessions(v1::ListSessionsRequest {}).await.unwrap().into_inner();
    assert_eq!(listed.sessions.len(), 1, "the crowd's connection goes on");
}
