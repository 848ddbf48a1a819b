//! A look at a server, without a session.

use std::time::{Duration, Instant};

use kerf_proto::v1::control_service_client::ControlServiceClient;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, control_request};
use tonic::{Code, Status};

use super::connection::{Ended, connect};
use crate::config::ServerConfig;

/// Calls whose time is measured.
const CALLS: usize = 20;

/// What a server told.
#[derive(Clone, Debug, PartialEq)]
pub struct ServerProbe {
    /// Names of the scenes that it knows.
    pub scenes: Vec<String>,
    /// Time of a call, the median of a few.
    pub round_trip: Duration,
    /// Whether it speaks our version of the protocol; what it said if not.
    pub version: Result<u32, String>,
}

/// Asks a server what it is.
///
/// # Errors
/// What was tried and how it failed.
pub async fn probe(server: &ServerConfig) -> Result<ServerProbe, String> {
    let wire = connect(server).await.map_err(Ended::text)?;
    let mut sessions = SessionServiceClient::new(wire.clone());
    let said = |status: Status| format!("{} answers, but not as a Kerf server: {}", server.url, status.message());
    let mut scenes = Vec::new();
    let mut times = Vec::new();
    for _ in 0..CALLS {
        let begun = Instant::now();
        let reply = sessions.list_scenes(v1::ListScenesRequest {}).await.map_err(said)?.into_inner();
        times.push(begun.elapsed());
        scenes = reply.scenes.into_iter().map(|scene| scene.name).collect();
    }
    times.sort();
    // A server looks at the version before it looks for the session, and no session has no id.
    let hello = v1::ClientHello {
        protocol_version: kerf_proto::PROTOCOL_VERSION,
        tool_ids: vec![0],
        ..v1::ClientHello::default()
    };
    let request = v1::ControlRequest { message: Some(control_request::Message::Hello(hello)), received: 0 };
    let answer = ControlServiceClient::new(wire).control(tokio_stream::once(request)).await;
    let version = match answer {
        Err(status) if status.code() == Code::FailedPrecondition => Err(status.message().to_owned()),
        Err(status) if status.code() != Code::NotFound => return Err(said(status)),
        _ => Ok(kerf_proto::PROTOCOL_VERSION),
    };
    Ok(ServerProbe { scenes, round_trip: times[CALLS / 2], version })
}
