//! The one place where errors become gRPC statuses.

use std::sync::Arc;

use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, WWW_AUTHENTICATE};
use axum::http::{HeaderMap, HeaderValue, Response, StatusCode};
use kerf_physics::scene::text::{escaped, shortened};
use kerf_physics::world::LoadError;
use kerf_proto::MOVED_TO;
use kerf_scenes::dial::DialError;
use kerf_session::SessionError;
use kerf_session::player::SPEEDS;
use tonic::{Code, Status};
use tonic_types::{ErrorDetails, StatusExt};

use crate::config::setting;

/// Why a call was refused or a stream ended.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// A session refused.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The transport failed while a stream was read.
    #[error("{}", .0.message())]
    Transport(Box<Status>),
    /// The client speaks another version.
    #[error("{field} = {theirs}: must be {}, which this server speaks", kerf_proto::PROTOCOL_VERSION)]
    ProtocolVersion {
        /// The field.
        field: &'static str,
        /// The client's.
        theirs: u32,
    },
    /// A control stream began with something else.
    #[error(
        "hello: must be the first message of a control stream, within {limit_s} s ({})",
        setting!(control.hello_timeout_s)
    )]
    HelloMissing {
        /// `control.hello_timeout_s`.
        limit_s: f64,
    },
    /// A second hello.
    #[error("hello: must be the first message of a control stream, and no other")]
    HelloRepeated,
    /// A hello for a tool that is not in the scene.
    #[error("hello.tool_ids[{place}] = {tool}: must be less than {tools}, the scene's number of tools")]
    HelloTool {
        /// Its place among those asked for.
        place: usize,
        /// The index asked for.
        tool: u32,
        /// Tools of the scene.
        tools: usize,
    },
    /// A required field is absent.
    #[error("{field}: is required")]
    Missing {
        /// The field.
        field: &'static str,
    },
    /// A number is not one.
    #[error("{field} = {value}: must be 0 or greater")]
    Rate {
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// A wish that does not go with the others.
    #[error("{field}: must be {limit}")]
    Choice {
        /// The field.
        field: &'static str,
        /// What is granted.
        limit: &'static str,
    },
    /// A wish for the dial that is no number of its kind.
    #[error("{field} = {value}: must be finite and greater than 0")]
    Dial {
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// A client's key that is too long to be kept.
    #[error("hello.client_key: has {bytes} bytes, more than {limit}")]
    ClientKey {
        /// Its length.
        bytes: usize,
        /// Bytes that it may have.
        limit: usize,
    },
    /// Nothing but rejected poses.
    #[error("{count} poses in a row were rejected, the last for {field}, which must be {limit}")]
    TooManyRejected {
        /// How many.
        count: u32,
        /// The last rejected field.
        field: String,
        /// Its limit.
        limit: String,
    },
    /// Nothing was heard of a control stream.
    #[error("nothing was heard for {limit_s} s ({})", setting!(control.idle_timeout_s))]
    Idle {
        /// `control.idle_timeout_s`.
        limit_s: f64,
    },
    /// A unary driver's lease is not known.
    #[error("lease: unknown or run out; begin anew with an empty one")]
    UnknownLease,
    /// A unary driver's lease is of another session than the call names.
    #[error("session_id: the lease is one of {session}")]
    LeaseOfOther {
        /// Its session.
        session: String,
    },
    /// A viewer that is not, or not any more.
    #[error("viewer: there is none of this name; its stream has ended")]
    NoViewer,
    /// An upload that is not, or not any more.
    #[error(
        "upload_id: there is none of this name; it has been used, was not heard of for {limit_s} s ({}), \
         was too large, or gave way to another ({}): send the files anew",
        setting!(transport.request_timeout_s),
        setting!(transport.max_uploads)
    )]
    NoUpload {
        /// `transport.request_timeout_s`.
        limit_s: f64,
    },
    /// Too many drivers that send one pose a call.
    #[error("{limit} clients send poses one call at a time, as many as may ({})", setting!(control.max_unary_drivers))]
    TooManyUnaryDrivers {
        /// `control.max_unary_drivers`.
        limit: usize,
    },
    /// A large message that others need the place of, or that finds none.
    #[error(
        "as many large messages are read and answered as may, {limit} ({}): this one gives way",
        setting!(transport.max_large_requests)
    )]
    TooManyLargeMessages {
        /// `transport.max_large_requests`.
        limit: usize,
    },
    /// A message that is too large to be read.
    #[error(
        "the message has more than {limit} bytes ({}); a scene's files may be sent in parts",
        setting!(transport.max_request_bytes)
    )]
    LargeMessage {
        /// `transport.max_request_bytes`.
        limit: usize,
    },
    /// A message that took too long to come.
    #[error("the message was not whole within {limit_s} s ({})", setting!(transport.request_timeout_s))]
    UnreadInTime {
        /// `transport.request_timeout_s`.
        limit_s: f64,
    },
    /// A message that broke off.
    #[error("the message broke off: {message}")]
    Unread {
        /// What the transport says.
        message: String,
    },
    /// A request by a name that this server does not have.
    #[error("host {host:?}: this server answers to localhost, 127.0.0.0/8, [::1] and its `names` alone")]
    ForeignHost {
        /// The name.
        host: String,
    },
    /// A request of another server's page.
    #[error("origin {origin:?}: pages of {host:?} and of security.allowed_origins alone may call this server")]
    ForeignOrigin {
        /// Where the page came from.
        origin: String,
        /// The name of this server.
        host: String,
    },
    /// A path at which there is nothing.
    #[error("{path}: there is no such call, and no such page")]
    NoCall {
        /// The path.
        path: String,
    },
    /// A call without a token.
    #[error(
        "this server takes no call without a token, sent as `authorization: Bearer TOKEN`; `kerf-server token new` makes \
         one ({})",
        setting!(security.token_file)
    )]
    TokenMissing,
    /// A call with a token that is none.
    #[error("the token is not known, or has expired ({})", setting!(security.token_file))]
    TokenUnknown,
    /// More wrong tokens than may be.
    #[error(
        "more than {limit} wrong tokens came from this address within a minute ({})",
        setting!(security.max_wrong_tokens_per_minute)
    )]
    TooManyWrongTokens {
        /// `security.max_wrong_tokens_per_minute`.
        limit: u32,
    },
    /// A token that is not good for this.
    #[error("the token of {name:?} is a {role}'s, and {path} takes a {needed}'s")]
    Role {
        /// Whose it is.
        name: String,
        /// What it is good for.
        role: &'static str,
        /// What was called.
        path: String,
        /// What that takes.
        needed: &'static str,
    },
    /// The end of a session that is somebody else's.
    #[error("session {session}: its owner and operators alone end it")]
    NotOwner {
        /// The session.
        session: String,
    },
    /// A token of one session, and something that is about another or none.
    #[error("the token is good for session {session} alone, and creates none")]
    OfOneSession {
        /// Its session.
        session: String,
    },
    /// A private session of nobody.
    #[error("private: this server asks for no tokens, and knows nobody whose own a session could be")]
    NobodysOwn,
    /// A guest on a server that lets in anybody.
    #[error("this server asks for no tokens: whoever has the session's address can view it")]
    NoGuests,
    /// More guests than may be.
    #[error("{limit} links for viewers are good, as many as may be ({})", setting!(security.max_guests))]
    TooManyGuests {
        /// `security.max_guests`.
        limit: usize,
    },
    /// The system gives no random numbers.
    #[error("the system gives no random numbers")]
    NoRandomNumbers,
    /// More sessions of a token than may be.
    #[error(
        "the token of {name:?} has {limit} sessions, as many as one may ({})",
        setting!(security.max_sessions_per_token)
    )]
    TooManySessionsOfToken {
        /// Whose it is.
        name: String,
        /// `security.max_sessions_per_token`.
        limit: usize,
    },
    /// An object that is not in the scene.
    #[error("object = {object}: the scene has {objects}, counted from 0")]
    NoObject {
        /// Its index.
        object: u32,
        /// Objects in the scene.
        objects: usize,
    },
    /// More voxels than are told.
    #[error(
        "object = {object}: it has {voxels} voxels, and the inside of {limit} at most is told ({})",
        setting!(view.max_interior_voxels)
    )]
    TooManyVoxels {
        /// Its index.
        object: u32,
        /// Its voxels.
        voxels: u32,
        /// `view.max_interior_voxels`.
        limit: u32,
    },
    /// No scene of this name.
    #[error("no scene {name:?}{guess}")]
    NoScene {
        /// The name.
        name: String,
        /// Words about a name that is like it, or nothing.
        guess: String,
    },
    /// The text of a scene is not one.
    #[error("{message}")]
    SceneText {
        /// What is wrong and where.
        message: String,
    },
    /// More inputs than steps.
    #[error("inputs: {inputs} entries for {steps} steps")]
    TooManyInputs {
        /// The entries.
        inputs: usize,
        /// The steps.
        steps: u32,
    },
    /// A motion in an input is none.
    #[error("inputs[{input}].motions[{motion}]{path}: {limit}")]
    Motion {
        /// The input.
        input: usize,
        /// Its motion.
        motion: usize,
        /// Path of the field in it.
        path: String,
        /// The limit that the field broke, for people.
        limit: String,
    },
    /// One session of several.
    #[error("sessions[{index}].{error}")]
    OfSession {
        /// Which.
        index: usize,
        /// Why.
        error: Box<Self>,
    },
    /// More steps of many sessions than a call takes.
    #[error("sessions: {steps} steps together, must be 1 to {limit}")]
    StepsTogether {
        /// How many.
        steps: u32,
        /// How many it takes.
        limit: u32,
    },
    /// More steps at once than may be, or none.
    #[error("steps = {steps}: must be 1 to {limit}")]
    Steps {
        /// The number.
        steps: u32,
        /// Most steps.
        limit: u32,
    },
    /// A speed that no recording is played at.
    #[error("speed = {speed}: must be {} to {}", SPEEDS.start(), SPEEDS.end())]
    Speed {
        /// The speed.
        speed: f64,
    },
    /// A file that is not taken as a checkpoint.
    #[error("data: {error}")]
    CheckpointFile {
        /// Why.
        error: LoadError,
    },
    /// What is sent in parts is too large.
    #[error(
        "data: more than {limit} bytes, the most that a file of a checkpoint or those of a scene have ({})",
        setting!(transport.max_upload_bytes)
    )]
    UploadSize {
        /// `transport.max_upload_bytes`.
        limit: usize,
    },
    /// What is sent in parts, and others need the place of, or finds none.
    #[error("as many files are on their way as may, {limit} ({}): this one gives way", setting!(transport.max_uploads))]
    TooManyUploads {
        /// `transport.max_uploads`.
        limit: usize,
    },
    /// An address that a session cannot move to.
    #[error("to: {address:?} is not an address as https://NAME:PORT or http://NAME:PORT")]
    NoAddress {
        /// What was given.
        address: String,
    },
    /// What a session is moved to a server with makes no sense.
    #[error("{field}: {message}")]
    MoveAccess {
        /// The field.
        field: &'static str,
        /// Why.
        message: String,
    },
    /// Another server that does not take a session.
    #[error("{to} does not take the session, which goes on here: {message}")]
    NotTaken {
        /// Its address.
        to: String,
        /// What it says, or the transport.
        message: String,
    },
    /// What comes from another server is no session.
    #[error("data: {message}")]
    NoWholeSession {
        /// Why.
        message: String,
    },
    /// The file of a checkpoint could not be made or read, for no reason that was foreseen.
    #[error("the checkpoint's file could not be made or read; the server's log says why")]
    CheckpointWork,
    /// The session did not answer in time.
    #[error("the session did not answer within {limit_s} s ({})", setting!(transport.request_timeout_s))]
    Unresponsive {
        /// `transport.request_timeout_s`.
        limit_s: f64,
    },
}

impl RequestError {
    /// The same, said of one session among several.
    pub fn of_session(self, index: usize) -> Self {
        Self::OfSession { index, error: Box::new(self) }
    }

    /// The setting that was in the way, by the name that `--set` takes.
    pub fn setting(&self) -> Option<&'static str> {
        Some(match self {
            Self::Session(error) => return error.setting(),
            Self::OfSession { error, .. } => return error.setting(),
            Self::TooManyWrongTokens { .. } => setting!(security.max_wrong_tokens_per_minute),
            Self::TooManySessionsOfToken { .. } => setting!(security.max_sessions_per_token),
            Self::TooManyGuests { .. } => setting!(security.max_guests),
            Self::TooManyUnaryDrivers { .. } => setting!(control.max_unary_drivers),
            Self::HelloMissing { .. } => setting!(control.hello_timeout_s),
            Self::TooManyLargeMessages { .. } => setting!(transport.max_large_requests),
            Self::LargeMessage { .. } => setting!(transport.max_request_bytes),
            Self::TooManyUploads { .. } => setting!(transport.max_uploads),
            Self::UploadSize { .. } => setting!(transport.max_upload_bytes),
            Self::UnreadInTime { .. } | Self::Unresponsive { .. } => setting!(transport.request_timeout_s),
            _ => return None,
        })
    }

    fn code(&self) -> Code {
        match self {
            Self::Session(error) => session_code(error),
            Self::OfSession { error, .. } => error.code(),
            Self::Transport(status) => status.code(),
            Self::ProtocolVersion { .. }
            | Self::UnknownLease
            | Self::NobodysOwn
            | Self::NotTaken { .. }
            | Self::NoWholeSession { .. }
            | Self::NoGuests => Code::FailedPrecondition,
            Self::HelloMissing { .. }
            | Self::HelloRepeated
            | Self::Missing { .. }
            | Self::Rate { .. }
            | Self::Choice { .. }
            | Self::Dial { .. }
            | Self::ClientKey { .. }
            | Self::Steps { .. }
            | Self::StepsTogether { .. }
            | Self::Speed { .. }
            | Self::TooManyInputs { .. }
            | Self::Motion { .. }
            | Self::TooManyRejected { .. }
            | Self::LeaseOfOther { .. }
            | Self::NoObject { .. }
            | Self::TooManyVoxels { .. }
            | Self::CheckpointFile { .. }
            | Self::NoAddress { .. }
            | Self::MoveAccess { .. }
            | Self::SceneText { .. } => Code::InvalidArgument,
            Self::Idle { .. } | Self::Unresponsive { .. } | Self::UnreadInTime { .. } => Code::DeadlineExceeded,
            Self::TooManyUnaryDrivers { .. }
            | Self::TooManyLargeMessages { .. }
            | Self::LargeMessage { .. }
            | Self::UploadSize { .. }
            | Self::TooManyWrongTokens { .. }
            | Self::TooManySessionsOfToken { .. }
            | Self::TooManyGuests { .. }
            | Self::TooManyUploads { .. } => Code::ResourceExhausted,
            Self::TokenMissing | Self::TokenUnknown => Code::Unauthenticated,
            Self::CheckpointWork | Self::NoRandomNumbers => Code::Internal,
            Self::Unread { .. } => Code::Cancelled,
            Self::ForeignHost { .. }
            | Self::ForeignOrigin { .. }
            | Self::NoCall { .. }
            | Self::Role { .. }
            | Self::NotOwner { .. }
            | Self::OfOneSession { .. } => Code::PermissionDenied,
            Self::NoScene { .. } | Self::NoViewer | Self::NoUpload { .. } | Self::HelloTool { .. } => Code::NotFound,
        }
    }
}

pub(crate) fn session_code(error: &SessionError) -> Code {
    match error {
        SessionError::TooManySessions { .. }
        | SessionError::Memory { .. }
        | SessionError::Load { .. }
        | SessionError::SetupTime { .. }
        | SessionError::TooManyDrivers { .. }
        | SessionError::TooManyViewers { .. }
        | SessionError::TooManyCommands { .. }
        | SessionError::TooManyCheckpoints { .. }
        | SessionError::NoThread { .. } => Code::ResourceExhausted,
        SessionError::Here { .. } => Code::AlreadyExists,
        SessionError::ComesBack { .. } | SessionError::Leaving => Code::Unavailable,
        SessionError::NoSession { .. }
        | SessionError::Moved { .. }
        | SessionError::NoTool { .. }
        | SessionError::NoCheckpoint { .. }
        | SessionError::Closed => Code::NotFound,
        SessionError::ToolTaken { .. }
        | SessionError::Failed { .. }
        | SessionError::Unrecoverable { .. }
        | SessionError::IsReplay
        | SessionError::NotReplay => Code::FailedPrecondition,
        SessionError::Dial(DialError::Scene(_))
        | SessionError::Scene(_)
        | SessionError::Rate { .. }
        | SessionError::Input { .. }
        | SessionError::PointName { .. } => Code::InvalidArgument,
        SessionError::Dial(_) => Code::FailedPrecondition,
        SessionError::StepsEnded { .. } => Code::Aborted,
        SessionError::Draining { .. } => Code::Unavailable,
    }
}

/// Longest message of a status, bytes. It goes into the head of an answer twice, for which clients take 8 KiB.
const MAX_MESSAGE_BYTES: usize = 1024;

impl From<RequestError> for Status {
    fn from(error: RequestError) -> Self {
        let mut status = error.status();
        // What it was made of stays on this side: refusals are counted by it.
        status.set_source(Arc::new(error));
        status
    }
}

impl RequestError {
    /// Where the session that it is about has gone.
    fn moved_to(&self) -> Option<&str> {
        match self {
            Self::Session(SessionError::Moved { to, .. }) => Some(to),
            Self::OfSession { error, .. } => error.moved_to(),
            _ => None,
        }
    }

    fn status(&self) -> Status {
        let mut status = self.plain_status();
        if let Some(Ok(to)) = self.moved_to().map(str::parse) {
            status.metadata_mut().insert(MOVED_TO, to);
        }
        status
    }

    fn plain_status(&self) -> Status {
        let code = self.code();
        // Clients' own texts are in some of them.
        let message = shortened(&escaped(&self.to_string()), MAX_MESSAGE_BYTES);
        // Messages begin with the path of the field, where one is at fault.
        let details = match (code, field(&message)) {
            (Code::ResourceExhausted, _) => {
                // Clients know a limit by its name in its section.
                let limit = self.setting().map_or("", in_section);
                ErrorDetails::with_quota_failure_violation(limit, &message)
            }
            (Code::InvalidArgument, field) => ErrorDetails::with_bad_request_violation(field, &message),
            (_, "") => return Status::new(code, message),
            (_, field) => ErrorDetails::with_bad_request_violation(field, &message),
        };
        Status::with_error_details(code, message, details)
    }
}

/// The answer to a request that no service sees: in gRPC's way to those who asked in it, else as a page.
pub fn refusal(asked: &HeaderMap, error: RequestError) -> Response<Body> {
    let kind = asked.get(CONTENT_TYPE).filter(|kind| kind.as_bytes().starts_with(b"application/grpc"));
    let status = Status::from(error);
    match kind {
        Some(kind) => {
            let mut answer = status.into_http::<Body>();
            answer.headers_mut().insert(CONTENT_TYPE, kind.clone());
            answer
        }
        None => {
            let mut answer = Response::new(Body::from(format!("{}\n", status.message())));
            *answer.status_mut() = match status.code() {
                Code::Unauthenticated => StatusCode::UNAUTHORIZED,
                Code::ResourceExhausted => StatusCode::TOO_MANY_REQUESTS,
                _ => StatusCode::FORBIDDEN,
            };
            if status.code() == Code::Unauthenticated {
                answer.headers_mut().insert(WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
            }
            answer.extensions_mut().insert(status);
            answer
        }
    }
}

/// The path that a message begins with, as in `step_rate_hz: must be` and `rate_hz = 0: must be`; else nothing.
fn field(message: &str) -> &str {
    let is_path = |c: char| c.is_ascii_alphanumeric() || "_.[]".contains(c);
    let path = &message[..message.find(|c| !is_path(c)).unwrap_or(message.len())];
    let follows = &message[path.len()..];
    // An address goes on in another way.
    let is_field = follows.starts_with(" = ") || follows.starts_with(':') && !follows.starts_with("://");
    if is_field { path } else { "" }
}

/// A setting by its name in its section.
pub fn in_section(setting: &str) -> &str {
    setting.rsplit_once('.').map_or(setting, |(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_that_is_at_fault_is_named_in_the_details() {
        let violation = |error: RequestError| {
            Status::from(error).get_details_bad_request().unwrap().field_violations[0].field.clone()
        };
        assert_eq!(violation(RequestError::Missing { field: "scene" }), "scene");
        assert_eq!(violation(RequestError::Rate { field: "rate_hz", value: -1.0 }), "rate_hz");
        assert_eq!(violation(RequestError::HelloRepeated), "hello");
        let version = RequestError::ProtocolVersion { field: "hello.protocol_version", theirs: 2 };
        assert_eq!(violation(version), "hello.protocol_version");
    }

    #[test]
    fn what_is_no_path_of_a_field_is_not_told_as_one() {
        let to = "https://b.example:50051".to_owned();
        let status = Status::from(RequestError::NotTaken { to, message: "it is full".into() });
        assert!(status.get_details_bad_request().is_none(), "{status:?}");
    }

    #[test]
    fn texts_of_clients_are_bounded_and_shown_for_what_they_are() {
        let mean = format!("name: \u{202e}{}\0\u{1b}[2J (max_sessions)", "\u{fffd}".repeat(300_000));
        let status = Status::from(RequestError::SceneText { message: mean });
        let message = status.message();
        assert!(message.len() <= MAX_MESSAGE_BYTES && message.starts_with("name: \\u{202e}"), "{message}");
        assert!(message.ends_with("\\u{0}\\u{1b}[2J (max_sessions)"), "{message}");
        assert_eq!(status.get_details_bad_request().unwrap().field_violations[0].field, "name");
        let head: usize =
            status.into_http::<Body>().headers().iter().map(|(name, value)| name.as_str().len() + value.len()).sum();
        assert!(head < 8 << 10, "{head} bytes");
    }

    #[test]
    fn a_full_server_is_told_from_a_bad_request() {
        let status = Status::from(RequestError::from(SessionError::TooManySessions { limit: 3 }));
        assert_eq!(status.code(), Code::ResourceExhausted);
        assert!(status.message().ends_with("(session.max_sessions)"), "{status}");
        let quota = status.get_details_quota_failure().unwrap();
        assert_eq!(quota.violations[0].subject, "max_sessions");
        let taken = SessionError::ToolTaken { tool: 0, lease_s: 2.0 };
        assert_eq!(Status::from(RequestError::from(taken)).code(), Code::FailedPrecondition);
    }
}
