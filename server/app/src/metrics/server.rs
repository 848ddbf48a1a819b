//! What the server itself does: connections, refusals, journals, its certificate and build.

use std::fmt;

use kerf_session::clock::MonotonicClock;
use prometheus_client::registry::Unit::{Bytes, Seconds};

use super::Sources;
use super::page::Page;
use crate::status::in_section;
use crate::traffic::Full;
use crate::{VERSION, machine};

pub fn write(page: &mut Page<'_>, sources: &Sources) -> fmt::Result {
    network(page, sources)?;
    journals(page, sources)?;
    let memory_bytes = machine::memory_mib() * 1048576.0;
    let help = "Memory that the process may take: the machine's, its control groups', or its own limit.";
    page.gauge(("memory_limit", Some(Bytes), help), memory_bytes)?;
    let help = "When the certificate stops being good, seconds since 1970; no series without TLS.";
    let expires_s = sources.security.certificate_expires_s();
    page.gauge_if(("certificate_expiry_timestamp", Some(Seconds), help), expires_s)?;
    let protocol = kerf_proto::PROTOCOL_VERSION.to_string();
    let labels = [("version", VERSION), ("protocol_version", protocol.as_str())];
    page.info(("build_info", None, "The program, by its labels; always 1."), &labels)
}

fn network(page: &mut Page<'_>, sources: &Sources) -> fmt::Result {
    let traffic = &sources.traffic;
    page.gauge(("connections", None, "Connections that are open."), traffic.open())?;
    let help = "Connections that were closed as they came, by the limit of which as many were open.";
    let refused = Full::ALL.map(|full| (in_section(full.setting()), traffic.refused(full)));
    page.counters(("refused_connections", None, help), "reason", refused)?;
    page.counter(("sent", Some(Bytes), "Sent to clients, without TLS's own."), traffic.sent_bytes.get())?;
    page.counter(("received", Some(Bytes), "Received of clients, without TLS's own."), traffic.received_bytes.get())?;
    let help = "Calls that were refused, by the limit or the rule that was in the way, else by gRPC's code.";
    let refused = sources.refusals.counts();
    page.counters(("refused_requests", None, help), "reason", refused)
}

fn journals(page: &mut Page<'_>, sources: &Sources) -> fmt::Result {
    let health = sources.journals.health();
    let lag = health.lag(MonotonicClock::now_ns());
    page.gauge(("journals", None, "Journals that are written."), lag.journals)?;
    let help = "What was written to journals, and the disk has yet to confirm.";
    page.gauge(("journal_unsynced", Some(Bytes), help), lag.unsynced_bytes)?;
    let help = "How long the oldest record that the disk has yet to confirm has waited: what a power cut would lose.";
    page.gauge(("journal_lag", Some(Seconds), help), lag.oldest_s)?;
    let help = "Sessions of the server before that are not back yet.";
    page.gauge(("sessions_expected", None, help), sources.registry.expected())?;
    let help = "Journals that could not be begun, that ended before their session, or that brought no session back.";
    let kinds = [
        ("not_begun", &health.not_begun),
        ("broken_off", &health.broken_off),
        ("not_brought_back", &health.not_brought_back),
    ];
    page.counters(("journal_errors", None, help), "kind", kinds.map(|(kind, count)| (kind, count.get())))
}
