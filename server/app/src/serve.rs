//! `kerf-server serve`.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use kerf_proto::v1::control_service_server::{ControlServiceServer, SERVICE_NAME as CONTROL_SERVICE};
use kerf_proto::v1::session_service_server::{SERVICE_NAME as SESSION_SERVICE, SessionServiceServer};
use kerf_proto::v1::view_service_server::{SERVICE_NAME as VIEW_SERVICE, ViewServiceServer};
use kerf_scenes::dial::ParetoFronts;
use kerf_session::Registry;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tonic::service::{LayerExt, Routes};
use tonic::transport::Server as Transport;
use tonic_health::ServingStatus;
use tonic_health::server::{HealthReporter, health_reporter};
use tonic_web::GrpcWebLayer;

use crate::config::{ConfigArgs, ServerConfig, TransportLimits};
use crate::grpc::control_service::ControlService;
use crate::grpc::session_service::SessionService;
use crate::grpc::view_service::ViewService;
use crate::{incoming, print_config, recording, shutdown, telemetry, viewer};

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

/// Serves until SIGTERM or SIGINT, then ends sessions and streams.
///
/// # Errors
/// The configuration is not valid, the address is taken, or the transport failed.
pub fn run(args: ServeArgs) -> Result<()> {
    let config = ServerConfig::load(&args.config)?;
    if args.print_config {
        print!("{}", print_config::text(&config)?);
        return Ok(());
    }
    telemetry::init(&config.log)?;
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    runtime.worker_threads(config.network_threads).thread_name("kerf-network").enable_all();
    runtime.build().context("runtime")?.block_on(async {
        let mut server = Server::start(config).await?;
        tokio::select! {
            requested = shutdown::requested() => requested?,
            ended = server.ended() => ended.context("the transport ended by itself")?,
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
    drain_timeout: Duration,
    record_dir: Option<PathBuf>,
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
    /// The configuration is not valid or the address is taken.
    pub async fn start(config: ServerConfig) -> Result<Self> {
        config.validate()?;
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
        let (health, routes) = routes(&registry, &config).await?;
        let (stop, stopped) = oneshot::channel::<()>();
        let connections = incoming::connections(listener, config.transport.max_connections);
        let serving = builder(&config.transport)
            .add_routes(routes)
            .serve_with_incoming_shutdown(connections, async { drop(stopped.await) });
        tracing::info!(%address, "listening");
        let drain_timeout = Duration::from_secs_f64(config.transport.drain_timeout_s);
        let record_dir = config.record_dir.clone();
        let transport = tokio::spawn(serving);
        Ok(Self { address, registry, health, drain_timeout, record_dir, stop, transport })
    }

    /// The address it listens on.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
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

    /// Accepts nothing new, ends all sessions and with them their streams, and waits for clients to
    /// take what they were sent, for as long as the limit says.
    pub async fn stop(mut self) -> Drained {
        for service in ["", SESSION_SERVICE, CONTROL_SERVICE, VIEW_SERVICE] {
            self.health.set_service_status(service, ServingStatus::NotServing).await;
        }
        self.registry.refuse_new();
        // The transport is told by the sender's end as well; either way it accepts no more.
        drop(self.stop);
        let drain = async {
            if let Some(folder) = &self.record_dir {
                for session in self.registry.list() {
                    recording::save(folder, &session).await;
                }
            }
            self.registry.close_all().await;
            (&mut self.transport).await
        };
        let drained = match tokio::time::timeout(self.drain_timeout, drain).await {
            Ok(_) => Drained::Cleanly,
            Err(_) => {
                self.transport.abort();
                Drained::Forcibly
            }
        };
        tracing::info!(?drained, "stopped");
        drained
    }
}

fn builder(limits: &TransportLimits) -> Transport {
    Transport::builder()
        .accept_http1(true)
        .max_concurrent_streams(limits.max_streams_per_connection)
        .http2_keepalive_interval(Some(Duration::from_secs_f64(limits.keepalive_interval_s)))
        .http2_keepalive_timeout(Some(Duration::from_secs_f64(limits.keepalive_timeout_s)))
}

async fn routes(registry: &Arc<Registry>, config: &Arc<ServerConfig>) -> Result<(HealthReporter, Routes)> {
    let limits = &config.transport;
    let session = SessionServiceServer::new(SessionService::new(Arc::clone(registry), Arc::clone(config)))
        .max_decoding_message_size(limits.max_incoming_bytes)
        .max_encoding_message_size(limits.max_outgoing_bytes);
    let control = ControlServiceServer::new(ControlService::new(Arc::clone(registry), config.control.clone()))
        .max_decoding_message_size(limits.max_incoming_bytes)
        .max_encoding_message_size(limits.max_outgoing_bytes);
    let view = ViewServiceServer::new(ViewService::new(Arc::clone(registry)))
        .max_decoding_message_size(limits.max_incoming_bytes)
        .max_encoding_message_size(limits.max_outgoing_bytes);
    let (health, health_service) = health_reporter();
    for service in [SESSION_SERVICE, CONTROL_SERVICE, VIEW_SERVICE] {
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
    Ok((health, viewer::routes(routes.into_axum_router()).into()))
}
