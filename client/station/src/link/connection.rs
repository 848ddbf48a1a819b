//! Dialling: one stream after the other, each for the same tools of the same session.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::time::Duration;

use kerf_access::{Access, Wire, root_cause};
use kerf_proto::MOVED_TO;
use kerf_proto::v1::control_service_client::ControlServiceClient;
use kerf_proto::v1::{self, control_request, control_response};
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint, Error};
use tonic::{Code, Status, Streaming};

use super::receiver::{Heard, Receiver};
use super::sender::SharedUplink;
use super::status::{LinkState, SharedStatus};
use super::{LinkSettings, Uplink};
use crate::config::ServerConfig;
use crate::servo::model::Update;

/// Time for each step of dialling: a network that came back is found within two of them.
pub(super) const STEP_TIMEOUT: Duration = Duration::from_millis(800);
/// Pauses between attempts: the first one, and the longest; each is twice the one before.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
const LONGEST_PAUSE: Duration = Duration::from_millis(800);
/// Messages that may wait for the transport: a few ticks of the network's thread.
const QUEUED: usize = 8;

/// Why a stream ended, or did not begin.
pub(super) enum Ended {
    /// To be tried again.
    Broken(String),
    /// The session is not there any more.
    SessionGone(String),
    /// The session goes on at this address.
    Moved(String),
    /// Trying again is of no use.
    Hopeless(String),
}

impl Ended {
    /// For people.
    pub(super) fn text(self) -> String {
        match self {
            Self::Broken(why) | Self::SessionGone(why) | Self::Hopeless(why) => why,
            Self::Moved(to) => format!("the session has moved to {to}"),
        }
    }
}

/// Dials until it is told to stop.
pub(super) struct Dialler {
    settings: LinkSettings,
    uplink: SharedUplink,
    status: SharedStatus,
    receiver: Receiver,
    /// The session that was driven last.
    session_id: String,
    /// By which the server knows that it comes back: a stream whose network broke holds its tools for a while yet.
    client_key: String,
    epoch: u64,
}

impl Dialler {
    pub(super) fn new(
        settings: LinkSettings,
        uplink: SharedUplink,
        status: SharedStatus,
        updates: triple_buffer::Input<Update>,
    ) -> Self {
        let receiver = Receiver::new(updates, status.clone());
        Self { settings, uplink, status, receiver, session_id: String::new(), client_key: random_key(), epoch: 0 }
    }

    pub(super) async fn run(mut self, mut stopped: oneshot::Receiver<()>) {
        tokio::select! {
            _ = &mut stopped => {}
            () = self.dial() => {}
        }
        self.uplink.set(None);
        self.settings.session.leave(&self.settings.server).await;
    }

    async fn dial(&mut self) {
        let mut pause = FIRST_PAUSE;
        loop {
            let before = self.epoch;
            let ended = self.drive().await;
            self.uplink.set(None);
            let (why, state) = match ended {
                Ended::Broken(why) => (format!("{why}; trying again"), LinkState::Connecting),
                Ended::SessionGone(why) => match self.settings.session.gone(&self.session_id).await {
                    Ok(next) => (format!("{why}; {next}"), LinkState::Connecting),
                    Err(remedy) => (format!("{why}; {remedy}"), LinkState::Failed),
                },
                Ended::Moved(to) => {
                    self.settings.server.url.clone_from(&to);
                    (format!("the session has moved to {to}"), LinkState::Connecting)
                }
                Ended::Hopeless(why) => (why, LinkState::Failed),
            };
            self.status.change(|status| {
                status.fail(why);
                status.state = state;
            });
            if state == LinkState::Failed {
                return;
            }
            // A stream that stood was a good network; what broke it may be over already.
            pause = if self.epoch != before { FIRST_PAUSE } else { (pause * 2).min(LONGEST_PAUSE) };
            tokio::time::sleep(pause).await;
        }
    }

    /// One stream from its opening to its end.
    async fn drive(&mut self) -> Ended {
        match self.open().await {
            Err(ended) => ended,
            Ok(mut down) => loop {
                let silence = match self.status.get().state {
                    // A session that stands says nothing; that the connection lives is the transport's to know.
                    LinkState::Paused => Duration::MAX,
                    _ => Duration::from_secs_f64(self.settings.link.silence_s),
                };
                let Ok(message) = tokio::time::timeout(silence, down.message()).await else {
                    return Ended::Broken(format!("nothing came for {} s", self.settings.link.silence_s));
                };
                let message = match message {
                    Ok(Some(message)) => message.message,
                    Ok(None) => return Ended::Broken("the server ended the stream".into()),
                    Err(status) => return refused("the stream broke", &status),
                };
                match message.map(|message| self.receiver.take(message)) {
                    Some(Ok(Heard::SessionCloses)) => return Ended::SessionGone("the session was closed".into()),
                    Some(Err(missing)) => self.status.change(|status| status.fail(missing.to_string())),
                    Some(Ok(Heard::Goes)) | None => {}
                }
            },
        }
    }

    async fn open(&mut self) -> Result<Streaming<v1::ControlResponse>, Ended> {
        let wire = connect(&self.settings.server).await?;
        let session_id = self.settings.session.id(&wire).await?;
        if !self.session_id.is_empty() && self.session_id != session_id {
            self.receiver.is_made_anew("new organ, not cut yet");
        }
        self.session_id.clone_from(&session_id);
        let (up, queue) = mpsc::channel(QUEUED);
        let hello = v1::ClientHello {
            protocol_version: kerf_proto::PROTOCOL_VERSION,
            session_id: session_id.clone(),
            tool_ids: self.settings.tool_ids.to_vec(),
            contact_rate_hz: self.settings.link.contact_rate_hz,
            contact_deadband: self.settings.link.deadband,
            contact_keep_alive_s: self.settings.link.keep_alive_s,
            client_key: self.client_key.clone(),
            without_models: false,
        };
        let first = v1::ControlRequest { message: Some(control_request::Message::Hello(hello)), received: 0 };
        up.try_send(first).map_err(|_| Ended::Broken("the queue is full".into()))?;
        let opening = async {
            let mut client = ControlServiceClient::new(wire);
            let mut down = client.control(ReceiverStream::new(queue)).await?.into_inner();
            let hello = down.message().await?;
            Ok::<_, Status>((down, hello))
        };
        let opened = tokio::time::timeout(STEP_TIMEOUT, opening).await;
        let opened = opened.map_err(|_| Ended::Broken("the server did not answer the hello".into()))?;
        let (down, hello) = opened.map_err(|status| refused("opening the stream", &status))?;
        let Some(v1::ControlResponse { message: Some(control_response::Message::Hello(hello)) }) = hello else {
            return Err(Ended::Broken("the server did not begin with a hello".into()));
        };
        self.epoch += 1;
        let limits = hello.limits.unwrap_or_default();
        let received = self.receiver.begin(&hello);
        let workspace = limits.workspace_min_m.zip(limits.workspace_max_m).map(|(min, max)| [min, max]);
        self.uplink.set(Some(Uplink { epoch: self.epoch, up, received, lease_s: limits.lease_s, workspace }));
        self.status.change(|status| {
            status.connections += 1;
            (status.state, status.session_id) = (LinkState::Connected, session_id);
        });
        Ok(down)
    }
}

/// A name that nobody else has.
fn random_key() -> String {
    let word = || RandomState::new().build_hasher().finish();
    format!("{:016x}{:016x}", word(), word())
}

/// The wire to a server, with TLS and a token where they are configured.
pub(super) async fn connect(server: &ServerConfig) -> Result<Wire, Ended> {
    let hopeless = |what: String| Ended::Hopeless(format!("server: {what}"));
    let access = Access { ca_file: server.ca_file.clone(), token_file: server.token_file.clone() };
    let endpoint = access.endpoint(&server.url).map_err(|error| hopeless(error.to_string()))?;
    let endpoint = endpoint
        .tcp_nodelay(true)
        .connect_timeout(STEP_TIMEOUT)
        .http2_keep_alive_interval(Duration::from_secs(2))
        .keep_alive_timeout(Duration::from_secs(2))
        .keep_alive_while_idle(true);
    let token = access.token().map_err(|error| hopeless(error.to_string()))?;
    let broken = |why: String| Ended::Broken(format!("no server answers at {} ({why})", server.url));
    match tokio::time::timeout(STEP_TIMEOUT, dialled(&endpoint)).await {
        Err(_) => Err(broken(format!("nothing within {} s", STEP_TIMEOUT.as_secs_f64()))),
        Ok(Err(error)) => Err(broken(root_cause(&error))),
        Ok(Ok(channel)) => Ok(token.over(channel)),
    }
}

/// A connection, over the network of a simulation where there is one.
async fn dialled(endpoint: &Endpoint) -> Result<Channel, Error> {
    #[cfg(feature = "virtual-time")]
    if let Some(dialled) = super::virtual_network::dial() {
        return dialled.await;
    }
    endpoint.connect().await
}

/// What a refusal means.
pub(super) fn refused(what: &str, status: &Status) -> Ended {
    let why = format!("{what}: {}", status.message());
    if let Some(Ok(to)) = status.metadata().get(MOVED_TO).map(|to| to.to_str()) {
        return Ended::Moved(to.into());
    }
    match status.code() {
        Code::NotFound => Ended::SessionGone(why),
        Code::Unauthenticated | Code::PermissionDenied => {
            Ended::Hopeless(format!("{why}; set server.token_file to a file with a token that the server takes"))
        }
        _ => Ended::Broken(why),
    }
}
