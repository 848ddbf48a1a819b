//! A server that is killed leaves recordings that are whole but for the last moment.

use std::process::{Command, Stdio};
use std::time::Duration;

use kerf_physics::Workers;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, create_session_request};
use kerf_server::recording::reader::{Ending, Recording};
use kerf_server::recording::verify::verify;

const BLOCK: &str = include_str!("../../session/tests/block.toml");
/// More than a chunk's half second: the machine has other things to do.
const LOST_S: f64 = 1.0;

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_ends_shortly_before_its_server_was_killed_and_verifies() {
    let folder = tempfile::tempdir().unwrap();
    let address = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap();
    let set = format!("record_dir={}", folder.path().display());
    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    command.args(["serve", "--listen", &address.to_string(), "--set", &set, "--log-filter", "warn"]);
    let mut server = command.stdout(Stdio::null()).spawn().unwrap();
    let mut client = loop {
        match SessionServiceClient::connect(format!("http://{address}")).await {
            Ok(client) => break client,
            Err(_) => tokio::time::sleep(Duration::from_millis(20)).await,
        }
    };
    let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
    let request = v1::CreateSessionRequest { scene, ..Default::default() };
    let created = client.create_session(request).await.unwrap().into_inner();
    assert!(created.warnings.iter().all(|warning| !warning.contains("record")), "{:?}", created.warnings);
    let session_id = created.session.unwrap().session_id;
    let step = loop {
        tokio::time::sleep(Duration::from_millis(100)).await;
        let request = v1::DescribeSessionRequest { session_id: session_id.clone() };
        let step = client.describe_session(request).await.unwrap().into_inner().session.unwrap().step;
        if step > 1000 {
            break step;
        }
    };
    server.kill().unwrap();
    server.wait().unwrap();

    let path = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    let mut recording = Recording::open(&path).unwrap();
    assert_eq!(recording.ending(), Ending::CutOff);
    let verified = verify(&mut recording, &Workers::serial(), |_| ()).unwrap();
    assert!(verified.steps as f64 > step as f64 - LOST_S * 500.0, "{verified:?} of {step} steps");

    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    let output = command.arg("replay").arg(&path).arg("--verify").output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && said.contains("every state is as recorded"), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("to its last whole chunk"), "{output:?}");
}
