//! Metrics of the server, as Prometheus reads them, on an address of their own (`metrics_listen`).
//!
//! Who asks makes the work: a scrape reads what sessions and connections have counted in atomics, and none of them
//! learns of it. Labels are bounded: all but `session` come from lists in the program. That one stands on three gauges,
//! of the sessions that there are, private ones not among them, and goes with its session.
//!
//! Deliberately absent: tokens, names of clients, addresses and paths, in labels or elsewhere; counters by session, which
//! would never end.

pub mod endpoint;
mod page;
mod process;
pub mod refusals;
mod server;
mod sessions;

use std::fmt;
use std::sync::Arc;

use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, prometheus_text};
use prometheus_client::registry::Registry as Exposition;

use crate::journal::Journals;
use crate::security::Security;
use crate::traffic::Traffic;
use page::Page;
use refusals::Refusals;

/// What all names of the server's own metrics begin with.
const PREFIX: &str = "kerf";

/// What is told of a server.
#[derive(Clone)]
pub struct Sources {
    /// Its sessions.
    pub registry: Arc<kerf_session::Registry>,
    /// Their journals.
    pub journals: Arc<Journals>,
    /// Its connections.
    pub traffic: Arc<Traffic>,
    /// What it refused.
    pub refusals: Arc<Refusals>,
    /// Its certificate.
    pub security: Arc<Security>,
}

impl fmt::Debug for Sources {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a server")
    }
}

/// The metrics of a server.
pub struct Metrics(Exposition);

impl Metrics {
    /// Of this server.
    #[must_use]
    pub fn new(sources: Sources) -> Self {
        let mut exposition = Exposition::default();
        exposition.register_collector(Box::new(Part(process::write)));
        let own = exposition.sub_registry_with_prefix(PREFIX);
        let of_sessions = Arc::clone(&sources.registry);
        own.register_collector(Box::new(Part(move |page: &mut Page<'_>| sessions::write(page, &of_sessions))));
        own.register_collector(Box::new(Part(move |page: &mut Page<'_>| server::write(page, &sources))));
        Self(exposition)
    }

    /// As Prometheus reads them.
    ///
    /// # Errors
    /// None that is known: text grows.
    pub fn text(&self) -> Result<String, fmt::Error> {
        let mut text = String::new();
        prometheus_text::encode(&mut text, &self.0)?;
        Ok(text)
    }
}

/// What writes some of the metrics.
struct Part<W>(W);

impl<W> fmt::Debug for Part<W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("some metrics")
    }
}

impl<W: Fn(&mut Page<'_>) -> fmt::Result + Send + Sync + 'static> Collector for Part<W> {
    fn encode(&self, encoder: DescriptorEncoder<'_>) -> fmt::Result {
        (self.0)(&mut Page(encoder))
    }
}
