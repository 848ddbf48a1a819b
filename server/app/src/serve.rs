//! `kerf-server serve`.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use axum::middleware::{from_fn, from_fn_with_state};
use kerf_proto::v1::control_service_server::{ControlServiceServer, SERVICE_NAME as CONTROL_SERVICE};
use kerf_proto::v1::session_service_server::{SERVICE_NAME as SESSION_SERVICE, SessionServiceServer};
use kerf_proto::v1::view_service_server::{SERVICE_NAME as VIEW_SERVICE, ViewServiceServer};
use kerf_scenes::dial::ParetoFronts;
use kerf_session::Registry;
use kerf_session::clock::MonotonicClock;
use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tonic::service::{LayerExt, Routes};
use tonic::transport::Server as Transport;
use tonic_health::ServingStatus;
use tonic_health::server::{HealthReporter, health_reporter};
use tonic_web::GrpcWebLayer;

use crate::agones::Membership;
use crate::config::{ConfigArgs, ServerConfig, TransportLimits};
use crate::grpc::control_service::ControlService;
use crate::grpc::session_service::SessionService;
use crate::grpc::view_service::ViewService;
use crate::grpc::viewing::Viewing;
use crate::journal::Journals;
use crate::large_messages::LargeMessages;
use crate::metrics::endpoint::Endpoint;
use crate::metrics::refusals::{self, Refusals};
use crate::metrics::{Metrics, Sources};
use crate::recording::Recordings;
use crate::security::Security;
use crate::security::door::{self, Door};
use crate::shutdown::Stops;
use crate::traces::{late_steps, requests};
use crate::traffic::Traffic;
use crate::watchdog::{self, SESSIONS};
use crate::{incoming, large_messages, machine, print_config, security, telemetry, viewer};

/// Share of the machine's memory that sessions take unless it is set.
const MEMORY_SHARE: f64 = 0.5;
/// Calls of a connection that were cancelled before the server came to look at them; with one more it ends, and all its
/// streams. Each takes some hundred bytes. The library's 20 are fewer than a busy client cancels at once.
const MAX_CANCELLED_CALLS: usize = 1024;
/// How often a server that drains looks whether it has sessions.
const DRAIN_LOOK: Duration = Duration::from_millis(100);
/// How often sessions are looked for that nobody has to do with.
const IDLE_LOOK: Duration = Duration::from_secs(5);

/// Arguments of `serve`.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ServeArgs {
    /// Where the configuration comes from.
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Prints every setting with its value and what it is for, as a file for --config, and ends.
    #[arg(long)]
    pub print_config: bool,
}

/// Serves until SIGTERM or SIGINT, lets sessions end for as long as the limit says, then ends them and their streams. A second
/// signal ends them at once.
///
/// # Errors
/// The configuration is not valid, the address is taken, or the transport failed.
pub fn run(args: ServeArgs) -> Result<()> {
    let config = ServerConfig::load(&args.config)?;
    if args.print_config {
        print!("{}", print_config::text(&config)?);
        return Ok(());
    }
    let _telemetry = telemetry::init(&config)?;
    serve_until_told(config, async |_: &Server| Ok(()))
}

/// Starts a server, does what is to be done first, and serves until SIGTERM or SIGINT.
pub(crate) fn serve_until_told(config: ServerConfig, first: impl AsyncFnOnce(&Server) -> Result<()>) -> Result<()> {
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    runtime.worker_threads(config.network_threads).thread_name("kerf-network").enable_all();
    runtime.build().context("runtime")?.block_on(async {
        // A file beyond `ulimit -f` is a full disk to whom it is written by, and no end of the process.
        let _ = signal(SignalKind::from_raw(libc::SIGXFSZ)).context("SIGXFSZ")?;
        // Before anybody knows of the server: from then on a signal ends its sessions as it should.
        let mut stops = Stops::listen()?;
        let mut server = Server::start(config).await?;
        let serve = async {
            first(&server).await?;
            server.ended().await.context("the transport ended by itself")
        };
        tokio::select! {
            () = stops.next() => {}
            ended = serve => ended?,
        }
        tokio::select! {
            () = stops.next() => {}
            () = server.drain() => {}
        }
        server.stop().await;
        Ok(())
    })
}

/// A server that runs.
pub struct Server {
    address: SocketAddr,
    registry: Arc<Registry>,
    health: HealthReporter,
    config: Arc<ServerConfig>,
    recordings: Arc<Recordings>,
    journals: Arc<Journals>,
    /// What brings sessions back that the server before it had.
    coming_back: JoinHandle<()>,
    /// What looks after sessions.
    keepers: Vec<JoinHandle<()>>,
    /// `None`: it is of no fleet.
    fleet: Option<Membership>,
    metrics: Option<Endpoint>,
    cut: incoming::Cut,
    stop: oneshot::Sender<()>,
    transport: JoinHandle<Result<(), tonic::transport::Error>>,
}

/// How a server came to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drained {
    /// Every stream had ended.
    Cleanly,
    /// Some client still held a stream when the time was up; it was cut off.
    Forcibly,
}

impl Server {
    /// Listens and serves on the current runtime.
    ///
    /// # Errors
    /// The configuration is not valid, others can reach the server and nothing keeps them out, or the address is taken.
    pub async fn start(mut config: ServerConfig) -> Result<Self> {
        config.validate()?;
        security::check(&config)?;
        config.session.max_memory_mib.get_or_insert_with(|| MEMORY_SHARE * machine::memory_mib());
        config.session.max_load.get_or_insert_with(machine::cores_for_steps);
        if let Some(folder) = &config.record_dir {
            std::fs::create_dir_all(folder).with_context(|| format!("record_dir = {}", folder.display()))?;
        }
        let config = Arc::new(config);
        let pareto_fronts = match &config.pareto_dir {
            Some(folder) => ParetoFronts::builtin().with_folder(folder).context("pareto_dir")?,
            None => ParetoFronts::builtin(),
        };
        let registry = Arc::new(Registry::new(config.session.clone(), pareto_fronts)?);
        let listener = TcpListener::bind(config.listen).await.with_context(|| format!("listen = {}", config.listen))?;
        let address = listener.local_addr()?;
        let security = Arc::new(Security::begin(&config, address)?);
        let recordings = Arc::new(Recordings::new(&config));
        let journals = Arc::new(Journals::new(&config)?);
        let left = journals.left()?;
        registry.expect(left.ids());
        let (traffic, refusals) = (Arc::<Traffic>::default(), Arc::<Refusals>::default());
        let watched = Sources {
            registry: Arc::clone(&registry),
            journals: Arc::clone(&journals),
            traffic: Arc::clone(&traffic),
            refusals: Arc::clone(&refusals),
            security: Arc::clone(&security),
        };
        let metrics = metrics(&config, watched).await?;
        let doors = (Arc::clone(&security), security.door(address), refusals);
        let viewing = Viewing::begin().context("threads for viewers")?;
        let (health, routes) = routes(&registry, &config, (&recordings, &journals), doors, viewing).await?;
        let (stop, stopped) = oneshot::channel::<()>();
        let (connections, cut) = incoming::connections(listener, &config.transport, security.tls(), traffic);
        let serving = builder(&config.transport)
            .add_routes(routes)
            .serve_with_incoming_shutdown(connections, async { drop(stopped.await) });
        tracing::info!(%address, "listening");
        let transport = tokio::spawn(serving);
        let coming_back = {
            let (registry, recordings, journals) =
                (Arc::clone(&registry), Arc::clone(&recordings), Arc::clone(&journals));
            // Those that are back are there for their clients while others are still being built.
            tokio::spawn(async move { journals.bring_back(left, &registry, &recordings).await })
        };
        let records = (Arc::clone(&recordings), Arc::clone(&journals));
        let idle = tokio::spawn(close_idle(Arc::clone(&registry), Arc::clone(&config), records));
        let mut keepers = vec![idle, tokio::spawn(watchdog::watch(Arc::clone(&registry), health.clone()))];
        if config.traces.endpoint.is_some() {
            keepers.push(tokio::spawn(late_steps::watch(Arc::clone(&registry))));
        }
        let fleet = Membership::begin(&config, &registry);
        Ok(Self {
            address,
            registry,
            health,
            config,
            recordings,
            journals,
            coming_back,
            keepers,
            fleet,
            metrics,
            cut,
            stop,
            transport,
        })
    }

    /// The address it listens on.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The address where metrics are read, if they are.
    #[must_use]
    pub fn metrics_address(&self) -> Option<SocketAddr> {
        self.metrics.as_ref().map(Endpoint::address)
    }

    /// Where a browser finds it.
    #[must_use]
    pub fn url(&self) -> String {
        security::url(&self.config, self.address)
    }

    /// Its sessions.
    #[must_use]
    pub fn registry(&self) -> &Arc<Registry> {
        &self.registry
    }

    /// Returns when the transport ends, which it does not do before it is told to.
    async fn ended(&mut self) -> Result<()> {
        (&mut self.transport).await??;
        Ok(())
    }

    /// Takes no new sessions and waits until those that there are have ended, for as long as the limit says.
    pub async fn drain(&self) {
        let limit_s = self.config.session.drain_s;
        if limit_s == 0.0 {
            return;
        }
        self.take_no_more().await;
        let sessions = || self.registry.list().len();
        tracing::info!(
            sessions = sessions(),
            limit_s,
            "draining: no session begins, and those that run have so long to end"
        );
        // The journal of one that was closed is removed only after it, and would stay if the server stopped before.
        let journals = || self.journals.health().lag(MonotonicClock::now_ns()).journals;
        let ended = async {
            while sessions() > 0 || journals() > 0 {
                tokio::time::sleep(DRAIN_LOOK).await;
            }
        };
        if tokio::time::timeout(Duration::from_secs_f64(limit_s), ended).await.is_err() {
            tracing::warn!(sessions = sessions(), limit_s, "sessions still run when session.drain_s is over");
        }
    }

    /// Begins no more sessions, and says so to health checks.
    async fn take_no_more(&self) {
        // What is not back yet the next server brings back.
        self.coming_back.abort();
        for service in ["", SESSION_SERVICE, CONTROL_SERVICE, VIEW_SERVICE] {
            self.health.set_service_status(service, ServingStatus::NotServing).await;
        }
        self.registry.refuse_new();
    }

    /// Accepts nothing new, ends all sessions and with them their streams, and waits for clients to
    /// take what they were sent, for as long as the limit says. Where sessions have journals connections are cut first.
    pub async fn stop(mut self) -> Drained {
        self.keepers.iter().for_each(JoinHandle::abort);
        self.take_no_more().await;
        self.health.set_service_status(SESSIONS, ServingStatus::NotServing).await;
        self.journals.stop();
        // The transport is told by the sender's end as well; either way it accepts no more.
        drop(self.stop);
        let drain = async {
            if self.journals.is_on() && !self.registry.list().is_empty() {
                // Sessions that come back do not end for their clients.
                self.cut.all().await;
            }
            self.registry.close_all().await;
            self.recordings.finish_all().await;
            self.journals.finish_all().await;
            (&mut self.transport).await
        };
        let drain_timeout = Duration::from_secs_f64(self.config.transport.drain_timeout_s);
        let drained = match tokio::time::timeout(drain_timeout, drain).await {
            Ok(_) => Drained::Cleanly,
            Err(_) => {
                self.transport.abort();
                Drained::Forcibly
            }
        };
        if let Some(fleet) = self.fleet {
            fleet.end().await;
        }
        tracing::info!(?drained, "stopped");
        drained
    }
}

/// Serves metrics where they are to be read.
async fn metrics(config: &ServerConfig, watched: Sources) -> Result<Option<Endpoint>> {
    let Some(listen) = config.metrics_listen else { return Ok(None) };
    let security = Arc::clone(&watched.security);
    let transport = (builder(&config.transport), &config.transport);
    Endpoint::start(listen, Metrics::new(watched), &security, transport).await.map(Some)
}

/// Closes sessions that nobody has had to do with for as long as the limit says.
async fn close_idle(
    registry: Arc<Registry>,
    config: Arc<ServerConfig>,
    (recordings, journals): (Arc<Recordings>, Arc<Journals>),
) {
    let mut looks = tokio::time::interval(IDLE_LOOK.min(Duration::from_secs_f64(config.session.idle_timeout_s)));
    loop {
        looks.tick().await;
        for session in registry.idle() {
            let id = session.id().to_string();
            tracing::info!(session = id, "nobody has had to do with the session; it is closed");
            let _ = registry.close(&id).await;
            recordings.finish(session.id()).await;
            journals.finish(session.id()).await;
        }
    }
}

pub(crate) fn builder(limits: &TransportLimits) -> Transport {
    Transport::builder()
        // To be answered and, as long again, to be read: an upload may not trickle in for ever.
        .timeout(Duration::from_secs_f64(2.0 * limits.request_timeout_s))
        .accept_http1(true)
        .max_concurrent_streams(limits.max_streams_per_connection)
        .http2_max_pending_accept_reset_streams(Some(MAX_CANCELLED_CALLS))
        .http2_keepalive_interval(Some(Duration::from_secs_f64(limits.keepalive_interval_s)))
        .http2_keepalive_timeout(Some(Duration::from_secs_f64(limits.keepalive_timeout_s)))
}

/// What is served.
pub(crate) async fn routes(
    registry: &Arc<Registry>,
    config: &Arc<ServerConfig>,
    (recordings, journals): (&Arc<Recordings>, &Arc<Journals>),
    (security, door, refusals): (Arc<Security>, Arc<Door>, Arc<Refusals>),
    viewing: Viewing,
) -> Result<(HealthReporter, Routes)> {
    let limits = &config.transport;
    let session = SessionServiceServer::new(SessionService::new(
        Arc::clone(registry),
        Arc::clone(config),
        (Arc::clone(recordings), Arc::clone(journals)),
        Arc::clone(&security.guests),
    ))
    .max_decoding_message_size(limits.max_request_bytes)
    .max_encoding_message_size(limits.max_outgoing_bytes);
    let control = ControlServiceServer::new(ControlService::new(Arc::clone(registry), config.control.clone()))
        .max_decoding_message_size(limits.max_incoming_bytes)
        .max_encoding_message_size(limits.max_outgoing_bytes);
    let view = ViewService::new(Arc::clone(registry), viewing, config.view.clone(), limits.request_timeout_s);
    let view = ViewServiceServer::new(view)
        .max_decoding_message_size(limits.max_incoming_bytes)
        .max_encoding_message_size(limits.max_outgoing_bytes);
    let (health, health_service) = health_reporter();
    for service in [SESSION_SERVICE, CONTROL_SERVICE, VIEW_SERVICE, SESSIONS] {
        health.set_service_status(service, ServingStatus::Serving).await;
    }
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(kerf_proto::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    // Browsers speak gRPC-Web. A layer for each service: over all routes it would refuse the viewer's own pages.
    let web = GrpcWebLayer::new();
    let routes = Routes::new(web.named_layer(session))
        .add_service(web.named_layer(control))
        .add_service(web.named_layer(view))
        .add_service(health_service)
        .add_service(reflection().build_v1()?)
        .add_service(reflection().build_v1alpha()?);
    let routes = viewer::routes(routes.into_axum_router())
        .layer(from_fn_with_state(LargeMessages::new(limits.clone()), large_messages::read_whole))
        .layer(from_fn_with_state(door, door::judge));
    // Before the door, for two reasons: a preflight comes without the token that the call will have, and a page may read
    // why it was refused.
    let routes = match security.cors() {
        Some(cors) => routes.layer(cors),
        None => routes,
    };
    let routes = routes.layer(from_fn_with_state(refusals, refusals::count));
    let routes = match config.traces.endpoint {
        Some(_) => routes.layer(from_fn(requests::trace)),
        None => routes,
    };
    Ok((health, routes.into()))
}
