//! A server of a few lines: a floor at y = 0 that pushes back like a spring, and whatever goes wrong with it.

use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use kerf_proto::v1::control_service_server::{ControlService, ControlServiceServer};
use kerf_proto::v1::{self, ControlRequest, ControlResponse, control_request, control_response};
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tokio_stream::{Stream, StreamExt};
use tonic::transport::{Identity, ServerTlsConfig};
use tonic::{Request, Response, Status, Streaming};

/// Of the floor.
const STIFFNESS_N_PER_M: f32 = 300.0;

/// What the server does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Does {
    Well,
    /// Sends contacts that are no number.
    NotANumber,
    /// Says nothing, and takes nothing either.
    Stalls,
    /// Ends streams: the session is not there.
    SessionGone,
}

/// What is shared by all of its streams.
#[derive(Clone)]
struct Floor {
    does: Arc<AtomicU8>,
    streams: Arc<AtomicU32>,
    token: Option<&'static str>,
}

/// A running server; it is killed when this is dropped, connections and all.
pub struct Server {
    pub address: SocketAddr,
    floor: Floor,
    runtime: Option<Runtime>,
}

impl Server {
    pub fn start() -> Self {
        Self::at("127.0.0.1:0".parse().unwrap(), None, None)
    }

    /// At an address, for those who know a token, over TLS where it has an identity.
    pub fn at(address: SocketAddr, token: Option<&'static str>, identity: Option<Identity>) -> Self {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let floor = Floor { does: Arc::default(), streams: Arc::default(), token };
        let served = floor.clone();
        let address = runtime.block_on(async move {
            let listener = TcpListener::bind(address).await.expect("a port");
            let address = listener.local_addr().unwrap();
            let mut server = tonic::transport::Server::builder();
            if let Some(identity) = identity {
                server = server.tls_config(ServerTlsConfig::new().identity(identity)).expect("a certificate");
            }
            let routes = server.add_service(ControlServiceServer::new(served));
            tokio::spawn(routes.serve_with_incoming(TcpListenerStream::new(listener)));
            address
        });
        Self { address, floor, runtime: Some(runtime) }
    }

    pub fn set(&self, does: Does) {
        self.floor.does.store(does as u8, Ordering::Relaxed);
    }

    /// Streams that were opened.
    pub fn streams(&self) -> u32 {
        self.floor.streams.load(Ordering::Relaxed)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

fn now_ns() -> u64 {
    static ORIGIN: OnceLock<Instant> = OnceLock::new();
    ORIGIN.get_or_init(Instant::now).elapsed().as_nanos() as u64
}

impl Floor {
    fn does(&self) -> u8 {
        self.does.load(Ordering::Relaxed)
    }

    fn contact(&self, number: u64, pose: &v1::ToolPose, arrived_ns: u64) -> v1::Contact {
        let at = pose.pose.unwrap_or_default();
        let height_m = at.position_m.unwrap_or_default().y;
        let good_n = STIFFNESS_N_PER_M * (-height_m).max(0.0);
        let force_n = if self.does() == Does::NotANumber as u8 { f32::NAN } else { good_n };
        let mut stiffness = vec![0.0; 21];
        stiffness[6] = STIFFNESS_N_PER_M;
        let model = v1::ContactModel {
            reference: Some(at),
            stiffness,
            damping: vec![0.0; 21],
            velocity_m_per_s: Some(v1::Vec3::default()),
            validity_radius_m: 0.05,
            ..Default::default()
        };
        let force = v1::Vec3 { x: 0.0, y: force_n, z: 0.0 };
        v1::Contact {
            tool_id: pose.tool_id,
            echo_seq: pose.seq,
            echo_ns: pose.client_ns,
            echo_arrived_ns: arrived_ns,
            server_ns: now_ns(),
            number,
            wrench: Some(v1::Wrench { force_n: Some(force), torque_nm: Some(v1::Vec3::default()) }),
            model: (height_m < 0.0).then_some(model),
            ..Default::default()
        }
    }
}

#[tonic::async_trait]
impl ControlService for Floor {
    type ControlStream = Pin<Box<dyn Stream<Item = Result<ControlResponse, Status>> + Send>>;

    async fn control(
        &self,
        request: Request<Streaming<ControlRequest>>,
    ) -> Result<Response<Self::ControlStream>, Status> {
        let told = request.metadata().get("authorization").and_then(|value| value.to_str().ok());
        if self.token.is_some_and(|token| told != Some(token)) {
            return Err(Status::unauthenticated("no token"));
        }
        if self.does() == Does::Stalls as u8 {
            tokio::time::sleep(Duration::from_secs(3600)).await;
        }
        if self.does() == Does::SessionGone as u8 {
            return Err(Status::not_found("no such session"));
        }
        self.streams.fetch_add(1, Ordering::Relaxed);
        let mut incoming = request.into_inner();
        let (down, answers) = tokio::sync::mpsc::channel(4);
        let floor = self.clone();
        tokio::spawn(async move {
            let limits = v1::Limits { lease_s: 2.0, max_contact_age_s: 0.1, ..Default::default() };
            let hello = v1::ServerHello {
                protocol_version: 1,
                limits: Some(limits),
                contact_rate_hz: 250.0,
                ..Default::default()
            };
            let say = |message| Ok(ControlResponse { message: Some(message) });
            let _ = down.send(say(control_response::Message::Hello(hello))).await;
            let (mut pose, mut arrived_ns, mut number) = (None, 0, 0);
            let mut ticks = tokio::time::interval(Duration::from_millis(4));
            loop {
                tokio::select! {
                    message = incoming.next() => match message {
                        Some(Ok(message)) => if let Some(control_request::Message::Pose(newest)) = message.message {
                            (pose, arrived_ns) = (Some(newest), now_ns());
                        },
                        _ => return,
                    },
                    _ = ticks.tick() => {
                        let does = floor.does();
                        if does == Does::SessionGone as u8 {
                            let _ = down.send(Err(Status::not_found("no such session"))).await;
                            return;
                        }
                        if let Some(pose) = pose.as_ref().filter(|_| does != Does::Stalls as u8) {
                            number += 1;
                            let contact = floor.contact(number, pose, arrived_ns);
                            if down.send(say(control_response::Message::Contact(contact))).await.is_err() {
                                return;
                            }
                        }
                    }
                }
            }
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(answers))))
    }

    async fn send_pose(&self, _: Request<v1::SendPoseRequest>) -> Result<Response<v1::SendPoseResponse>, Status> {
        Err(Status::unimplemented("not here"))
    }
}
