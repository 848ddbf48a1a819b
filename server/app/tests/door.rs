//! Who may do what: each call by the role of a token, and sessions by whose they are.

use std::time::Duration;

use kerf_proto::PROTOCOL_VERSION;
use kerf_proto::codec::StrictCodec;
use kerf_proto::v1::control_service_client::ControlServiceClient;
use kerf_proto::v1::view_service_client::ViewServiceClient;
use kerf_proto::v1::{self, control_request};
use kerf_server::security::roles::{CALLS, Need, Role};
use tonic::{Code, Request, Status};
use tonic_types::StatusExt;

use super::process::soon;
use super::secured::{Secured, create, list, make_token};

/// What a call with an empty message is answered by.
async fn call(secured: &Secured, token: Option<&str>, path: &str) -> Option<Status> {
    let mut client = tonic::client::Grpc::new(secured.connect(token).await);
    client.ready().await.unwrap();
    let codec = StrictCodec::<v1::ListSessionsRequest, v1::ListSessionsRequest>::default();
    let request = Request::new(v1::ListSessionsRequest {});
    soon(path, client.server_streaming(request, path.parse().unwrap(), codec)).await.err()
}

#[tokio::test(flavor = "multi_thread")]
async fn each_call_takes_the_role_of_its_row_and_no_less() {
    let secured = Secured::start(|config| config.security.max_wrong_tokens_per_minute = 1000).await;
    std::fs::write(secured.folder.path().join("stranger"), "A".repeat(43)).unwrap();
    let callers = [
        (None, None),
        (Some("stranger"), None),
        (Some("viewer"), Some(Role::Viewer)),
        (Some("anna"), Some(Role::Driver)),
        (Some("operator"), Some(Role::Operator)),
    ];
    for (path, need) in CALLS {
        for (token, role) in callers {
            let answered = call(&secured, token, path).await;
            let code = answered.as_ref().map_or(Code::Ok, Status::code);
            let expected = match (need, role) {
                (Need::Nothing, _) => None,
                (Need::Role(_), None) => Some(Code::Unauthenticated),
                (Need::Role(needed), Some(role)) => (role < *needed).then_some(Code::PermissionDenied),
            };
            let refused = [Code::Unauthenticated, Code::PermissionDenied].into_iter().find(|refused| *refused == code);
            assert_eq!(refused, expected, "{path} by {token:?}: {answered:?}");
        }
    }
    let unknown = call(&secured, Some("operator"), "/kerf.v1.SessionService/DropTables").await.unwrap();
    assert_eq!(unknown.code(), Code::PermissionDenied);
    let named = call(&secured, Some("viewer"), "/kerf.v1.SessionService/PauseSession").await.unwrap();
    assert!(named.message().contains("\"viewer\" is a viewer's"), "{named}");
}

/// What each call about a session answers to somebody.
async fn codes(secured: &Secured, token: &str, session: &str) -> [Code; 5] {
    let code = |outcome: Result<(), Status>| match outcome.map_err(|status| status.code()) {
        // Somebody before has the tool for as long as a lease lasts: the door had let this one in.
        Ok(()) | Err(Code::FailedPrecondition) => Code::Ok,
        Err(code) => code,
    };
    let wire = secured.connect(Some(token)).await;
    let mut sessions = secured.sessions(token).await;
    let session_id = || session.to_owned();
    let request = v1::DescribeSessionRequest { session_id: session_id() };
    let described = sessions.describe_session(request).await.map(drop);
    let request = v1::ResetSessionRequest { session_id: session_id() };
    let reset = sessions.reset_session(request).await.map(drop);
    let request =
        v1::ViewRequest { protocol_version: PROTOCOL_VERSION, session_id: session_id(), ..Default::default() };
    let viewed = ViewServiceClient::new(wire.clone()).view(request).await.map(drop);
    let lift = v1::send_pose_request::Motion::Lift(v1::LiftTool { tool_id: 0 });
    let request = v1::SendPoseRequest { session_id: session_id(), lease: String::new(), motion: Some(lift) };
    let mut control = ControlServiceClient::new(wire);
    let posed = control.send_pose(request).await.map(drop);
    let hello = v1::ClientHello {
        protocol_version: PROTOCOL_VERSION,
        session_id: session_id(),
        tool_ids: vec![1],
        ..Default::default()
    };
    let first = v1::ControlRequest { message: Some(control_request::Message::Hello(hello)), received: 0 };
    let driven = control.control(futures_util::stream::iter([first])).await.map(drop);
    [described, reset, viewed, posed, driven].map(code)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_private_session_is_its_owners_and_operators_and_whose_a_token_names_it() {
    let secured = Secured::start(|_| ()).await;
    let [mut anna, mut ben, mut operator] =
        [secured.sessions("anna").await, secured.sessions("ben").await, secured.sessions("operator").await];
    let (shared, own) = (create(&mut anna, false).await.unwrap(), create(&mut anna, true).await.unwrap());
    assert_eq!(list(&mut ben).await.unwrap(), [&*shared]);
    for somebody in [&mut anna, &mut operator] {
        assert_eq!(list(somebody).await.unwrap(), [&*shared, &own]);
    }
    assert_eq!(codes(&secured, "ben", &own).await, [Code::NotFound; 5]);
    assert_eq!(codes(&secured, "ben", &shared).await, [Code::Ok; 5]);
    assert_eq!(codes(&secured, "anna", &own).await, [Code::Ok; 5]);
    assert_eq!(codes(&secured, "operator", &own).await, [Code::Ok; 5]);
    assert_eq!(codes(&secured, "viewer", &own).await[0], Code::NotFound);

    // Made while the server runs, for one session.
    make_token(secured.folder.path(), "guest", "viewer", &["--session", &own]);
    make_token(secured.folder.path(), "helper", "driver", &["--session", &own]);
    soon("the new tokens", async {
        while call(&secured, Some("helper"), "/kerf.v1.SessionService/ListSessions").await.is_some() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    })
    .await;
    let mut helper = secured.sessions("helper").await;
    assert_eq!(list(&mut helper).await.unwrap(), [&*own]);
    assert_eq!(codes(&secured, "helper", &shared).await, [Code::NotFound; 5]);
    assert_eq!(create(&mut helper, false).await.unwrap_err().code(), Code::PermissionDenied);
    assert_eq!(
        codes(&secured, "guest", &own).await,
        [Code::Ok, Code::PermissionDenied, Code::Ok, Code::PermissionDenied, Code::PermissionDenied]
    );

    let close = |id: &str| v1::CloseSessionRequest { session_id: id.into() };
    assert_eq!(ben.close_session(close(&shared)).await.unwrap_err().code(), Code::PermissionDenied);
    assert_eq!(ben.close_session(close(&own)).await.unwrap_err().code(), Code::NotFound);
    anna.close_session(close(&shared)).await.unwrap();
    operator.close_session(close(&own)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_private_session_that_its_journal_brings_back_is_private_still() {
    let journals = tempfile::tempdir().unwrap();
    let with_journals =
        |config: &mut kerf_server::config::ServerConfig| config.journal_dir = Some(journals.path().into());
    let secured = Secured::start(with_journals).await;
    let own = create(&mut secured.sessions("anna").await, true).await.unwrap();
    let Secured { server, folder } = secured;
    server.stop().await;
    let secured = Secured::again(folder, with_journals).await;
    while secured.server.registry().expected() > 0 {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert_eq!(list(&mut secured.sessions("anna").await).await.unwrap(), [&*own]);
    assert_eq!(list(&mut secured.sessions("ben").await).await.unwrap(), [""; 0]);
    secured.server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_has_as_many_sessions_as_it_may_and_others_theirs() {
    let secured = Secured::start(|config| config.security.max_sessions_per_token = 1).await;
    let mut anna = secured.sessions("anna").await;
    let mut again = anna.clone();
    let (first, second) = tokio::join!(create(&mut anna, false), create(&mut again, true));
    let refused = first.and(second).unwrap_err();
    assert_eq!(refused.code(), Code::ResourceExhausted);
    let quota = refused.get_details_quota_failure().unwrap();
    assert_eq!(quota.violations[0].subject, "max_sessions_per_token");
    create(&mut secured.sessions("ben").await, false).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn wrong_tokens_are_bounded_and_keep_out_no_right_one() {
    let secured = Secured::start(|config| config.security.max_wrong_tokens_per_minute = 3).await;
    std::fs::write(secured.folder.path().join("stranger"), "wrong").unwrap();
    let mut stranger = secured.sessions("stranger").await;
    for _ in 0..3 {
        assert_eq!(list(&mut stranger).await.unwrap_err().code(), Code::Unauthenticated);
    }
    let refused = list(&mut stranger).await.unwrap_err();
    assert_eq!(refused.code(), Code::ResourceExhausted);
    assert!(refused.message().contains("max_wrong_tokens_per_minute"), "{refused}");
    list(&mut secured.sessions("viewer").await).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_that_is_taken_back_or_has_expired_is_good_for_nothing_and_a_broken_file_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["viewer", "anna", "ben"] {
        make_token(folder.path(), name, if name == "viewer" { "viewer" } else { "driver" }, &[]);
    }
    // A second, in days.
    make_token(folder.path(), "late", "viewer", &["--days", "0.0000116"]);
    let secured = Secured::again(folder, |_| ()).await;
    let file = secured.folder.path().join("tokens.toml");
    let before = std::fs::read_to_string(&file).unwrap();
    let mut viewer = secured.sessions("viewer").await;
    let session_id = create(&mut secured.sessions("anna").await, false).await.unwrap();
    let view = async |token: &str| {
        let (protocol_version, session_id) = (PROTOCOL_VERSION, session_id.clone());
        let request = v1::ViewRequest { protocol_version, session_id, ..Default::default() };
        let mut client = ViewServiceClient::new(secured.connect(Some(token)).await);
        client.view(request).await.unwrap().into_inner()
    };
    let (mut seen, mut seen_by_other) = (view("viewer").await, view("ben").await);
    let skip = async |seen: &mut tonic::Streaming<v1::ViewResponse>| while let Ok(Some(_)) = seen.message().await {};
    std::fs::write(&file, "[[token]]\nname = 3").unwrap();
    tokio::time::sleep(Duration::from_millis(1500)).await;
    list(&mut viewer).await.unwrap();
    assert_eq!(list(&mut secured.sessions("late").await).await.unwrap_err().code(), Code::Unauthenticated);
    let others = before.split("[[token]]").filter(|entry| !entry.contains("\"viewer\"")).collect::<Vec<_>>();
    std::fs::write(&file, others.join("[[token]]")).unwrap();
    soon("the end of the token", async {
        while list(&mut viewer).await.is_ok() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    })
    .await;
    assert_eq!(list(&mut viewer).await.unwrap_err().code(), Code::Unauthenticated);
    // Streams that stand end with their token, and no others.
    soon("the end of the view", skip(&mut seen)).await;
    assert!(tokio::time::timeout(Duration::from_millis(1500), skip(&mut seen_by_other)).await.is_err());
    list(&mut secured.sessions("anna").await).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_guest_views_the_session_of_its_link_until_its_host_is_known_no_more() {
    let secured = Secured::start(|config| config.security.max_guests = 1).await;
    let mut anna = secured.sessions("anna").await;
    let (own, shared) = (create(&mut anna, true).await.unwrap(), create(&mut anna, false).await.unwrap());
    let invite = |id: &str| v1::InviteViewerRequest { session_id: id.into() };
    let refused = secured.sessions("ben").await.invite_viewer(invite(&own)).await.unwrap_err();
    assert_eq!(refused.code(), Code::NotFound);
    let invited = anna.invite_viewer(invite(&own)).await.unwrap().into_inner();
    assert!(invited.good_for_s > 3600.0);
    std::fs::write(secured.folder.path().join("guest"), &invited.token).unwrap();
    let refused = anna.invite_viewer(invite(&own)).await.unwrap_err();
    assert!(refused.code() == Code::ResourceExhausted && refused.message().contains("max_guests"), "{refused}");

    let mut guest = secured.sessions("guest").await;
    assert_eq!(list(&mut guest).await.unwrap(), [&*own]);
    assert_eq!(
        codes(&secured, "guest", &own).await,
        [Code::Ok, Code::PermissionDenied, Code::Ok, Code::PermissionDenied, Code::PermissionDenied]
    );
    assert_eq!(codes(&secured, "guest", &shared).await[0], Code::NotFound);
    let file = secured.folder.path().join("tokens.toml");
    let tokens = std::fs::read_to_string(&file).unwrap();
    let others = tokens.split("[[token]]").filter(|entry| !entry.contains("\"anna\"")).collect::<Vec<_>>();
    std::fs::write(&file, others.join("[[token]]")).unwrap();
    soon("the end of the guest", async {
        while list(&mut guest).await.is_ok() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn where_no_tokens_are_asked_for_nobody_is_anybodys_guest_and_nothing_is_private() {
    let secured = Secured::start(|config| config.security = kerf_server::config::SecurityConfig::default()).await;
    let address = format!("http://{}", secured.server.address());
    let channel = tonic::transport::Endpoint::from_shared(address).unwrap().connect().await.unwrap();
    let wire = kerf_access::Access::default().token().unwrap().over(channel);
    let mut anybody = v1::session_service_client::SessionServiceClient::new(wire);
    assert_eq!(create(&mut anybody, true).await.unwrap_err().code(), Code::FailedPrecondition);
    let session_id = create(&mut anybody, false).await.unwrap();
    let refused = anybody.invite_viewer(v1::InviteViewerRequest { session_id }).await.unwrap_err();
    assert_eq!(refused.code(), Code::FailedPrecondition);
}
