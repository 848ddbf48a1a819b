//! Connecting to a server and getting a session.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use kerf_access::{Access, Wire, make_session, root_cause};
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, create_session_request};

/// Pause between two attempts to reach a server that is starting.
const RETRY_PAUSE: Duration = Duration::from_millis(100);
/// A server that does not answer within this is down, or is not where it was said to be.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Building the largest scenes takes seconds; a server that is this slow has hung.
const CREATE_TIMEOUT: Duration = Duration::from_secs(120);
/// Bytes of a part of a file: as the protocol advises.
const PART_BYTES: usize = 256 << 10;
/// For calls that only ask.
const CALL_TIMEOUT: Duration = Duration::from_secs(10);
/// A server that has vanished without a word is noticed after twice this.
const KEEP_ALIVE: Duration = Duration::from_secs(5);
/// Flow-control windows: a keyframe of a liver (0.7 MB) shall pass without waiting for updates.
const WINDOW_BYTES: u32 = 4 << 20;

/// A session and how it came about.
pub struct Session {
    /// What the server says of it.
    pub description: v1::SessionDescription,
    /// The scene; always there, unlike in the message.
    pub scene: v1::SceneSummary,
    /// Whether this program created it.
    pub created: bool,
}

/// Connects to a server, given as a URL or as host:port; tries again for `patience` if it is not there.
///
/// # Errors
/// The address is not one, what `access` names cannot be read, or nobody answers there.
pub async fn connect(server: &str, access: &Access, patience: Duration) -> anyhow::Result<Wire> {
    let endpoint = access
        .endpoint(server)?
        .tcp_nodelay(true)
        .connect_timeout(CONNECT_TIMEOUT)
        .http2_keep_alive_interval(KEEP_ALIVE)
        .keep_alive_timeout(KEEP_ALIVE)
        .keep_alive_while_idle(true)
        .initial_stream_window_size(WINDOW_BYTES)
        .initial_connection_window_size(WINDOW_BYTES);
    let token = access.token()?;
    let deadline = Instant::now() + patience;
    loop {
        match endpoint.connect().await {
            Ok(channel) => return Ok(token.over(channel)),
            Err(_) if Instant::now() < deadline => tokio::time::sleep(RETRY_PAUSE).await,
            Err(error) => bail!("no Kerf server answers at {server} ({})", root_cause(&error)),
        }
    }
}

/// What is asked of a session that is created.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wishes {
    /// Setting of the dial.
    pub dial: Option<create_session_request::Dial>,
    /// Steps per simulated second, Hz; absent: the scene's.
    pub step_rate_hz: Option<f64>,
}

/// Creates a session of a scene, or joins one.
///
/// # Errors
/// What the server answers, or a reply without a scene.
pub async fn open(
    channel: Wire,
    scene: Option<&str>,
    wishes: Wishes,
    session: Option<&str>,
) -> anyhow::Result<Session> {
    let mut client = SessionServiceClient::new(channel);
    let (description, created) = match (scene, session) {
        (Some(scene), None) => (create(&mut client, scene, wishes).await?, true),
        (None, Some(session_id)) => (describe(&mut client, session_id).await?, false),
        _ => bail!("either a scene or a session has to be given"),
    };
    let scene = description.scene.clone().context("the server described a session without its scene")?;
    Ok(Session { description, scene, created })
}

/// Ends a session.
///
/// # Errors
/// What the server answers.
pub async fn close(channel: Wire, session_id: &str) -> anyhow::Result<()> {
    let request = timed(v1::CloseSessionRequest { session_id: session_id.to_owned() }, CALL_TIMEOUT);
    SessionServiceClient::new(channel)
        .close_session(request)
        .await
        .map_err(|status| refused(&format!("closing session {session_id}"), &status))?;
    Ok(())
}

/// What the server set the dial to, and what it expects of that.
#[must_use]
pub fn dial_text(dial: &v1::DialChoice) -> String {
    let setting = dial.setting.as_ref().map_or_else(String::new, |setting| {
        let finer = if setting.has_finer_regions { ", finer regions" } else { "" };
        let v1::DialSetting { level, voxel_scale, relative_tolerance, element, .. } = setting;
        format!(" level {level}, voxels x {voxel_scale}, tolerance {relative_tolerance:.1e}, elements {element}{finer}")
    });
    let expected = dial.expected.as_ref().map_or_else(String::new, |expected| {
        let v1::DialExpectation { median_ms, p99_ms, displacement_error, force_error, hardware } = expected;
        let [displacement, force] = [displacement_error, force_error].map(|error| 100.0 * error);
        format!(
            "; expected {median_ms:.2} ms a step, p99 {p99_ms:.2} ms, errors {displacement:.1} % of displacement, \
             {force:.1} % of force (measured on {hardware})"
        )
    });
    format!("dial:{setting}{expected}")
}

/// What was asked and what the server answered.
#[derive(Debug, thiserror::Error)]
#[error("{what}: {}: {}", status.code().description(), status.message())]
pub struct Refused {
    /// What was asked.
    what: String,
    /// The answer.
    pub status: tonic::Status,
}

/// An error that says what was asked and what the server answered.
#[must_use]
pub fn refused(what: &str, status: &tonic::Status) -> anyhow::Error {
    Refused { what: what.to_owned(), status: status.clone() }.into()
}

async fn create(
    client: &mut SessionServiceClient<Wire>,
    scene: &str,
    Wishes { dial, step_rate_hz }: Wishes,
) -> anyhow::Result<v1::SessionDescription> {
    let path = Path::new(scene);
    let (source, files) = if path.extension().is_some_and(|extension| extension == "toml") {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {scene}"))?;
        let files = files_beside(path, &text)?;
        (create_session_request::Scene::SceneToml(text), files)
    } else {
        (create_session_request::Scene::SceneName(scene.to_owned()), Vec::new())
    };
    let refused = |status| refused(&format!("creating a session of {scene}"), &status);
    let request = v1::CreateSessionRequest {
        scene: Some(source),
        start_paused: false,
        dial,
        step_rate_hz,
        upload_id: send_files(client, files).await.map_err(refused)?,
        ..Default::default()
    };
    let v1::CreateSessionResponse { session, warnings } =
        make_session(client, request, CREATE_TIMEOUT).await.map_err(refused)?;
    warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
    session.context("the server created a session without describing it")
}

/// Sends files ahead of the request for a session that names the upload: its id, empty where there are no files.
async fn send_files(
    client: &mut SessionServiceClient<Wire>,
    files: Vec<v1::SceneFile>,
) -> Result<String, tonic::Status> {
    let mut upload_id = String::new();
    for v1::SceneFile { name: mut file_name, data } in files {
        // An empty file is one part of no bytes.
        for part in data.chunks(PART_BYTES).chain(data.is_empty().then_some(&[][..])) {
            let file_name = std::mem::take(&mut file_name);
            let request = v1::SendSceneFileRequest { upload_id, file_name, data: part.to_vec() };
            upload_id = client.send_scene_file(timed(request, CALL_TIMEOUT)).await?.into_inner().upload_id;
        }
    }
    Ok(upload_id)
}

/// The files that a scene's text refers to, each as it names it, from beside the scene.
fn files_beside(scene: &Path, text: &str) -> anyhow::Result<Vec<v1::SceneFile>> {
    let folder = scene.parent().unwrap_or(Path::new(""));
    let mut names = BTreeSet::new();
    // What is wrong with the text is the server's to say.
    file_names(&toml::Value::Table(toml::from_str(text).unwrap_or_default()), &mut names);
    let read = |name: String| {
        let path = folder.join(&name);
        let data = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        Ok(v1::SceneFile { name, data })
    };
    names.into_iter().map(read).collect()
}

/// Every text that is called `file`, wherever it stands.
fn file_names(value: &toml::Value, names: &mut BTreeSet<String>) {
    match value {
        toml::Value::Array(values) => values.iter().for_each(|value| file_names(value, names)),
        toml::Value::Table(fields) => {
            for (field, value) in fields {
                match value.as_str() {
                    Some(name) if field == "file" => drop(names.insert(name.to_owned())),
                    _ => file_names(value, names),
                }
            }
        }
        _ => {}
    }
}

async fn describe(client: &mut SessionServiceClient<Wire>, session_id: &str) -> anyhow::Result<v1::SessionDescription> {
    let request = v1::DescribeSessionRequest { session_id: session_id.to_owned() };
    let reply = client
        .describe_session(timed(request, CALL_TIMEOUT))
        .await
        .map_err(|status| refused(&format!("joining session {session_id}"), &status))?;
    reply.into_inner().session.context("the server did not describe the session")
}

fn timed<T>(message: T, timeout: Duration) -> tonic::Request<T> {
    let mut request = tonic::Request::new(message);
    request.set_timeout(timeout);
    request
}
