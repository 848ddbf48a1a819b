//! `kerf-server session` beside a server that runs.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use kerf_physics::Vec3;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, create_session_request};
use kerf_server::config::ServerConfig;
use kerf_server::serve::Server;

use super::process::{BLOCK, Process, at, soon};

/// What the command prints, or else says on standard error.
async fn ask(server: SocketAddr, arguments: &[&str]) -> Result<String, String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    command.arg("session").args(arguments).args(["--server", &server.to_string()]);
    let output = tokio::task::spawn_blocking(move || command.output()).await.unwrap().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    if output.status.success() { Ok(text(output.stdout)) } else { Err(text(output.stderr)) }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_is_taken_back_from_the_command_line_and_its_scene_is_warned_of() {
    let config = ServerConfig { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..ServerConfig::default() };
    let server = Server::start(config).await.unwrap();
    let address = server.address();
    let mut client = SessionServiceClient::connect(format!("http://{address}")).await.unwrap();
    let block = "version = 1\nname = 'block'\nrate_hz = 100.0\n[[objects]]\nname = 'block'\nvoxel_size_m = 0.01\n\
                 shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.04, 0.04, 0.04] } }\nlevel = 1\n\
                 material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }\n";
    let scene = Some(create_session_request::Scene::SceneToml(block.into()));
    let request = v1::CreateSessionRequest { scene, ..Default::default() };
    let created = client.create_session(request).await.unwrap().into_inner();
    assert_eq!(created.warnings.len(), 1);
    assert!(created.warnings[0].starts_with("objects[0]: nothing holds `block`"), "{:?}", created.warnings);
    let id = created.session.unwrap().session_id;

    assert_eq!(ask(address, &["list"]).await.unwrap(), format!("{id}  block  running\n"));
    assert!(ask(address, &["pause", &id]).await.unwrap().starts_with("paused at step "));
    let saved = ask(address, &["save", &id, "before"]).await.unwrap();
    let step = saved.strip_prefix("`before` saved at step ").unwrap().trim();
    assert!(ask(address, &["resume", &id]).await.unwrap().starts_with("resumed at step "));
    assert_eq!(ask(address, &["restore", &id, "before"]).await.unwrap(), format!("back to `before` at step {step}\n"));
    assert!(ask(address, &["checkpoints", &id]).await.unwrap().starts_with(&format!("before  step {step}  ")));
    assert!(ask(address, &["restore", &id, "after"]).await.unwrap_err().contains("no checkpoint"));
    assert_eq!(ask(address, &["delete", &id, "before"]).await.unwrap(), "");
    assert_eq!(ask(address, &["close", &id]).await.unwrap(), "");
    assert_eq!(ask(address, &["list"]).await.unwrap(), "");
    server.stop().await;
    assert!(ask(address, &["list"]).await.unwrap_err().contains("no Kerf server answers"));
}

#[tokio::test(flavor = "multi_thread")]
async fn health_tells_a_server_that_serves_from_one_in_which_a_session_hangs() {
    let mut config = ServerConfig { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..ServerConfig::default() };
    config.session.hangs_after_s = 0.3;
    let server = Server::start(config).await.unwrap();
    let mut client = SessionServiceClient::connect(format!("http://{}", server.address())).await.unwrap();
    let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
    let created = client.create_session(v1::CreateSessionRequest { scene, ..Default::default() }).await.unwrap();
    assert_eq!(ask(server.address(), &["health"]).await.unwrap(), "serving\n");
    let (let_go, held) = std::sync::mpsc::channel::<()>();
    let session = server.registry().get(&created.into_inner().session.unwrap().session_id).unwrap();
    let hangs = tokio::spawn(async move { session.query(move |_| held.recv().is_err()).await });
    let degraded = soon("a session that hangs", async {
        loop {
            if let Err(said) = ask(server.address(), &["health"]).await {
                break said;
            }
        }
    });
    let degraded = degraded.await;
    // What a probe asks: a restart would end the sessions that live.
    assert_eq!(ask(server.address(), &["health", "--server-only"]).await.unwrap(), "serving\n");
    assert!(degraded.contains("degraded: the server serves, but a session's thread hangs"));
    drop(let_go);
    assert!(hangs.await.unwrap().unwrap());
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_halves_of_a_block_are_exported_as_a_file_each() {
    let mut process = Process::serve(&["--log-filter", "warn"], Stdio::inherit()).await;
    let session = process.stand().await;
    let through: Vec<_> = (0..120).map(|step| at(0.012 - 2e-4 * f64::from(step))).collect();
    process.step(&session, &through).await;
    let folder = tempfile::tempdir().unwrap();
    let [glb, pieces] = ["block.glb", "pieces"].map(|name| folder.path().join(name));
    let export = async |to: &Path| ask(process.address, &["export", &session, to.to_str().unwrap()]).await.unwrap();
    assert_eq!(export(&glb).await, format!("{}\n", glb.display()));
    assert!(std::fs::read(&glb).unwrap().starts_with(b"glTF"));
    let halves = [1, 2].map(|number| pieces.join(format!("block-{number}.stl")));
    assert_eq!(export(&pieces).await, halves.each_ref().map(|path| format!("{}\n", path.display())).concat());
    // Each triangle of STL has a normal and three corners of 4-byte numbers, and 2 bytes more. Both halves are closed: the
    // flux of the position through each is three times its volume.
    let volume_m3 = |path: &PathBuf| -> f64 {
        let file = std::fs::read(path).unwrap();
        let number = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().unwrap()));
        let corner = |bytes: &[u8]| Vec3::from_fn(|axis, _| number(&bytes[4 * axis..][..4]));
        let cone = |triangle: &[u8]| {
            let [a, b, c] = [12, 24, 36].map(|at| corner(&triangle[at..]));
            a.dot(&b.cross(&c)) / 6.0
        };
        file[84..].chunks(50).map(cone).sum()
    };
    let volumes_m3 = halves.each_ref().map(volume_m3);
    let whole_m3 = volumes_m3.iter().sum::<f64>();
    assert!((whole_m3 - 8e-6).abs() < 1e-6 && volumes_m3.iter().all(|half_m3| *half_m3 > 2e-6), "{volumes_m3:?}");
}
