//! What a browser needs of the server's port: pages, and calls as gRPC-Web over HTTP/1.1.

use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, get_scene_request};
use kerf_server::config::ServerConfig;
use kerf_server::serve::Server;
use prost::Message;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tonic::Code;

use super::harness::{Harness, endpoint, soon};

/// Head and body of the answer to a request over HTTP/1.1.
async fn ask(harness: &Harness, head: &str, body: &[u8]) -> (String, Vec<u8>) {
    ask_by(harness, "localhost", head, body).await
}

/// The same of a page that knows the server by another name.
async fn ask_by(harness: &Harness, host: &str, head: &str, body: &[u8]) -> (String, Vec<u8>) {
    soon("an answer", async {
        let mut stream = TcpStream::connect(harness.server.address()).await.unwrap();
        let length = body.len();
        let head = format!("{head}\r\nhost: {host}\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n");
        stream.write_all(head.as_bytes()).await.unwrap();
        stream.write_all(body).await.unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).await.unwrap();
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").expect("a head");
        (String::from_utf8_lossy(&answer[..end]).to_lowercase(), answer.split_off(end + 4))
    })
    .await
}

#[tokio::test]
async fn the_port_of_the_services_has_a_page_whether_the_viewer_was_built_or_not() {
    let harness = Harness::start().await;
    let (head, body) = ask(&harness, "GET / HTTP/1.1", &[]).await;
    assert!(head.starts_with("http/1.1 200") && head.contains("text/html"), "{head}");
    assert!(head.contains("content-security-policy: default-src 'self'"), "{head}");
    assert!(String::from_utf8_lossy(&body).contains("Kerf"));
    let (head, _) = ask(&harness, "GET /nothing.js HTTP/1.1", &[]).await;
    assert!(head.starts_with("http/1.1 404"), "{head}");
}

#[tokio::test]
async fn the_port_of_the_services_has_the_documents_whether_the_book_was_built_or_not() {
    let harness = Harness::start().await;
    let (head, _) = ask(&harness, "GET /docs HTTP/1.1", b"").await;
    assert!(head.starts_with("http/1.1 308") && head.contains("location: /docs/"), "{head}");
    let (head, body) = ask(&harness, "GET /docs/ HTTP/1.1", b"").await;
    let text = String::from_utf8(body).expect("a page or a word");
    if head.starts_with("http/1.1 200") {
        assert!(text.contains("<title>Kerf"), "{text}");
    } else {
        assert!(head.starts_with("http/1.1 404") && text.contains("make docs"), "{head}\n{text}");
    }
    let (head, _) = ask(&harness, "GET /docs/none.html HTTP/1.1", b"").await;
    assert!(head.starts_with("http/1.1 404"), "{head}");
}

#[tokio::test]
async fn a_browser_calls_by_grpc_web() {
    let harness = Harness::start().await;
    // An empty message: a flag and a length of 0.
    let head = "POST /kerf.v1.SessionService/ListScenes HTTP/1.1\r\ncontent-type: application/grpc-web+proto";
    let (head, body) = ask(&harness, head, &[0; 5]).await;
    assert!(head.starts_with("http/1.1 200") && head.contains("application/grpc-web"), "{head}");
    let text = String::from_utf8_lossy(&body);
    assert!(text.contains("gummy-bear") && text.contains("grpc-status:0"), "{text}");
}

/// A page of another origin may not read what this server says, and its calls need a leave that is not given.
#[tokio::test]
async fn pages_of_other_origins_are_given_no_leave() {
    let harness = Harness::start().await;
    let head = "OPTIONS /kerf.v1.SessionService/ListScenes HTTP/1.1\r\norigin: http://elsewhere.example\r\n\
                access-control-request-method: POST\r\naccess-control-request-headers: content-type";
    let (head, _) = ask(&harness, head, &[]).await;
    assert!(!head.contains("access-control-allow"), "{head}");
}

#[tokio::test]
async fn a_page_whose_name_was_made_to_mean_this_machine_gets_nothing() {
    let mut harness = Harness::start().await;
    let port = harness.server.address().port();
    let create = "POST /kerf.v1.SessionService/CreateSession HTTP/1.1\r\ncontent-type: application/grpc-web+proto";
    let scene = Some(v1::create_session_request::Scene::SceneName("jelly".into()));
    let message = v1::CreateSessionRequest { scene, ..Default::default() }.encode_to_vec();
    let message = [&[0], &(message.len() as u32).to_be_bytes()[..], &message].concat();
    for (host, origin, is_ours) in [
        (format!("rebound.example:{port}"), format!("http://rebound.example:{port}"), false),
        (format!("localhost:{port}"), "http://elsewhere.example".into(), false),
        (format!("localhost:{port}"), "null".into(), false),
        (format!("127.0.0.1:{port}"), format!("http://127.0.0.1:{port}"), true),
    ] {
        let (page, _) = ask_by(&harness, &host, &format!("GET / HTTP/1.1\r\norigin: {origin}"), &[]).await;
        assert!(page.starts_with(if is_ours { "http/1.1 200" } else { "http/1.1 403" }), "{host} {origin}: {page}");
        let (called, _) = ask_by(&harness, &host, &format!("{create}\r\norigin: {origin}"), &message).await;
        let is_denied = called.contains("grpc-status: 7") && called.contains("this%20server");
        assert_eq!(is_denied, !is_ours, "{host} {origin}: {called}");
        assert_eq!(harness.server.registry().list().is_empty(), !is_ours, "{host} {origin}");
    }
    let endpoint = endpoint(harness.server.address()).origin("http://rebound.example".parse().unwrap());
    harness.sessions = SessionServiceClient::new(endpoint.connect().await.unwrap());
    let refused = harness.sessions.list_sessions(v1::ListSessionsRequest {}).await.unwrap_err();
    assert_eq!(refused.code(), Code::PermissionDenied);
    assert!(refused.message().starts_with("host \"rebound.example\": "), "{refused}");
}

/// What a browser asks before a page of another origin may call.
fn preflight(origin: &str) -> String {
    format!(
        "OPTIONS /kerf.v1.SessionService/CreateSession HTTP/1.1\r\norigin: {origin}\r\n\
         access-control-request-method: POST\r\naccess-control-request-headers: authorization,content-type,x-grpc-web"
    )
}

#[tokio::test]
async fn a_page_of_an_allowed_origin_is_given_leave_and_calls() {
    let allowed = "https://lab.example:8443";
    let harness = Harness::with(|config| config.security.allowed_origins = vec![allowed.into()]).await;
    let leave = format!("access-control-allow-origin: {allowed}");
    let (head, _) = ask(&harness, &preflight(allowed), &[]).await;
    assert!(head.starts_with("http/1.1 200") && head.contains(&leave), "{head}");
    let given = |name: &str| {
        let line = head.lines().find(|line| line.starts_with(name));
        line.unwrap_or_else(|| panic!("{name}: {head}")).to_owned()
    };
    assert!(given("access-control-allow-methods").contains("post"), "{head}");
    for name in ["authorization", "content-type", "x-grpc-web"] {
        assert!(given("access-control-allow-headers").contains(name), "{name}: {head}");
    }
    let call = format!(
        "POST /kerf.v1.SessionService/ListScenes HTTP/1.1\r\ncontent-type: application/grpc-web+proto\r\norigin: {allowed}"
    );
    let (head, body) = ask(&harness, &call, &[0; 5]).await;
    assert!(head.starts_with("http/1.1 200") && head.contains(&leave), "{head}");
    assert!(head.contains("access-control-expose-headers: grpc-status"), "{head}");
    assert!(String::from_utf8_lossy(&body).contains("grpc-status:0"), "{head}");
}

#[tokio::test]
async fn a_page_of_an_origin_that_resembles_an_allowed_one_drives_nothing() {
    let allowed = "https://lab.example:8443";
    let harness = Harness::with(|config| config.security.allowed_origins = vec![allowed.into()]).await;
    let create = "POST /kerf.v1.SessionService/CreateSession HTTP/1.1\r\ncontent-type: application/grpc-web+proto";
    let scene = Some(v1::create_session_request::Scene::SceneName("jelly".into()));
    let message = v1::CreateSessionRequest { scene, ..Default::default() }.encode_to_vec();
    let message = [&[0], &(message.len() as u32).to_be_bytes()[..], &message].concat();
    for (host, origin) in [
        ("localhost", "https://lab.example"),
        ("localhost", "http://lab.example:8443"),
        ("localhost", "https://lab.example:8443.elsewhere.example"),
        ("localhost", "https://a.lab.example:8443"),
        ("localhost", "null"),
        // The page is one of ours, and the name of the server was made to mean this machine.
        ("rebound.example", allowed),
    ] {
        let (head, _) = ask_by(&harness, host, &preflight(origin), &[]).await;
        assert_eq!(head.contains("access-control-allow-origin"), origin == allowed, "{host} {origin}: {head}");
        let (called, _) = ask_by(&harness, host, &format!("{create}\r\norigin: {origin}"), &message).await;
        assert!(called.contains("grpc-status: 7") && called.contains("this%20server"), "{host} {origin}: {called}");
        assert!(harness.server.registry().list().is_empty(), "{host} {origin}");
    }
    let (_, _) = ask(&harness, &format!("{create}\r\norigin: {allowed}"), &message).await;
    assert_eq!(harness.server.registry().list().len(), 1);
}

#[tokio::test]
async fn a_server_with_a_bad_origin_does_not_start() {
    let mut config = ServerConfig { listen: ([127, 0, 0, 1], 0).into(), ..ServerConfig::default() };
    config.security.allowed_origins = vec!["https://lab.example".into(), "https://*.lab.example/".into()];
    let error = format!("{:#}", Server::start(config).await.err().expect("a refusal"));
    assert!(error.starts_with("security.allowed_origins: \"https://*.lab.example/\""), "{error}");
}

#[tokio::test]
async fn the_text_of_a_scene_makes_the_same_scene() {
    let mut harness = Harness::start().await;
    let session_id = harness.create().await.unwrap();
    let of = Some(get_scene_request::Of::SessionId(session_id.clone()));
    let scene_toml = harness.sessions.get_scene(v1::GetSceneRequest { of }).await.unwrap().into_inner().scene_toml;
    let scene = Some(v1::create_session_request::Scene::SceneToml(scene_toml));
    let request =
        v1::CreateSessionRequest { scene, start_paused: true, dial: None, step_rate_hz: None, ..Default::default() };
    let again = harness.sessions.create_session(request).await.unwrap().into_inner().session.unwrap();
    assert_eq!(again.scene, harness.describe(&session_id).await.scene);
    let of = Some(get_scene_request::Of::SceneName("liver".into()));
    let liver = harness.sessions.get_scene(v1::GetSceneRequest { of }).await.unwrap().into_inner().scene_toml;
    assert!(liver.contains("smooth_union"), "{liver}");
}

#[tokio::test]
async fn a_session_that_stands_is_stepped_by_hand() {
    let mut harness = Harness::start().await;
    let session_id = harness.create().await.unwrap();
    let stood = harness.pause(&session_id).await;
    let request = |steps| v1::StepSessionRequest { session_id: session_id.clone(), steps, inputs: Vec::new() };
    let last = harness.sessions.step_session(request(7)).await.unwrap().into_inner().step;
    let described = harness.describe(&session_id).await;
    assert_eq!((last, described.step, described.state()), (stood + 7, stood + 7, v1::SessionState::Paused));
    let refused = harness.sessions.step_session(request(0)).await.unwrap_err();
    assert_eq!(refused.message(), "steps = 0: must be 1 to 1000");
}
