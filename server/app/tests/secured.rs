//! A server with TLS and tokens in this process, and clients of it.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;

use kerf_access::{Access, Wire};
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, create_session_request};
use kerf_server::config::ServerConfig;
use kerf_server::serve::Server;
use tempfile::TempDir;
use tonic::Status;

use super::process::BLOCK;

/// Makes a token by the command and leaves it in a file; answers with the file.
pub fn make_token(folder: &Path, name: &str, role: &str, besides: &[&str]) -> PathBuf {
    let out = folder.join(name);
    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    command.args(["token", "new", "--name", name, "--role", role]).args(besides);
    command.arg("--file").arg(folder.join("tokens.toml")).arg("--out").arg(&out);
    let output = command.output().unwrap();
    assert!(output.status.success() && output.stdout.is_empty(), "{output:?}");
    out
}

/// A server that takes the tokens of `viewer`, `anna`, `ben` (drivers) and `operator`.
pub struct Secured {
    pub server: Server,
    pub folder: TempDir,
}

impl Secured {
    pub async fn start(change: impl FnOnce(&mut ServerConfig)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, role) in [("viewer", "viewer"), ("anna", "driver"), ("ben", "driver"), ("operator", "operator")] {
            make_token(folder.path(), name, role, &[]);
        }
        Self::again(folder, change).await
    }

    /// Another one with the same folder.
    pub async fn again(folder: TempDir, change: impl FnOnce(&mut ServerConfig)) -> Self {
        let mut config = ServerConfig { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..ServerConfig::default() };
        config.security.dir = Some(folder.path().into());
        change(&mut config);
        Self { server: Server::start(config).await.unwrap(), folder }
    }

    /// A connection of who has this token, or none.
    pub async fn connect(&self, token: Option<&str>) -> Wire {
        let file = |name: &str| self.folder.path().join(name);
        let access = Access { ca_file: Some(file("certificate.pem")), token_file: token.map(file) };
        let channel = access.endpoint(&self.server.address().to_string()).unwrap().connect().await.unwrap();
        access.token().unwrap().over(channel)
    }

    pub async fn sessions(&self, token: &str) -> SessionServiceClient<Wire> {
        SessionServiceClient::new(self.connect(Some(token)).await)
    }
}

/// Creates a session of the block that stands.
pub async fn create(client: &mut SessionServiceClient<Wire>, private: bool) -> Result<String, Status> {
    let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
    let request = v1::CreateSessionRequest { scene, start_paused: true, private, ..Default::default() };
    Ok(client.create_session(request).await?.into_inner().session.unwrap().session_id)
}

/// The ids of the sessions that somebody gets to know of.
pub async fn list(client: &mut SessionServiceClient<Wire>) -> Result<Vec<String>, Status> {
    let sessions = client.list_sessions(v1::ListSessionsRequest {}).await?.into_inner().sessions;
    Ok(sessions.into_iter().map(|session| session.session_id).collect())
}
