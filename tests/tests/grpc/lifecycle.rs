//! Sessions and the server itself: beginning, end, and what others may ask of it.

use std::time::{Duration, Instant};

use kerf_physics::Stage;
use kerf_proto::v1::{self, create_session_request, view_response};
use kerf_server::serve::Drained;
use tonic::Code;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;
use tonic_reflection::pb::{v1 as reflection, v1alpha as reflection_v1alpha};

use super::harness::{BLOCK, Harness, connect, pose, soon};

#[tokio::test]
async fn several_sessions_live_side_by_side_up_to_the_limit() {
    let mut harness = Harness::with(|config| config.session.max_sessions = 3).await;
    let ids = [harness.create().await.unwrap(), harness.create().await.unwrap(), harness.create().await.unwrap()];
    let full = harness.create().await.unwrap_err();
    assert_eq!(full.code(), Code::ResourceExhausted);
    assert!(full.message().contains("max_sessions"), "{}", full.message());
    for (index, id) in ids.iter().enumerate() {
        let mut station = harness.drive(id, &[0]).await.unwrap();
        let seq = 10 + index as u64;
        station.send(pose(0, seq, 0.0)).await;
        station.contact_where(|contact| contact.echo_seq == seq).await;
    }
    let listed = harness.sessions.list_sessions(v1::ListSessionsRequest {}).await.unwrap().into_inner().sessions;
    assert_eq!(listed.iter().map(|info| info.session_id.clone()).collect::<Vec<_>>(), ids);
    harness.sessions.close_session(v1::CloseSessionRequest { session_id: ids[1].clone() }).await.unwrap();
    assert!(harness.create().await.is_ok());
}

#[tokio::test]
async fn a_server_that_drains_takes_no_sessions_and_goes_on_with_those_it_has_until_they_end() {
    let mut harness = Harness::with(|config| config.session.drain_s = 600.0).await;
    let session_id = harness.create().await.unwrap();
    let mut health = HealthClient::new(harness.channel.clone());
    let mut sessions = harness.sessions.clone();
    let clients = async {
        let check = HealthCheckRequest { service: String::new() };
        while health.check(check.clone()).await.unwrap().into_inner().status() == ServingStatus::Serving {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        let sessions_hang = HealthCheckRequest { service: "kerf.sessions".into() };
        assert_eq!(health.check(sessions_hang).await.unwrap().into_inner().status(), ServingStatus::Serving);
        // The check may be ahead of the sessions by a moment; what began in it goes on as others do.
        let refused = loop {
            let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
            match sessions.create_session(v1::CreateSessionRequest { scene, ..Default::default() }).await {
                Ok(created) => {
                    let session_id = created.into_inner().session.unwrap().session_id;
                    sessions.close_session(v1::CloseSessionRequest { session_id }).await.unwrap();
                }
                Err(refused) => break refused,
            }
        };
        assert_eq!(refused.code(), Code::Unavailable);
        assert!(refused.message().contains("600 s to end (session.drain_s)"), "{refused}");
        // Whoever comes back to a session finds it.
        let mut station = harness.drive(&session_id, &[0]).await.unwrap();
        station.send(pose(0, 1, 0.0)).await;
        station.contact_where(|contact| contact.echo_seq == 1).await;
        sessions.close_session(v1::CloseSessionRequest { session_id: session_id.clone() }).await.unwrap();
    };
    soon("the end of the drain", async { tokio::join!(harness.server.drain(), clients) }).await;
    assert_eq!(harness.server.stop().await, Drained::Cleanly);
}

#[tokio::test]
async fn a_session_that_is_closed_in_a_drain_leaves_no_journal_that_would_bring_it_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = Harness::with(|config| {
        config.session.drain_s = 600.0;
        config.journal_dir = Some(folder.path().into());
    })
    .await;
    let session_id = harness.create().await.unwrap();
    let mut sessions = harness.sessions.clone();
    let closing =
        tokio::spawn(async move { sessions.close_session(v1::CloseSessionRequest { session_id }).await.map(drop) });
    // It is not among the sessions any more, and its journal is still being ended.
    soon("the session's end", async {
        while !harness.server.registry().list().is_empty() {
            tokio::task::yield_now().await;
        }
    })
    .await;
    soon("the end of the drain", harness.server.drain()).await;
    assert_eq!(harness.server.stop().await, Drained::Cleanly);
    closing.await.unwrap().expect("the answer comes before the server's end");
    let names = folder.path().read_dir().unwrap().map(|entry| entry.unwrap().path());
    let journals: Vec<_> = names.filter(|path| path.extension().is_some_and(|extension| extension == "mcap")).collect();
    assert!(journals.is_empty(), "{journals:?}");
}

#[tokio::test]
async fn a_drain_ends_when_its_time_is_over_and_without_one_at_once() {
    let mut harness = Harness::with(|config| config.session.drain_s = 0.3).await;
    harness.create().await.unwrap();
    let began = Instant::now();
    soon("the end of the drain", harness.server.drain()).await;
    assert!(began.elapsed() >= Duration::from_millis(300), "{:?}", began.elapsed());
    assert_eq!(harness.server.registry().list().len(), 1, "it ends with the server alone");
    let mut harness = Harness::start().await;
    harness.create().await.unwrap();
    harness.server.drain().await;
    assert!(harness.create().await.is_ok(), "nothing drains unless it is asked for");
}

#[tokio::test]
async fn a_session_pauses_resumes_resets_and_closes() {
    let mut harness = Harness::start().await;
    let session_id = harness.create().await.unwrap();
    harness.until(&session_id, |described| described.step > 10).await;
    let stood = harness.pause(&session_id).await;
    tokio::time::sleep(Duration::from_millis(50)).await;
    let described = harness.describe(&session_id).await;
    assert_eq!((described.step, described.state()), (stood, v1::SessionState::Paused));
    harness.reset(&session_id).await;
    assert_eq!(harness.describe(&session_id).await.step, 0);
    let resume = v1::ResumeSessionRequest { session_id: session_id.clone() };
    assert_eq!(harness.sessions.resume_session(resume).await.unwrap().into_inner().step, 0);
    harness.until(&session_id, |described| described.step > 10).await;
    let station = harness.drive(&session_id, &[0]).await.unwrap();
    let close = v1::CloseSessionRequest { session_id: session_id.clone() };
    harness.sessions.close_session(close.clone()).await.unwrap();
    assert_eq!(station.end().await, Code::Ok);
    assert_eq!(harness.sessions.close_session(close).await.unwrap_err().code(), Code::NotFound);
}

#[tokio::test]
async fn a_session_may_begin_paused() {
    let mut harness = Harness::start().await;
    let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
    let request = v1::CreateSessionRequest { scene, start_paused: true, ..Default::default() };
    let session = harness.sessions.create_session(request).await.unwrap().into_inner().session.unwrap();
    assert_eq!((session.step, session.state()), (0, v1::SessionState::Paused));
    let scene = session.scene.unwrap();
    assert_eq!((scene.name.as_str(), scene.dt_s, scene.stage_names.len()), ("block", 0.002, Stage::ALL.len()));
}

#[tokio::test]
async fn a_client_may_ask_for_a_step_rate() {
    let mut harness = Harness::start().await;
    let mut create = async |step_rate_hz| {
        let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
        let request = v1::CreateSessionRequest { scene, step_rate_hz: Some(step_rate_hz), ..Default::default() };
        harness.sessions.create_session(request).await.map(|reply| reply.into_inner().session.unwrap().scene.unwrap())
    };
    assert_eq!(create(250.0).await.unwrap().dt_s, 0.004);
    for beyond in [0.0, 1e9, f64::NAN] {
        let refused = create(beyond).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument);
        assert!(refused.message().contains("step_rate_hz"), "{}", refused.message());
    }
}

#[tokio::test]
async fn scenes_that_are_none_are_refused_with_the_reason() {
    let mut harness = Harness::start().await;
    let mut refused = async |scene| {
        let request = v1::CreateSessionRequest { scene, ..Default::default() };
        harness.sessions.create_session(request).await.unwrap_err()
    };
    let toml = |text: String| Some(create_session_request::Scene::SceneToml(text));
    assert_eq!(refused(None).await.code(), Code::InvalidArgument);
    let misspelt = refused(toml(BLOCK.replace("rate_hz", "rate_herz"))).await;
    assert_eq!(misspelt.code(), Code::InvalidArgument);
    assert!(misspelt.message().contains("rate_herz"), "{}", misspelt.message());
    assert_eq!(refused(toml(BLOCK.replace("500.0", "1e9"))).await.code(), Code::InvalidArgument);
    let unknown = Some(create_session_request::Scene::SceneName("no-such-scene".into()));
    assert_eq!(refused(unknown).await.code(), Code::NotFound);
}

#[tokio::test]
async fn health_answers_for_the_server_and_for_each_service() {
    let harness = Harness::start().await;
    let mut health = HealthClient::new(harness.channel.clone());
    for service in ["", "kerf.v1.SessionService", "kerf.v1.ControlService", "kerf.v1.ViewService"] {
        let answer = health.check(HealthCheckRequest { service: service.into() }).await.unwrap();
        assert_eq!(answer.into_inner().status(), ServingStatus::Serving, "{service:?}");
    }
}

#[tokio::test]
async fn reflection_answers_in_both_of_its_versions() {
    let harness = Harness::start().await;
    let request = reflection::ServerReflectionRequest {
        host: String::new(),
        message_request: Some(reflection::server_reflection_request::MessageRequest::ListServices(String::new())),
    };
    let mut client = reflection::server_reflection_client::ServerReflectionClient::new(harness.channel.clone());
    let mut answers = client.server_reflection_info(tokio_stream::once(request)).await.unwrap().into_inner();
    let answer = answers.message().await.unwrap().unwrap().message_response;
    let Some(reflection::server_reflection_response::MessageResponse::ListServicesResponse(list)) = answer else {
        panic!("a list of services, not {answer:?}")
    };
    assert!(list.service.iter().any(|service| service.name == "kerf.v1.ControlService"));

    let request = reflection_v1alpha::ServerReflectionRequest {
        host: String::new(),
        message_request: Some(reflection_v1alpha::server_reflection_request::MessageRequest::FileContainingSymbol(
            "kerf.v1.ToolPose".into(),
        )),
    };
    let mut client = reflection_v1alpha::server_reflection_client::ServerReflectionClient::new(harness.channel.clone());
    let mut answers = client.server_reflection_info(tokio_stream::once(request)).await.unwrap().into_inner();
    let answer = answers.message().await.unwrap().unwrap().message_response;
    use reflection_v1alpha::server_reflection_response::MessageResponse::FileDescriptorResponse;
    assert!(matches!(answer, Some(FileDescriptorResponse(files)) if !files.file_descriptor_proto.is_empty()));
}

#[tokio::test]
async fn a_server_that_stops_tells_its_streams_ends_its_sessions_and_accepts_nobody() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let mut view = harness.view(harness.channel.clone(), &session).await;
    let station = harness.drive(&session, &[0]).await.unwrap();
    let address = harness.server.address();
    let registry = harness.server.registry().clone();
    let reader = tokio::spawn(async move {
        let mut last = None;
        while let Some(message) = view.message().await.expect("a good end") {
            last = Some(message);
        }
        last
    });
    let ended = tokio::spawn(station.end());
    drop((harness.channel, harness.sessions));
    assert_eq!(soon("the end", harness.server.stop()).await, Drained::Cleanly);
    assert_eq!(ended.await.unwrap(), Code::Ok);
    let last = reader.await.unwrap();
    assert!(matches!(last, Some(view_response::Message::Event(event)) if event.kind() == v1::EventKind::Closing));
    assert!(registry.list().is_empty());
    assert!(tokio::net::TcpStream::connect(address).await.is_err());
}

#[tokio::test]
async fn a_client_that_does_not_let_go_delays_the_stop_no_longer_than_the_limit() {
    let mut harness = Harness::with(|config| config.transport.drain_timeout_s = 0.3).await;
    harness.create().await.unwrap();
    let mut health = HealthClient::new(connect(harness.server.address()).await);
    // A watch never ends by itself.
    let _watch = health.watch(HealthCheckRequest { service: String::new() }).await.unwrap();
    assert_eq!(soon("the end", harness.server.stop()).await, Drained::Forcibly);
}
