//! The server's configuration: defaults, then a TOML file, then `KERF_*` variables, then flags.
//!
//! Every limit stands here or in [`SessionLimits`], with its default and the reason for it. Unknown
//! fields are refused wherever they come from.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use axum::http::Uri;
use kerf_session::SessionLimits;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

/// Variables that begin with this set fields: `KERF_SESSION__LEASE_S=3` is `session.lease_s = 3`.
const ENV_PREFIX: &str = "KERF_";
/// Names the file; not a field.
const ENV_FILE: &str = "KERF_CONFIG";
/// What clients read: no fields either, though a server may have them in its environment.
const ENV_OF_CLIENTS: [&str; 5] =
    ["KERF_SERVER", "KERF_SERVER_PROGRAM", "KERF_CA_FILE", "KERF_TOKEN", "KERF_TOKEN_FILE"];

/// The name of a setting, as `--set` takes it. One that there is not does not compile.
macro_rules! setting {
    ($first:ident $(.$rest:ident)*) => {{
        const _: fn(&$crate::config::ServerConfig) = |config| _ = &config.$first$(.$rest)*;
        concat!(stringify!($first) $(, ".", stringify!($rest))*)
    }};
}

pub(crate) use setting;

/// Where settings come from besides the defaults.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ConfigArgs {
    /// Configuration file (TOML).
    #[arg(long, env = ENV_FILE, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Address to listen on; port 0 takes a free one.
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub listen: Option<SocketAddr>,
    /// Folder with the server's tokens and certificate. What is missing in it is made at the start, and the first token
    /// shown once: security.dir.
    #[arg(long, value_name = "FOLDER")]
    pub security_dir: Option<PathBuf>,
    /// Serves whoever reaches the server, without TLS and tokens: security.insecure.
    #[arg(long)]
    pub insecure: bool,
    /// Log output: text or json.
    #[arg(long, value_name = "FORMAT")]
    pub log_format: Option<String>,
    /// What is logged, as "info" or "kerf_session=debug,warn".
    #[arg(long, value_name = "FILTER")]
    pub log_filter: Option<String>,
    /// Any field of the configuration, as session.lease_s=3; may be repeated.
    #[arg(long = "set", value_name = "FIELD=VALUE")]
    pub set: Vec<String>,
}

/// The server's configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServerConfig {
    /// Address to listen on. Default 127.0.0.1:50051. Any other than loopback needs TLS and tokens, or
    /// `security.insecure`.
    pub listen: SocketAddr,
    /// Address where Prometheus reads metrics, at `/metrics`. Default none: no other port is open than the one that clients
    /// need. Who gets in is judged as at `listen`: a server that asks for tokens asks for a viewer's here.
    pub metrics_listen: Option<SocketAddr>,
    /// Names that the server answers to besides `localhost`, `127.0.0.0/8` and `[::1]`: those of a proxy that passes
    /// them on, and the machine's own. Default none: on loopback a page whose name was made to mean this machine gets
    /// nothing; reached from elsewhere the server answers to any name then, and else to these and to addresses.
    pub names: Vec<String>,
    /// Threads of the network's runtime. Default 2: the simulation gets the other cores.
    pub network_threads: usize,
    /// Folder that each session is recorded to, an MCAP file a session, for `replay` and for viewers of such files.
    /// Default none: nothing is recorded.
    pub record_dir: Option<PathBuf>,
    /// Most that is kept in `record_dir`, MiB. When it is full recordings end, and none is begun; clients are told.
    /// Default 1024: about an hour of the liver at 1 kHz.
    pub max_record_mib: f64,
    /// States that are recorded for the eye, Hz. Default 30: smooth, at half of what a screen's 60 take. Inputs, forces
    /// and hashes are recorded at every step whatever this is.
    pub record_rate_hz: f64,
    /// Surfaces are recorded too, ten a second, as scenes that common viewers of MCAP files draw. Default false: it makes
    /// files several times larger, and `replay` does not need them.
    pub record_surface: bool,
    /// Folder of the sessions' journals, which bring them back when the server was killed or the machine lost power. It
    /// is the server's own. Default none: sessions end with the server.
    pub journal_dir: Option<PathBuf>,
    /// Most that is kept in `journal_dir`, MiB. When it is full journals end; that is logged. Default 1024: a journal of
    /// the liver takes some 2 MiB, however long its session goes on.
    pub max_journal_mib: f64,
    /// Folder of scenes, TOML files with the meshes, label maps and edges that they refer to, which clients create by
    /// the name of the file. Default none.
    pub scene_dir: Option<PathBuf>,
    /// Folder of measured Pareto fronts, CSV files as `kerf-server tradeoff` writes them, by which sessions are
    /// given a budget or an error. They go before those that come with the program, which were measured on
    /// another machine. Default none.
    pub pareto_dir: Option<PathBuf>,
    /// Who gets in.
    pub security: SecurityConfig,
    /// Logging.
    pub log: LogConfig,
    /// Traces.
    pub traces: TracesConfig,
    /// A fleet that the server is of.
    pub agones: AgonesConfig,
    /// Limits of the transport.
    pub transport: TransportLimits,
    /// Limits of control streams.
    pub control: ControlLimits,
    /// Limits of view streams.
    pub view: ViewLimits,
    /// Limits of sessions.
    pub session: SessionLimits,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 50051)),
            metrics_listen: None,
            names: Vec::new(),
            network_threads: 2,
            record_dir: None,
            max_record_mib: 1024.0,
            record_rate_hz: 30.0,
            record_surface: false,
            journal_dir: None,
            max_journal_mib: 1024.0,
            scene_dir: None,
            pareto_dir: None,
            security: SecurityConfig::default(),
            log: LogConfig::default(),
            traces: TracesConfig::default(),
            agones: AgonesConfig::default(),
            transport: TransportLimits::default(),
            control: ControlLimits::default(),
            view: ViewLimits::default(),
            session: SessionLimits::default(),
        }
    }
}

/// Who gets in.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SecurityConfig {
    /// Folder with `tokens.toml`, `certificate.pem` and `key.pem`, of which those are used that have no setting of their
    /// own. What is missing is made at the start: a certificate of the server's own, and an operator's token, which is
    /// shown once on standard output. Default none.
    pub dir: Option<PathBuf>,
    /// File of the tokens that are taken, as `kerf-server token new` writes it; read again when it changes. Default that
    /// of `dir`, and without it no token is asked for: whoever reaches the server is its operator.
    pub token_file: Option<PathBuf>,
    /// Certificate (PEM), and those that lead from it to one that clients trust; read again when it changes. Default that
    /// of `dir`, and without it there is no TLS.
    pub certificate_file: Option<PathBuf>,
    /// Key of the certificate (PEM). Given together with it.
    pub key_file: Option<PathBuf>,
    /// Origins whose pages may call the server besides its own, such as `["https://lab.example:8443"]`: each exactly as
    /// browsers send it, `scheme://host` or `scheme://host:port`, http or https. A page still needs a token where one is
    /// asked for. Default none.
    pub allowed_origins: Vec<String>,
    /// A server that others can reach starts without TLS and tokens. Default false. The log says so at each start.
    pub insecure: bool,
    /// Sessions that one token has at a time. Default 4: one token cannot take all places.
    pub max_sessions_per_token: usize,
    /// Wrong tokens of one address a minute; more are refused without a line in the log. Default 30: a client that was
    /// given the wrong one tries now and then, and nobody guesses.
    pub max_wrong_tokens_per_minute: u32,
    /// How long a link that is handed to a viewer is good, s. Default 28800: a working day.
    pub guest_stay_s: f64,
    /// Links that are good at a time. Default 256.
    pub max_guests: usize,
}

impl Default for SecurityConfig {
    fn default() -> Self {
        Self {
            dir: None,
            token_file: None,
            certificate_file: None,
            key_file: None,
            allowed_origins: Vec::new(),
            insecure: false,
            max_sessions_per_token: 4,
            max_wrong_tokens_per_minute: 30,
            guest_stay_s: 28_800.0,
            max_guests: 256,
        }
    }
}

/// Logging.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LogConfig {
    /// Default text.
    pub format: LogFormat,
    /// What is logged. Default "info".
    pub filter: String,
}

impl Default for LogConfig {
    fn default() -> Self {
        Self { format: LogFormat::Text, filter: "info".into() }
    }
}

/// How a log line is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// For people.
    Text,
    /// One object a line, for collectors.
    Json,
}

/// Traces: spans of requests, of sessions' lives, and of some late steps.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TracesConfig {
    /// Where they are sent: a collector that takes OTLP over gRPC, such as "http://127.0.0.1:4317". Default none: none are
    /// made. A collector that is absent costs no session anything; it is warned of once.
    pub endpoint: Option<String>,
    /// Certificates (PEM) of those who are trusted to sign the collector's, where its address begins with https. Default
    /// the system's.
    pub ca_file: Option<PathBuf>,
}

/// A fleet of Agones's that the server is of: its sidecar is told when the server takes sessions, how many it has, that it
/// lives, and that it ends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AgonesConfig {
    /// Where the sidecar is, such as "http://127.0.0.1:9357". Default none: the server is of no fleet.
    pub endpoint: Option<String>,
    /// Counter of sessions in the fleet's manifest. Default "sessions".
    pub counter: String,
}

impl Default for AgonesConfig {
    fn default() -> Self {
        Self { endpoint: None, counter: "sessions".into() }
    }
}

/// Limits of the transport.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TransportLimits {
    /// Connections at a time. When there are as many, an address that has few gets a place of the one that has most, and
    /// others are closed at once. Default 256: a client has one or two.
    pub max_connections: usize,
    /// Connections of one address at a time; further ones are closed as they come. Default 64: a lab behind one
    /// address, and a quarter of all.
    pub max_connections_per_peer: usize,
    /// Time for a connection to begin to speak, s. Default 5.
    pub handshake_timeout_s: f64,
    /// Calls and streams of one connection at a time. Default 32.
    pub max_streams_per_connection: u32,
    /// Largest message that is accepted from drivers and viewers. Default 64 KiB: they have little to say.
    pub max_incoming_bytes: usize,
    /// Largest message about sessions, and largest part of an upload. Default 8 MiB: a mesh of 100,000 triangles as text
    /// fits into the message that creates a session.
    pub max_request_bytes: usize,
    /// Calls about sessions with a message of more than `max_incoming_bytes` that are read and answered at a time. One
    /// more takes the place of the one that has been read longest. Default 32: so many fit into memory.
    pub max_large_requests: usize,
    /// Largest upload, which comes in parts: a scene's text with its files, or the file of a checkpoint; and the largest
    /// file of a checkpoint that is handed out. Default 128 MiB: a checkpoint of three million voxels, at 39 bytes a
    /// voxel, or a mesh of two million triangles in binary.
    pub max_upload_bytes: usize,
    /// Uploads, and files of checkpoints that are handed out, that are on their way at a time; one more takes the place of
    /// the oldest that is not whole. Default 4: with `max_upload_bytes`, the memory that they take.
    pub max_uploads: usize,
    /// Largest message that is sent. Default 64 MiB: what clients accept.
    pub max_outgoing_bytes: usize,
    /// Text of a scene that a client sends. Default 1 MiB: as the protocol says.
    pub max_scene_bytes: usize,
    /// Time between pings of an idle connection, s. Default 5: a dead peer is noticed about as soon
    /// as its leases run out.
    pub keepalive_interval_s: f64,
    /// Time for the answer to a ping, s. Default 5.
    pub keepalive_timeout_s: f64,
    /// Time for a unary call, s. Default 60: the largest scene builds in seconds on a busy machine.
    pub request_timeout_s: f64,
    /// Time for streams to end when the server stops, s. Default 5: orchestrators kill after 10 to 30.
    pub drain_timeout_s: f64,
}

impl Default for TransportLimits {
    fn default() -> Self {
        Self {
            max_connections: 256,
            max_connections_per_peer: 64,
            handshake_timeout_s: 5.0,
            max_streams_per_connection: 32,
            max_incoming_bytes: 64 << 10,
            max_request_bytes: 8 << 20,
            max_large_requests: 32,
            max_upload_bytes: 128 << 20,
            max_uploads: 4,
            max_outgoing_bytes: kerf_proto::MAX_MESSAGE_BYTES,
            max_scene_bytes: 1 << 20,
            keepalive_interval_s: 5.0,
            keepalive_timeout_s: 5.0,
            request_timeout_s: 60.0,
            drain_timeout_s: 5.0,
        }
    }
}

/// Limits of control streams.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ControlLimits {
    /// Contacts a second and tool when the client states no wish, Hz. Default 250: a station
    /// evaluates the contact model between them at its own rate.
    pub default_contact_rate_hz: f64,
    /// Most contacts a second and tool, Hz. Default 1000: a servo's rate; more carries nothing new.
    pub max_contact_rate_hz: f64,
    /// Age beyond which no contact is sent, and which those on their way should not exceed by waiting for each
    /// other, s. Default 0.1: a hand notices a force that comes later.
    pub max_contact_age_s: f64,
    /// Poses a second and tool that a driver may send, Hz; those beyond are rejected. Default 2000: twice a servo's
    /// rate, and no step uses more than the newest.
    pub max_pose_rate_hz: f64,
    /// Rejected poses in a row after which the stream ends. Default 100: at 1 kHz a tenth of a
    /// second of nothing but garbage, which is a broken client and no glitch.
    pub max_rejected_in_a_row: u32,
    /// Rejections that wait to be told; more are counted but not told. Default 16.
    pub max_untold_rejections: usize,
    /// Time for the first message of a stream, s. Default 5.
    pub hello_timeout_s: f64,
    /// A stream that says nothing for this long ends, s. Default 300: a session may be paused for a
    /// talk, and the leases have long run out.
    pub idle_timeout_s: f64,
    /// Drivers that send poses one call at a time, over all sessions. Default 32.
    pub max_unary_drivers: usize,
}

impl Default for ControlLimits {
    fn default() -> Self {
        Self {
            default_contact_rate_hz: 250.0,
            max_contact_rate_hz: 1000.0,
            max_contact_age_s: 0.1,
            max_pose_rate_hz: 2000.0,
            max_rejected_in_a_row: 100,
            max_untold_rejections: 16,
            hello_timeout_s: 5.0,
            idle_timeout_s: 300.0,
            max_unary_drivers: 32,
        }
    }
}

/// Limits of view streams.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ViewLimits {
    /// Age that keyframes, patches and states should not exceed by waiting for each other on their way, s.
    /// Default 0.25: an eye forgives what a hand does not, and a browser stops for a tenth of a second to tidy up.
    pub max_age_s: f64,
    /// Largest message; what is larger comes in fragments of this size. Default 1 MiB: clients of gRPC take 4 MiB
    /// unless they are told otherwise.
    pub max_message_bytes: usize,
    /// Most voxels of an object whose inside is told. Default 65,536: putting it together takes the session some 10 ms,
    /// and an answer has some 2 MB.
    pub max_interior_voxels: u32,
}

impl Default for ViewLimits {
    fn default() -> Self {
        Self { max_age_s: 0.25, max_message_bytes: 1 << 20, max_interior_voxels: 1 << 16 }
    }
}

impl ServerConfig {
    /// Puts the configuration together from file, environment and flags.
    ///
    /// # Errors
    /// What is wrong, and where it came from.
    pub fn load(args: &ConfigArgs) -> Result<Self> {
        Self::from_sources(args, std::env::vars())
    }

    fn from_sources(args: &ConfigArgs, env: impl Iterator<Item = (String, String)>) -> Result<Self> {
        let mut table = args.config.as_deref().map_or_else(|| Ok(Table::new()), read_file)?;
        for (name, text) in env {
            let is_field = name != ENV_FILE && !ENV_OF_CLIENTS.contains(&name.as_str());
            let Some(path) = name.strip_prefix(ENV_PREFIX).filter(|_| is_field) else { continue };
            set(&mut table, &path.to_lowercase().replace("__", "."), &text, &name)?;
        }
        for (field, text) in args.named() {
            set(&mut table, field, &text, &format!("--{}", field.replace(['.', '_'], "-")))?;
        }
        for setting in &args.set {
            let (field, text) = setting.split_once('=').with_context(|| format!("--set {setting}: no '='"))?;
            set(&mut table, field, text, "--set")?;
        }
        let config: Self = table.try_into().context("configuration")?;
        config.validate()?;
        Ok(config)
    }

    /// Refuses values that would stop the server from working.
    ///
    /// # Errors
    /// The first field whose value makes no sense.
    pub fn validate(&self) -> Result<()> {
        self.session.validate()?;
        let (transport, control, security) = (&self.transport, &self.control, &self.security);
        ensure!(
            security.certificate_file.is_some() == security.key_file.is_some(),
            "security.certificate_file, security.key_file: are given together, or not at all"
        );
        let endpoints = [
            ("traces.endpoint", &self.traces.endpoint, &["http", "https"][..]),
            ("agones.endpoint", &self.agones.endpoint, &["http"]),
        ];
        for (field, endpoint, schemes) in endpoints {
            let Some(endpoint) = endpoint else { continue };
            let forms = schemes.iter().map(|scheme| format!("{scheme}://host:port")).collect::<Vec<_>>().join(" or ");
            ensure!(is_address(endpoint, schemes), "{field} = {endpoint:?}: must be {forms}");
        }
        let positive = [
            ("security.max_sessions_per_token", security.max_sessions_per_token as f64),
            ("security.guest_stay_s", security.guest_stay_s),
            ("security.max_guests", security.max_guests as f64),
            ("security.max_wrong_tokens_per_minute", f64::from(security.max_wrong_tokens_per_minute)),
            ("network_threads", self.network_threads as f64),
            ("transport.max_connections", transport.max_connections as f64),
            ("transport.max_connections_per_peer", transport.max_connections_per_peer as f64),
            ("transport.handshake_timeout_s", transport.handshake_timeout_s),
            ("transport.max_streams_per_connection", f64::from(transport.max_streams_per_connection)),
            ("transport.max_incoming_bytes", transport.max_incoming_bytes as f64),
            ("max_record_mib", self.max_record_mib),
            ("record_rate_hz", self.record_rate_hz),
            ("max_journal_mib", self.max_journal_mib),
            ("transport.max_request_bytes", transport.max_request_bytes as f64),
            ("transport.max_large_requests", transport.max_large_requests as f64),
            ("transport.max_upload_bytes", transport.max_upload_bytes as f64),
            ("transport.max_uploads", transport.max_uploads as f64),
            ("transport.max_outgoing_bytes", transport.max_outgoing_bytes as f64),
            ("transport.max_scene_bytes", transport.max_scene_bytes as f64),
            ("transport.keepalive_interval_s", transport.keepalive_interval_s),
            ("transport.keepalive_timeout_s", transport.keepalive_timeout_s),
            ("transport.request_timeout_s", transport.request_timeout_s),
            ("transport.drain_timeout_s", transport.drain_timeout_s),
            ("control.default_contact_rate_hz", control.default_contact_rate_hz),
            ("control.max_contact_rate_hz", control.max_contact_rate_hz),
            ("control.max_contact_age_s", control.max_contact_age_s),
            ("control.max_pose_rate_hz", control.max_pose_rate_hz),
            ("view.max_age_s", self.view.max_age_s),
            ("view.max_message_bytes", self.view.max_message_bytes as f64),
            ("control.max_rejected_in_a_row", f64::from(control.max_rejected_in_a_row)),
            ("control.max_untold_rejections", control.max_untold_rejections as f64),
            ("control.hello_timeout_s", control.hello_timeout_s),
            ("control.idle_timeout_s", control.idle_timeout_s),
            ("control.max_unary_drivers", control.max_unary_drivers as f64),
        ];
        for (field, value) in positive {
            // Also keeps durations within what the runtime can represent.
            ensure!(value > 0.0 && value <= 1e12, "{field} = {value}: must be greater than 0 and at most 1e12");
        }
        Ok(())
    }
}

impl ConfigArgs {
    /// The flags that stand for one field each.
    fn named(&self) -> impl Iterator<Item = (&'static str, String)> {
        let listen = self.listen.map(|listen| ("listen", listen.to_string()));
        let format = self.log_format.clone().map(|format| ("log.format", format));
        let filter = self.log_filter.clone().map(|filter| ("log.filter", filter));
        let dir = self
            .security_dir
            .as_ref()
            .map(|dir| ("security.dir", Value::String(dir.to_string_lossy().into()).to_string()));
        let insecure = self.insecure.then(|| ("security.insecure", "true".into()));
        [listen, dir, insecure, format, filter].into_iter().flatten()
    }
}

/// Whether a text is the address of a server and nothing else.
fn is_address(text: &str, schemes: &[&str]) -> bool {
    text.parse::<Uri>().is_ok_and(|uri| {
        let is_scheme = uri.scheme_str().is_some_and(|scheme| schemes.contains(&scheme));
        is_scheme && uri.host().is_some_and(|host| !host.is_empty()) && uri.path() == "/" && uri.query().is_none()
    })
}

fn read_file(path: &Path) -> Result<Table> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    // Once as what it is to become, for an error that knows its line.
    toml::from_str::<ServerConfig>(&text).with_context(|| path.display().to_string())?;
    toml::from_str(&text).with_context(|| path.display().to_string())
}

/// Sets the field at a dotted path; a text that is no TOML value is taken as a string.
fn set(table: &mut Table, path: &str, text: &str, source: &str) -> Result<()> {
    let value = toml::from_str::<Table>(&format!("value = {text}")).ok().and_then(|mut parsed| parsed.remove("value"));
    let value = value.unwrap_or_else(|| Value::String(text.into()));
    let (parents, field) = path.rsplit_once('.').map_or(("", path), |(parents, field)| (parents, field));
    let mut place = table;
    for parent in parents.split('.').filter(|parent| !parent.is_empty()) {
        let entry = place.entry(parent).or_insert_with(|| Value::Table(Table::new()));
        place = entry.as_table_mut().with_context(|| format!("{source}: {path}: {parent} is not a table"))?;
    }
    place.insert(field.into(), value);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn load(file: &str, env: &[(&str, &str)], set: &[&str]) -> Result<ServerConfig> {
        let mut on_disk = tempfile::NamedTempFile::new()?;
        on_disk.write_all(file.as_bytes())?;
        let args = ConfigArgs {
            config: Some(on_disk.path().into()),
            set: set.iter().map(ToString::to_string).collect(),
            ..ConfigArgs::default()
        };
        ServerConfig::from_sources(&args, env.iter().map(|(name, text)| ((*name).into(), (*text).into())))
    }

    #[test]
    fn nothing_given_means_the_defaults() {
        let config = ServerConfig::from_sources(&ConfigArgs::default(), std::iter::empty()).unwrap();
        assert_eq!(config, ServerConfig::default());
    }

    #[test]
    fn flags_win_over_environment_over_file() {
        let file = "[session]\nlease_s = 3.0\nmax_viewers = 3\nmax_drivers = 3";
        let env = [("KERF_SESSION__LEASE_S", "4.0"), ("KERF_SESSION__MAX_VIEWERS", "4"), ("HOME", "/")];
        let session = load(file, &env, &["session.lease_s=5.0"]).unwrap().session;
        assert_eq!((session.lease_s, session.max_viewers, session.max_drivers), (5.0, 4, 3));
    }

    #[test]
    fn words_and_addresses_need_no_quotes() {
        let config = load("", &[("KERF_LOG__FORMAT", "json"), ("KERF_LISTEN", "0.0.0.0:9")], &[]).unwrap();
        assert_eq!((config.log.format, config.listen.port()), (LogFormat::Json, 9));
    }

    #[test]
    fn an_unknown_field_is_refused_with_file_and_line() {
        let error = format!("{:#}", load("[control]\n\nmax_rejected = 3", &[], &[]).unwrap_err());
        assert!(error.contains("line 3") && error.contains("max_rejected"), "{error}");
        assert!(load("", &[("KERF_NONSENSE", "1")], &[]).is_err());
        assert!(load("", &[], &["session.nonsense=1"]).is_err());
    }

    #[test]
    fn an_endpoint_of_traces_is_an_address_and_nothing_else() {
        let traces =
            |endpoint: &str| load("", &[], &[&format!("traces.endpoint={endpoint}")]).map(|config| config.traces);
        for endpoint in ["http://127.0.0.1:4317", "https://collector.example:4317", "http://[::1]:4317/"] {
            assert_eq!(traces(endpoint).unwrap().endpoint.as_deref(), Some(endpoint));
        }
        for endpoint in ["127.0.0.1:4317", "ftp://collector.example", "http://collector.example/v1/traces", "http://"] {
            let error = format!("{:#}", traces(endpoint).unwrap_err());
            assert!(error.starts_with(&format!("traces.endpoint = {endpoint:?}: ")), "{error}");
        }
    }

    #[test]
    fn a_value_that_makes_no_sense_is_refused_with_its_name() {
        let error = format!("{:#}", load("[transport]\ndrain_timeout_s = -1.0", &[], &[]).unwrap_err());
        assert!(error.contains("drain_timeout_s"), "{error}");
    }
}
