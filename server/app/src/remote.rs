//! `kerf-server session`: the sessions of a server that runs, the way back to an earlier state of one, and states as files.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use clap::{Args, Subcommand};
use kerf_access::{Access, AccessError, Wire, root_cause};
use kerf_proto::v1;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use tonic::{Code, Response, Status};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use crate::export::export;
use crate::watchdog::SESSIONS;

/// A server that does not answer within this is down, or is not where it was said to be.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(10);
/// A file of the largest size that servers take unless they are told otherwise comes over 20 Mbit/s within this.
const TIMEOUT_OF_FILES: Duration = Duration::from_secs(60);
/// Bytes of a part of a file: far below what a server takes.
const PART_BYTES: usize = 256 << 10;

/// Arguments of `session`.
#[derive(Args, Clone, Debug)]
pub struct SessionArgs {
    /// Address of the server, also as https://NAME:PORT.
    #[arg(long, env = "KERF_SERVER", value_name = "ADDRESS:PORT", default_value = "127.0.0.1:50051", global = true)]
    pub server: String,
    /// What the server asks for.
    #[command(flatten)]
    pub access: Access,
    /// What is asked.
    #[command(subcommand)]
    pub action: Action,
}

/// What is asked of a server's sessions.
#[derive(Clone, Debug, Subcommand)]
pub enum Action {
    /// Says whether the server serves and all its sessions live; takes no token. Ends with status 1 where not.
    Health(Health),
    /// Lists the sessions.
    List,
    /// Saves a session's state under a name.
    Save(Checkpoint),
    /// Takes a session back to a saved state: undo.
    Restore(Checkpoint),
    /// Lists a session's saved states.
    Checkpoints(Id),
    /// Writes a session's state, or a saved one, to a file.
    Download(Download),
    /// Writes a session's surfaces to a file that ends in .glb, or each closed piece to a folder, as STL.
    Export(Export),
    /// Keeps the state in a file as a saved one of a session of the same scene.
    Upload(Upload),
    /// Forgets a saved state.
    Delete(Checkpoint),
    /// Lets a session stand.
    Pause(Id),
    /// Lets a session that stands go on.
    Resume(Id),
    /// Takes a session back to its beginning.
    Reset(Id),
    /// Takes a recording that is played to another time.
    Seek(Time),
    /// Moves a session to another server, where its clients follow it.
    Move(Move),
    /// Ends a session.
    Close(Id),
}

/// What is asked of a server's health.
#[derive(Args, Clone, Debug)]
pub struct Health {
    /// Asks for the server and for none of its sessions: whoever restarts it for one that hangs ends all others.
    #[arg(long)]
    pub server_only: bool,
}

/// A session.
#[derive(Args, Clone, Debug)]
pub struct Id {
    /// Id of the session, as `list` tells it.
    pub session: String,
}

/// A session that moves.
#[derive(Args, Clone, Debug)]
pub struct Move {
    /// Id of the session, as `list` tells it.
    pub session: String,
    /// The other server, as https://NAME:PORT or http://NAME:PORT: as the session's clients reach it.
    pub to: String,
    /// File with an operator's token of that server. Default: the token of this one.
    #[arg(long, value_name = "FILE")]
    pub to_token_file: Option<PathBuf>,
}

/// A saved state of a session.
#[derive(Args, Clone, Debug)]
pub struct Checkpoint {
    /// Id of the session, as `list` tells it.
    pub session: String,
    /// Name of the state.
    pub name: String,
}

/// A state that goes to a file.
#[derive(Args, Clone, Debug)]
pub struct Download {
    /// Id of the session, as `list` tells it.
    pub session: String,
    /// The file.
    pub file: PathBuf,
    /// Name of a saved state. Default: the state as it is.
    #[arg(long, value_name = "NAME", default_value = "", hide_default_value = true)]
    pub checkpoint: String,
}

/// Surfaces that go to files.
#[derive(Args, Clone, Debug)]
pub struct Export {
    /// Id of the session, as `list` tells it.
    pub session: String,
    /// A file that ends in .glb, or a folder for STL.
    pub to: PathBuf,
}

/// A state that comes from a file.
#[derive(Args, Clone, Debug)]
pub struct Upload {
    /// Id of the session, as `list` tells it.
    pub session: String,
    /// The file.
    pub file: PathBuf,
    /// Name to keep it by. Default: the file's, without its ending.
    #[arg(long, value_name = "NAME")]
    pub checkpoint: Option<String>,
    /// Takes the session to it, too.
    #[arg(long)]
    pub restore: bool,
}

/// A time of a recording.
#[derive(Args, Clone, Debug)]
pub struct Time {
    /// Id of the session, as `list` tells it.
    pub session: String,
    /// Time since the recording began, s. Default: where it is.
    pub time_s: Option<f64>,
    /// Times the speed of its making, 0.01 to 100. Default: as it is.
    #[arg(long, value_name = "FACTOR")]
    pub speed: Option<f64>,
}

/// Asks the server and prints what it says, a line each.
///
/// # Errors
/// No server answers there, or what it refuses.
pub fn run(args: &SessionArgs) -> Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context("runtime")?;
    let lines = runtime.block_on(async {
        let endpoint = args.access.endpoint(&args.server)?;
        let timeout = match args.action {
            Action::Download(_) | Action::Upload(_) | Action::Export(_) | Action::Move(_) => TIMEOUT_OF_FILES,
            _ => TIMEOUT,
        };
        let channel = endpoint.connect_timeout(TIMEOUT).timeout(timeout).connect().await;
        let channel =
            channel.map_err(|error| anyhow!("no Kerf server answers at {} ({})", args.server, root_cause(&error)))?;
        let answer = ask(args.access.token()?.over(channel), &args.access, args.action.clone()).await;
        answer.map_err(|status| anyhow!("{}", status.message()))
    })?;
    lines.iter().for_each(|line| println!("{line}"));
    Ok(())
}

/// A file of this side that cannot be read or written ends what was asked as a refusal does.
fn on_file(file: &Path, error: &std::io::Error) -> Status {
    Status::unknown(format!("{}: {error}", file.display()))
}

async fn download(mut client: SessionServiceClient<Wire>, wanted: Download) -> Result<Vec<u8>, Status> {
    let request = v1::DownloadCheckpointRequest { session_id: wanted.session, name: wanted.checkpoint };
    let mut parts = client.download_checkpoint(request).await?.into_inner();
    let mut file = Vec::new();
    while let Some(part) = parts.message().await? {
        file.extend(part.data);
    }
    Ok(file)
}

async fn upload(mut client: SessionServiceClient<Wire>, to: Checkpoint, file: &[u8]) -> Result<u64, Status> {
    let first = v1::UploadCheckpointRequest { session_id: to.session, name: to.name, ..Default::default() };
    let part = |data: &[u8]| v1::UploadCheckpointRequest { data: data.to_vec(), ..Default::default() };
    let parts: Vec<_> = std::iter::once(first).chain(file.chunks(PART_BYTES).map(part)).collect();
    Ok(client.upload_checkpoint(futures_util::stream::iter(parts)).await?.into_inner().step)
}

/// Whether the server serves, and all of its sessions live, if they are asked for.
async fn is_healthy(wire: Wire, wanted: &Health) -> Result<Vec<String>, Status> {
    let mut health = HealthClient::new(wire);
    let mut serves = async |service: &str| {
        let status = health.check(HealthCheckRequest { service: service.into() }).await?.into_inner().status();
        Ok::<_, Status>(status == ServingStatus::Serving)
    };
    if !serves("").await? {
        return Err(Status::unavailable("the server does not serve"));
    }
    if wanted.server_only {
        return Ok(vec!["serving".into()]);
    }
    match serves(SESSIONS).await {
        Ok(true) => Ok(vec!["serving".into()]),
        Ok(false) => {
            Err(Status::unavailable("degraded: the server serves, but a session's thread hangs (kerf-server top)"))
        }
        // A server of before does not know.
        Err(status) if status.code() == Code::NotFound => Ok(vec!["serving".into()]),
        Err(status) => Err(status),
    }
}

async fn ask(wire: Wire, access: &Access, action: Action) -> Result<Vec<String>, Status> {
    let mut client = SessionServiceClient::new(wire.clone());
    let at_step = |what: String, step: u64| vec![format!("{what} at step {step}")];
    Ok(match action {
        Action::Health(wanted) => is_healthy(wire, &wanted).await?,
        Action::List => {
            let v1::ListSessionsResponse { sessions, server, .. } =
                client.list_sessions(v1::ListSessionsRequest {}).await.map(Response::into_inner)?;
            let expected = server.map_or(0, |server| server.expected_sessions);
            let more = (expected > 0).then(|| format!("{expected} more of the server before are not back yet"));
            let line = |session: v1::SessionInfo| {
                let state = session.state().as_str_name().trim_start_matches("SESSION_STATE_").to_lowercase();
                let kind = if session.is_replay { "  replay" } else { "" };
                format!("{}  {}  {state}{kind}", session.session_id, session.scene_name)
            };
            sessions.into_iter().map(line).chain(more).collect()
        }
        Action::Save(Checkpoint { session: session_id, name }) => {
            let request = v1::SaveCheckpointRequest { session_id, name: name.clone() };
            at_step(format!("`{name}` saved"), client.save_checkpoint(request).await?.into_inner().step)
        }
        Action::Restore(Checkpoint { session: session_id, name }) => {
            let request = v1::RestoreCheckpointRequest { session_id, name: name.clone() };
            at_step(format!("back to `{name}`"), client.restore_checkpoint(request).await?.into_inner().step)
        }
        Action::Checkpoints(Id { session: session_id }) => {
            let reply = client.list_checkpoints(v1::ListCheckpointsRequest { session_id }).await?.into_inner();
            let line =
                |saved: v1::Checkpoint| format!("{}  step {}  {:.3} s", saved.name, saved.step, saved.sim_time_s);
            reply.checkpoints.into_iter().map(line).collect()
        }
        Action::Download(wanted) => {
            let path = wanted.file.clone();
            let late = |_| Status::deadline_exceeded(format!("not whole within {} s", TIMEOUT_OF_FILES.as_secs()));
            let file = tokio::time::timeout(TIMEOUT_OF_FILES, download(client, wanted)).await.map_err(late)??;
            std::fs::write(&path, &file).map_err(|error| on_file(&path, &error))?;
            vec![format!("{}: {} bytes", path.display(), file.len())]
        }
        Action::Export(Export { session, to }) => export(wire, &session, &to).await?,
        Action::Upload(Upload { session, file: path, checkpoint, restore }) => {
            let file = std::fs::read(&path).map_err(|error| on_file(&path, &error))?;
            let named_after = || path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let to = Checkpoint { session, name: checkpoint.unwrap_or_else(named_after) };
            let step = upload(client, to.clone(), &file).await?;
            let mut lines = vec![format!("`{}` uploaded, of step {step}", to.name)];
            if restore {
                lines.extend(Box::pin(ask(wire, access, Action::Restore(to))).await?);
            }
            lines
        }
        Action::Delete(Checkpoint { session: session_id, name }) => {
            client.delete_checkpoint(v1::DeleteCheckpointRequest { session_id, name }).await?;
            Vec::new()
        }
        Action::Pause(Id { session: session_id }) => at_step(
            "paused".into(),
            client.pause_session(v1::PauseSessionRequest { session_id }).await?.into_inner().step,
        ),
        Action::Resume(Id { session: session_id }) => {
            let request = v1::ResumeSessionRequest { session_id };
            at_step("resumed".into(), client.resume_session(request).await?.into_inner().step)
        }
        Action::Reset(Id { session: session_id }) => {
            client.reset_session(v1::ResetSessionRequest { session_id }).await?;
            Vec::new()
        }
        Action::Seek(Time { session: session_id, time_s, speed }) => {
            let request = v1::SeekReplayRequest { session_id, time_s, speed };
            let at = client.seek_replay(request).await?.into_inner();
            vec![format!("{:.3} s of {:.3} s, at step {}, speed {}", at.time_s, at.length_s, at.step, at.speed)]
        }
        Action::Move(Move { session: session_id, to, to_token_file }) => {
            let unread = |error: AccessError| Status::unknown(error.to_string());
            let token_file = to_token_file.or_else(|| access.token_file.clone());
            let there = Access { token_file, ..access.clone() };
            let token = there.token().map_err(unread)?.text().unwrap_or_default().to_owned();
            let ca_certificates = access.certificates().map_err(unread)?.unwrap_or_default();
            let request = v1::MoveSessionRequest { session_id, to: to.clone(), token, ca_certificates };
            at_step(format!("moved to {to}"), client.move_session(request).await?.into_inner().step)
        }
        Action::Close(Id { session: session_id }) => {
            let closed = client.close_session(v1::CloseSessionRequest { session_id }).await?.into_inner();
            let line = |recording: v1::Recording| match recording.error.is_empty() {
                true => format!("recorded: {}, {} steps", recording.file, recording.steps),
                false => format!("recorded: {}, {} steps: {}", recording.file, recording.steps, recording.error),
            };
            closed.recording.map(line).into_iter().collect()
        }
    })
}
