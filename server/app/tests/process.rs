//! A server in a process of its own.

use std::net::SocketAddr;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, create_session_request, tool_motion};
use tonic::Code;
use tonic::transport::Channel;

/// The scene that sessions are tested on.
pub const BLOCK: &str = include_str!("../../session/tests/block.toml");
/// Longer than anything here takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// Waits for something, but not for ever.
pub async fn soon<T>(what: &str, future: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, future).await.unwrap_or_else(|_| panic!("{what}: nothing within {PATIENCE:?}"))
}

/// The first tool's blade at a height over the middle of the block.
pub fn at(height_m: f64) -> v1::StepInput {
    let position_m = Some(v1::Vec3 { x: 0.0, y: height_m as f32, z: 4e-4 });
    let pose = v1::Pose { position_m, orientation: Some(v1::Quat { w: 1.0, ..Default::default() }) };
    let motion = Some(tool_motion::Motion::Pose(v1::ToolPose { pose: Some(pose), ..Default::default() }));
    v1::StepInput { motions: vec![v1::ToolMotion { motion }] }
}

/// It is killed where a test ends before it.
pub struct Process {
    pub server: Child,
    pub client: SessionServiceClient<Channel>,
    pub address: SocketAddr,
}

impl Process {
    /// `kerf-server serve` on a free port.
    pub async fn serve(arguments: &[&str], stderr: impl Into<Stdio>) -> Self {
        Self::start(Command::new(env!("CARGO_BIN_EXE_kerf-server")), arguments, stderr).await
    }

    /// The same behind a command that ends in it.
    pub async fn start(command: Command, arguments: &[&str], stderr: impl Into<Stdio>) -> Self {
        let address = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap();
        Self::start_at(address, command, arguments, stderr).await
    }

    /// The same at an address, as of a server before it.
    pub async fn start_at(
        address: SocketAddr,
        mut command: Command,
        arguments: &[&str],
        stderr: impl Into<Stdio>,
    ) -> Self {
        command.args(["serve", "--listen", &address.to_string()]).args(arguments);
        let server = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(stderr).spawn().unwrap();
        let client = soon("a server", async {
            loop {
                match SessionServiceClient::connect(format!("http://{address}")).await {
                    Ok(client) => break client,
                    Err(_) => tokio::time::sleep(Duration::from_millis(20)).await,
                }
            }
        });
        Self { server, client: client.await, address }
    }

    /// A session of the block.
    pub async fn create(&mut self) -> v1::CreateSessionResponse {
        let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
        let request = v1::CreateSessionRequest { scene, ..Default::default() };
        soon("a session", self.client.create_session(request)).await.unwrap().into_inner()
    }

    /// A session of the block that waits for its steps.
    pub async fn stand(&mut self) -> String {
        let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
        let request = v1::CreateSessionRequest { scene, start_paused: true, ..Default::default() };
        let created = soon("a session", self.client.create_session(request)).await.unwrap().into_inner();
        created.session.unwrap().session_id
    }

    /// Steps of a session that stands.
    pub async fn step(&mut self, session_id: &str, inputs: &[v1::StepInput]) -> v1::StepSessionResponse {
        let (session_id, steps) = (session_id.into(), inputs.len() as u32);
        let request = v1::StepSessionRequest { session_id, steps, inputs: inputs.to_vec() };
        soon("steps", self.client.step_session(request)).await.unwrap().into_inner()
    }

    /// The session's description once it is as wanted; a session that comes back is waited for.
    pub async fn until(
        &mut self,
        session_id: &str,
        holds: impl Fn(&v1::SessionDescription) -> bool,
    ) -> v1::SessionDescription {
        soon("a description", async {
            loop {
                let request = v1::DescribeSessionRequest { session_id: session_id.into() };
                match self.client.describe_session(request).await {
                    Ok(described) => {
                        let described = described.into_inner().session.unwrap();
                        if holds(&described) {
                            break described;
                        }
                    }
                    Err(refused) => assert_eq!(refused.code(), Code::Unavailable, "{refused:?}"),
                }
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        })
        .await
    }

    /// Sends it a signal, by the name that `kill` has for it.
    pub fn signal(&self, name: &str) {
        let told = Command::new("kill").args([name, &self.server.id().to_string()]).status().unwrap();
        assert!(told.success(), "kill {name}");
    }

    /// How it ends once it is told to.
    pub fn stop(mut self) -> ExitStatus {
        self.signal("-TERM");
        let began = Instant::now();
        loop {
            match self.server.try_wait().unwrap() {
                Some(status) => break status,
                None => assert!(began.elapsed() < PATIENCE, "SIGTERM is not obeyed"),
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}
