//! A server in this process and clients of it.

use std::net::SocketAddr;
use std::time::Duration;

use kerf_physics::{Scene, SceneDesc};
use kerf_proto::PROTOCOL_VERSION;
use kerf_proto::v1::control_service_client::ControlServiceClient;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::view_service_client::ViewServiceClient;
use kerf_proto::v1::{self, control_request, control_response, create_session_request, view_response};
use kerf_replica::Assembler;
use kerf_server::config::ServerConfig;
use kerf_server::serve::Server;
use kerf_session::{Reel, SessionOptions};
pub use kerf_system_tests::readers::BLOCK;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Status, Streaming};

/// Longer than anything here takes on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Waits for something, but not for ever.
pub async fn soon<T>(what: &str, future: impl Future<Output = T>) -> T {
    match tokio::time::timeout(PATIENCE, future).await {
        Ok(done) => done,
        Err(_) => panic!("{what}: nothing within {PATIENCE:?}"),
    }
}

/// Leases that outlast a test: what is freed was freed by the end of its stream.
pub fn no_expiry(config: &mut ServerConfig) {
    config.session.lease_s = 600.0;
}

pub struct Harness {
    pub server: Server,
    pub channel: Channel,
    pub sessions: SessionServiceClient<Channel>,
}

impl Harness {
    pub async fn start() -> Self {
        Self::with(|_| ()).await
    }

    /// A server on a free port whose configuration was changed.
    pub async fn with(change: impl FnOnce(&mut ServerConfig)) -> Self {
        let mut config = ServerConfig { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..ServerConfig::default() };
        change(&mut config);
        let server = Server::start(config).await.expect("the server starts");
        let channel = connect(server.address()).await;
        Self { sessions: SessionServiceClient::new(channel.clone()), server, channel }
    }

    pub async fn create(&mut self) -> Result<String, Status> {
        self.create_of(BLOCK.into()).await
    }

    pub async fn create_of(&mut self, scene_toml: String) -> Result<String, Status> {
        let scene = Some(create_session_request::Scene::SceneToml(scene_toml));
        let request = v1::CreateSessionRequest { scene, ..Default::default() };
        let created = self.sessions.create_session(request).await?.into_inner();
        Ok(created.session.expect("a description").session_id)
    }

    /// A session of the block that tells the test all that it does.
    pub async fn create_on_tape(&self) -> (String, Reel) {
        let desc = toml::from_str::<SceneDesc>(BLOCK).expect("a scene");
        let options = SessionOptions { is_recorded: true, ..SessionOptions::default() };
        let scene = Scene { desc, meshes: Default::default() }.judge().expect("a sound scene");
        let session = self.server.registry().create(scene, options).await.expect("a session");
        (session.id().to_string(), session.take_reel().expect("a reel"))
    }

    pub async fn describe(&mut self, session_id: &str) -> v1::SessionDescription {
        let request = v1::DescribeSessionRequest { session_id: session_id.into() };
        let described = self.sessions.describe_session(request).await.expect("a session").into_inner();
        described.session.expect("a description")
    }

    /// Waits until the session's description is as wanted.
    pub async fn until(&mut self, session_id: &str, holds: impl Fn(&v1::SessionDescription) -> bool) {
        soon("a description", async {
            while !holds(&self.describe(session_id).await) {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        })
        .await;
    }

    /// The step after which the session stands.
    pub async fn pause(&mut self, session_id: &str) -> u64 {
        let request = v1::PauseSessionRequest { session_id: session_id.into() };
        self.sessions.pause_session(request).await.expect("a pause").into_inner().step
    }

    pub async fn reset(&mut self, session_id: &str) {
        let request = v1::ResetSessionRequest { session_id: session_id.into() };
        self.sessions.reset_session(request).await.expect("a reset");
    }

    pub async fn drive(&self, session_id: &str, tool_ids: &[u32]) -> Result<Station, Status> {
        Station::open(self.channel.clone(), hello(session_id, tool_ids)).await
    }

    pub async fn view(&self, channel: Channel, session_id: &str) -> View {
        self.view_as(channel, view_request(session_id)).await.expect("a view")
    }

    pub async fn view_as(&self, channel: Channel, request: v1::ViewRequest) -> Result<View, Status> {
        View::open(channel, self.channel.clone(), request).await
    }
}

pub fn view_request(session_id: &str) -> v1::ViewRequest {
    v1::ViewRequest { protocol_version: PROTOCOL_VERSION, session_id: session_id.into(), ..Default::default() }
}

/// A view stream that acknowledges what it is asked for.
pub struct View {
    pub stream: Streaming<v1::ViewResponse>,
    pub viewer: String,
    assembler: Assembler,
    client: ViewServiceClient<Channel>,
}

impl View {
    /// Views over one channel and acknowledges over another.
    async fn open(channel: Channel, acknowledged_over: Channel, request: v1::ViewRequest) -> Result<Self, Status> {
        let mut stream = ViewServiceClient::new(channel).view(request).await?.into_inner();
        match stream.message().await?.and_then(|event| event.message) {
            Some(view_response::Message::Hello(hello)) => Ok(Self {
                stream,
                viewer: hello.viewer,
                assembler: Assembler::default(),
                client: ViewServiceClient::new(acknowledged_over),
            }),
            other => panic!("a hello comes first, not {other:?}"),
        }
    }

    /// The next event, put together and not acknowledged; `None` at the end. What the session tells of a machine that
    /// is busy is left out: it may come at any time.
    pub async fn event(&mut self) -> Result<Option<v1::ViewResponse>, Status> {
        while let Some(event) = self.stream.message().await? {
            let whole = self.assembler.take(event).expect("fragments that fit");
            if let Some(whole) = whole.filter(|whole| !tells_of_load(whole)) {
                return Ok(Some(whole));
            }
        }
        Ok(None)
    }

    pub async fn acknowledge(&mut self, number: u64) -> Result<(), Status> {
        let request = v1::AcknowledgeRequest { viewer: self.viewer.clone(), number };
        self.client.acknowledge(request).await.map(drop)
    }

    /// The next message, acknowledged; `None` at the end.
    pub async fn message(&mut self) -> Result<Option<view_response::Message>, Status> {
        let Some(event) = self.event().await? else { return Ok(None) };
        if event.number > 0 {
            let (mut client, viewer) = (self.client.clone(), self.viewer.clone());
            // By itself, so that a caller who stops waiting loses nothing; a stream that has ended is known no more.
            tokio::spawn(async move {
                drop(client.acknowledge(v1::AcknowledgeRequest { viewer, number: event.number }).await);
            });
        }
        Ok(event.message)
    }
}

fn tells_of_load(event: &v1::ViewResponse) -> bool {
    use v1::EventKind::{Overloaded, Reanchored, ToleranceChanged};
    match &event.message {
        Some(view_response::Message::Event(event)) => {
            matches!(event.kind(), Overloaded | Reanchored | ToleranceChanged)
        }
        _ => false,
    }
}

pub async fn connect(address: SocketAddr) -> Channel {
    endpoint(address).connect().await.expect("a connection")
}

pub fn endpoint(address: SocketAddr) -> Endpoint {
    Endpoint::from_shared(format!("http://{address}")).expect("an address")
}

pub fn hello(session_id: &str, tool_ids: &[u32]) -> v1::ClientHello {
    v1::ClientHello {
        protocol_version: PROTOCOL_VERSION,
        session_id: session_id.into(),
        tool_ids: tool_ids.to_vec(),
        ..v1::ClientHello::default()
    }
}

/// What a viewer gets next.
pub async fn next(view: &mut View) -> view_response::Message {
    soon("a view event", view.message()).await.expect("no error").expect("the stream goes on")
}

/// A pose above the block.
pub fn pose(tool_id: u32, seq: u64, x_m: f32) -> v1::ToolPose {
    let position_m = Some(v1::Vec3 { x: x_m, y: 0.1, z: 0.0 });
    let orientation = Some(v1::Quat { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
    let pose = Some(v1::Pose { position_m, orientation });
    v1::ToolPose { tool_id, seq, client_ns: seq * 1000, pose, ..Default::default() }
}

/// One end of a control stream.
pub struct Station {
    pub hello: v1::ServerHello,
    up: mpsc::Sender<v1::ControlRequest>,
    down: Streaming<v1::ControlResponse>,
}

impl Station {
    pub async fn open(channel: Channel, hello: v1::ClientHello) -> Result<Self, Status> {
        let (up, messages) = mpsc::channel(64);
        let first = v1::ControlRequest { message: Some(control_request::Message::Hello(hello)), received: 0 };
        up.send(first).await.expect("room for the hello");
        let answer = ControlServiceClient::new(channel).control(ReceiverStream::new(messages)).await?;
        let mut down = answer.into_inner();
        match down.message().await?.and_then(|message| message.message) {
            Some(control_response::Message::Hello(hello)) => Ok(Self { hello, up, down }),
            other => panic!("a hello comes first, not {other:?}"),
        }
    }

    /// Whether the message was still taken.
    pub async fn say(&self, message: control_request::Message) -> bool {
        self.up.send(v1::ControlRequest { message: Some(message), received: 0 }).await.is_ok()
    }

    pub async fn send(&self, pose: v1::ToolPose) -> bool {
        self.say(control_request::Message::Pose(pose)).await
    }

    /// The next message, the status that ended the stream, or its good end.
    pub async fn next(&mut self) -> Option<Result<control_response::Message, Status>> {
        let message = self.next_unacknowledged().await?;
        if let Ok(control_response::Message::Contact(contact)) = &message {
            self.acknowledge(contact).await;
        }
        Some(message)
    }

    /// The same, but a contact is not acknowledged.
    pub async fn next_unacknowledged(&mut self) -> Option<Result<control_response::Message, Status>> {
        let message = soon("a message", self.down.message()).await.transpose()?;
        Some(message.map(|down| down.message.expect("a message that says something")))
    }

    pub async fn acknowledge(&self, contact: &v1::Contact) {
        let _ = self.up.send(v1::ControlRequest { message: None, received: contact.number }).await;
    }

    /// Skips messages until `pick` takes one.
    pub async fn pick<T>(&mut self, pick: impl Fn(control_response::Message) -> Option<T>) -> T {
        soon("the message", async {
            loop {
                let message = self.next().await.expect("the stream goes on").expect("no error");
                if let Some(picked) = pick(message) {
                    return picked;
                }
            }
        })
        .await
    }

    pub async fn contact_where(&mut self, holds: impl Fn(&v1::Contact) -> bool) -> v1::Contact {
        self.pick(|message| match message {
            control_response::Message::Contact(contact) => Some(contact).filter(|contact| holds(contact)),
            _ => None,
        })
        .await
    }

    pub async fn rejection(&mut self) -> v1::PoseRejected {
        self.pick(|message| match message {
            control_response::Message::Rejected(rejected) => Some(rejected),
            _ => None,
        })
        .await
    }

    /// The status with which the stream ends; `Ok` for a good end.
    pub async fn end(mut self) -> Code {
        loop {
            match self.next().await {
                Some(Ok(_)) => {}
                Some(Err(status)) => return status.code(),
                None => return Code::Ok,
            }
        }
    }
}

/// A cable between a client and the server that can be cut.
pub struct Cable {
    pub address: SocketAddr,
    forwarding: JoinHandle<()>,
}

impl Cable {
    pub async fn to(server: SocketAddr) -> Self {
        let listener = TcpListener::bind(("127.0.0.1", 0)).await.expect("a port");
        let address = listener.local_addr().expect("an address");
        let forwarding = tokio::spawn(async move {
            let (mut near, _) = listener.accept().await.expect("a client");
            let mut far = TcpStream::connect(server).await.expect("the server");
            // Either end's end is the cable's.
            let _ = tokio::io::copy_bidirectional(&mut near, &mut far).await;
        });
        Self { address, forwarding }
    }

    pub fn cut(self) {
        self.forwarding.abort();
    }
}
