//! What the sidecar of a pod hears of a server in a fleet of Agones's, and what becomes of one whose sidecar is not there.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use kerf_proto::agones::Empty;
use kerf_proto::agones::allocation::allocation_response::GameServerStatusPort;
use kerf_proto::agones::allocation::allocation_service_server::{AllocationService, AllocationServiceServer};
use kerf_proto::agones::allocation::game_server_selector::GameServerState;
use kerf_proto::agones::allocation::{AllocationRequest, AllocationResponse};
use kerf_proto::agones::beta::sdk_server::{Sdk as Counters, SdkServer as CountersServer};
use kerf_proto::agones::beta::{Counter, UpdateCounterRequest};
use kerf_proto::agones::sdk_server::{Sdk, SdkServer};
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, create_session_request};
use kerf_server::config::ServerConfig;
use kerf_server::serve::Server;
use tonic::transport::{Channel, Server as Transport};
use tonic::{Request, Response, Status, Streaming};

use super::process::{BLOCK, soon};

/// What was heard, in order, but for beats.
#[derive(Clone, Default)]
struct Sidecar {
    heard: Arc<Mutex<Vec<String>>>,
    beats: Arc<Mutex<Vec<Instant>>>,
}

#[tonic::async_trait]
impl Sdk for Sidecar {
    async fn ready(&self, _: Request<Empty>) -> Result<Response<Empty>, Status> {
        self.heard.lock().unwrap().push("ready".into());
        Ok(Response::new(Empty {}))
    }

    async fn shutdown(&self, _: Request<Empty>) -> Result<Response<Empty>, Status> {
        self.heard.lock().unwrap().push("shutdown".into());
        Ok(Response::new(Empty {}))
    }

    async fn health(&self, request: Request<Streaming<Empty>>) -> Result<Response<Empty>, Status> {
        let mut beats = request.into_inner();
        while beats.message().await?.is_some() {
            self.beats.lock().unwrap().push(Instant::now());
        }
        Ok(Response::new(Empty {}))
    }
}

#[tonic::async_trait]
impl Counters for Sidecar {
    async fn update_counter(&self, request: Request<UpdateCounterRequest>) -> Result<Response<Counter>, Status> {
        let update = request.into_inner().counter_update_request.unwrap();
        let (count, capacity) = (update.count.unwrap(), update.capacity.unwrap());
        if update.name != "sessions" {
            return Err(Status::not_found(format!("counter not found: {}", update.name)));
        }
        self.heard.lock().unwrap().push(format!("{count} of {capacity}"));
        Ok(Response::new(Counter { name: update.name, count, capacity }))
    }
}

impl Sidecar {
    fn serve(&self, address: SocketAddr) {
        let (sdk, counters) = (SdkServer::new(self.clone()), CountersServer::new(self.clone()));
        tokio::spawn(Transport::builder().add_service(sdk).add_service(counters).serve(address));
    }

    /// Waits until this was heard, and nothing else.
    async fn until(&self, expected: &[&str]) {
        let heard = || self.heard.lock().unwrap().clone();
        let waiting = async {
            while heard().len() < expected.len() {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        soon(&format!("{expected:?}"), waiting).await;
        assert_eq!(heard(), expected);
    }
}

fn free() -> SocketAddr {
    std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap()
}

async fn member(sidecar: SocketAddr) -> Server {
    let mut config = ServerConfig { listen: ([127, 0, 0, 1], 0).into(), ..ServerConfig::default() };
    config.agones.endpoint = Some(format!("http://{sidecar}"));
    config.session.max_sessions = 3;
    Server::start(config).await.unwrap()
}

async fn client(server: &Server) -> SessionServiceClient<Channel> {
    SessionServiceClient::connect(format!("http://{}", server.address())).await.unwrap()
}

async fn create(client: &mut SessionServiceClient<Channel>) -> String {
    let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
    let request = v1::CreateSessionRequest { scene, start_paused: true, ..Default::default() };
    client.create_session(request).await.unwrap().into_inner().session.unwrap().session_id
}

/// The allocator of a fleet that has this server, or none with room.
struct Allocator(Option<SocketAddr>);

#[tonic::async_trait]
impl AllocationService for Allocator {
    async fn allocate(&self, request: Request<AllocationRequest>) -> Result<Response<AllocationResponse>, Status> {
        let AllocationRequest { namespace, game_server_selectors, .. } = request.into_inner();
        let states = game_server_selectors.iter().map(|selector| {
            let (labels, counters) = (&selector.match_labels, &selector.counters);
            assert!(labels["agones.dev/fleet"] == "livers" && counters["sessions"].min_available == 1, "{selector:?}");
            selector.game_server_state()
        });
        let states: Vec<_> = states.collect();
        assert_eq!(
            (namespace.as_str(), &states[..]),
            ("kerf", &[GameServerState::Allocated, GameServerState::Ready][..])
        );
        let Some(server) = self.0 else {
            return Err(Status::resource_exhausted("there is no available GameServer to allocate"));
        };
        let ports = vec![GameServerStatusPort { name: "grpc".into(), port: server.port().into() }];
        let (game_server_name, address) = ("livers-1".into(), server.ip().to_string());
        Ok(Response::new(AllocationResponse { game_server_name, ports, address }))
    }
}

async fn allocate(of: Allocator) -> std::process::Output {
    let address = free();
    tokio::spawn(Transport::builder().add_service(AllocationServiceServer::new(of)).serve(address));
    soon("the allocator", async {
        while tokio::net::TcpStream::connect(address).await.is_err() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
    let url = format!("http://{address}");
    let asking = move || {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_kerf-server"));
        command.args(["allocate", &url, "--namespace", "kerf", "--fleet", "livers", "--plain"]).output().unwrap()
    };
    tokio::task::spawn_blocking(asking).await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_asks_the_allocator_for_a_server_and_finds_room_there() {
    let server =
        Server::start(ServerConfig { listen: ([127, 0, 0, 1], 0).into(), ..ServerConfig::default() }).await.unwrap();
    let said = allocate(Allocator(Some(server.address()))).await;
    assert!(said.status.success(), "{said:?}");
    let address = String::from_utf8(said.stdout).unwrap();
    let mut client = SessionServiceClient::connect(address.trim().to_owned()).await.unwrap();
    create(&mut client).await;
    drop(client);
    server.stop().await;
    let refused = allocate(Allocator(None)).await;
    let words = String::from_utf8(refused.stderr).unwrap();
    assert!(
        !refused.status.success() && words.contains("`livers` has no server") && words.contains("no available"),
        "{words}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn the_sidecar_hears_that_the_server_is_ready_lives_has_sessions_and_ends() {
    let (address, sidecar) = (free(), Sidecar::default());
    sidecar.serve(address);
    let server = member(address).await;
    sidecar.until(&["0 of 3", "ready"]).await;
    let mut client = client(&server).await;
    let session_id = create(&mut client).await;
    sidecar.until(&["0 of 3", "ready", "1 of 3"]).await;
    client.close_session(v1::CloseSessionRequest { session_id }).await.unwrap();
    // One that was allocated goes back to the fleet.
    let returned = ["0 of 3", "ready", "1 of 3", "0 of 3", "ready"];
    sidecar.until(&returned).await;
    soon("beats", async {
        while sidecar.beats.lock().unwrap().len() < 3 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
    let beats = sidecar.beats.lock().unwrap().clone();
    assert!(beats.windows(2).all(|pair| pair[1] - pair[0] < Duration::from_secs(5)), "{beats:?}");
    drop(client);
    server.stop().await;
    sidecar.until(&[&returned[..], &["shutdown"]].concat()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_whose_sidecar_comes_late_serves_meanwhile_and_is_told_of_then() {
    let address = free();
    let server = member(address).await;
    let mut client = client(&server).await;
    create(&mut client).await;
    let sidecar = Sidecar::default();
    sidecar.serve(address);
    sidecar.until(&["1 of 3", "ready"]).await;
    drop(client);
    server.stop().await;
}
