//! Traces: a span of each request, one of each session's life, and some of late steps, for a collector that takes OTLP
//! over gRPC. They wait in a queue that has an end, and are sent by a thread and a runtime of their own, so that a
//! collector that is slow or absent costs spans and nothing else.
//!
//! Deliberately absent: spans within a step, which would cost it more than it may take; names of clients, their tokens
//! and addresses.

mod exporter;
pub mod late_steps;
pub mod requests;

use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use kerf_access::Access;
use kerf_session::TRACES;
use opentelemetry::trace::TracerProvider;
use opentelemetry::{KeyValue, global};
use opentelemetry_otlp::{SpanExporter, WithExportConfig, WithTonicConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::{BatchConfigBuilder, BatchSpanProcessor, SdkTracerProvider};
use tokio::runtime::{Builder, Runtime};
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::{Layer, Registry};

use crate::config::TracesConfig;
use exporter::Watched;

/// Who traces, by name.
const TRACER: &str = "kerf-server";
/// Spans that wait to be sent: what a busy server makes in some ten seconds. Later ones are lost while it is full.
const MAX_WAITING: usize = 2048;
/// How often they are sent.
const INTERVAL: Duration = Duration::from_secs(1);
/// Most time that a collector has for an answer, retries included.
const PATIENCE: Duration = Duration::from_secs(5);
/// Most time that the last spans get at the end.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// Traces that are sent while this lives; its end sends what waits.
pub struct Traces {
    provider: SdkTracerProvider,
    runtime: Option<Runtime>,
}

impl Traces {
    /// Sends spans from now on, where the configuration says where to; whether a collector is there it finds out as it goes.
    ///
    /// # Errors
    /// The certificates cannot be read, or the system gives no thread.
    pub fn begin(config: &TracesConfig) -> Result<Option<Self>> {
        let Some(endpoint) = &config.endpoint else { return Ok(None) };
        let runtime = Builder::new_multi_thread().worker_threads(1).thread_name("kerf-traces").enable_all().build();
        let runtime = runtime.context("no thread for traces")?;
        let access = Access { ca_file: config.ca_file.clone(), token_file: None };
        let channel = {
            let _within = runtime.enter();
            let channel = access.endpoint(endpoint).with_context(|| format!("traces.endpoint = {endpoint:?}"))?;
            channel.connect_timeout(PATIENCE).timeout(PATIENCE).connect_lazy()
        };
        let exporter = SpanExporter::builder().with_tonic().with_channel(channel).with_timeout(PATIENCE).build();
        let exporter = Watched::new(exporter.map_err(|error| anyhow!("traces: {error}"))?, endpoint.clone());
        let batches = BatchConfigBuilder::default().with_max_queue_size(MAX_WAITING).with_scheduled_delay(INTERVAL);
        let batches = BatchSpanProcessor::builder(exporter).with_batch_config(batches.build()).build();
        let version = KeyValue::new("service.version", crate::VERSION);
        let resource = Resource::builder().with_service_name(TRACER).with_attribute(version).build();
        let provider = SdkTracerProvider::builder().with_span_processor(batches).with_resource(resource).build();
        global::set_tracer_provider(provider.clone());
        Ok(Some(Self { provider, runtime: Some(runtime) }))
    }

    /// What makes spans of this program's into spans that are sent: those that are meant to be, and no library's.
    pub fn layer(&self) -> Box<dyn Layer<Registry> + Send + Sync> {
        let layer = tracing_opentelemetry::layer().with_tracer(self.provider.tracer(TRACER));
        let layer = layer.with_location(false).with_threads(false).with_tracked_inactivity(false);
        Box::new(layer.with_filter(filter_fn(|metadata| metadata.target() == TRACES && metadata.is_span())))
    }
}

impl Drop for Traces {
    fn drop(&mut self) {
        // A collector that does not take the last spans has been warned of.
        let _ = self.provider.shutdown_with_timeout(LAST_WORDS);
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
