//! Spans on their way out: whether the collector takes them is said once when it changes, and not for every batch.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use opentelemetry_sdk::Resource;
use opentelemetry_sdk::error::OTelSdkResult;
use opentelemetry_sdk::trace::{SpanData, SpanExporter};

/// An exporter whose failures are told.
#[derive(Debug)]
pub struct Watched<E> {
    exporter: E,
    endpoint: String,
    /// The last batch was lost.
    is_lost: AtomicBool,
}

impl<E> Watched<E> {
    /// To the collector there.
    pub fn new(exporter: E, endpoint: String) -> Self {
        Self { exporter, endpoint, is_lost: AtomicBool::new(false) }
    }
}

impl<E: SpanExporter> SpanExporter for Watched<E> {
    async fn export(&self, batch: Vec<SpanData>) -> OTelSdkResult {
        let result = self.exporter.export(batch).await;
        let endpoint = &self.endpoint;
        match (&result, self.is_lost.swap(result.is_err(), Ordering::Relaxed)) {
            (Err(error), false) => {
                tracing::warn!(endpoint, %error, "no collector takes traces: they are lost until one does");
            }
            (Ok(()), true) => tracing::info!(endpoint, "the collector takes traces again"),
            (Err(_), true) | (Ok(()), false) => {}
        }
        result
    }

    fn shutdown_with_timeout(&self, timeout: Duration) -> OTelSdkResult {
        self.exporter.shutdown_with_timeout(timeout)
    }

    fn force_flush(&self) -> OTelSdkResult {
        self.exporter.force_flush()
    }

    fn set_resource(&mut self, resource: &Resource) {
        self.exporter.set_resource(resource);
    }
}
