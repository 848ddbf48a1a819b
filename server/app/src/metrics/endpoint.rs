//! Where metrics are read. The same door stands before them as before all else: where the server asks for tokens, a
//! viewer's lets Prometheus in, and where it speaks TLS, it does here too.

use std::net::SocketAddr;
use std::sync::Arc;

use anyhow::{Context, Result};
use axum::Router;
use axum::body::Body;
use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderValue, Response, StatusCode};
use axum::middleware::from_fn_with_state;
use axum::routing::get;
use prometheus_client::encoding::prometheus_text;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tonic::service::Routes;
use tonic::transport::Server as Transport;

use super::Metrics;
use crate::config::TransportLimits;
use crate::incoming;
use crate::security::roles::METRICS_PATH;
use crate::security::{Security, door};

/// Metrics that are served; they end with this.
pub struct Endpoint {
    address: SocketAddr,
    serving: JoinHandle<()>,
}

impl Endpoint {
    /// Listens and serves on the current runtime.
    ///
    /// # Errors
    /// The address is taken.
    pub async fn start(
        listen: SocketAddr,
        metrics: Metrics,
        security: &Security,
        (transport, limits): (Transport, &TransportLimits),
    ) -> Result<Self> {
        let listener = TcpListener::bind(listen).await.with_context(|| format!("metrics_listen = {listen}"))?;
        let address = listener.local_addr()?;
        let metrics = Arc::new(metrics);
        let router = Router::new()
            .route(METRICS_PATH, get(move || async move { answer(&metrics) }))
            .layer(from_fn_with_state(security.door(address), door::judge));
        let (connections, _cut) = incoming::connections(listener, limits, security.tls(), Arc::default());
        let serving = tokio::spawn(async move {
            let mut transport = transport;
            if let Err(error) = transport.add_routes(Routes::from(router)).serve_with_incoming(connections).await {
                tracing::error!(%error, "metrics are served no more");
            }
        });
        tracing::info!(%address, "metrics are read here");
        Ok(Self { address, serving })
    }

    /// The address it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Endpoint {
    fn drop(&mut self) {
        self.serving.abort();
    }
}

fn answer(metrics: &Metrics) -> Response<Body> {
    let Ok(text) = metrics.text() else {
        let mut failed = Response::new(Body::empty());
        *failed.status_mut() = StatusCode::INTERNAL_SERVER_ERROR;
        return failed;
    };
    let mut answer = Response::new(Body::from(text));
    answer.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(prometheus_text::CONTENT_TYPE));
    answer
}
