//! Spans of late steps: of each session the first few of a second, within the span of the session's life. The thread
//! that steps only puts them into a ring ([`kerf_session::LateStep`]); spans are made here, beside it.

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use kerf_session::clock::MonotonicClock;
use kerf_session::{LateStep, Registry};
use opentelemetry::global::{self, BoxedTracer};
use opentelemetry::trace::{Span, Tracer};
use opentelemetry::{Context, KeyValue};
use tracing_opentelemetry::OpenTelemetrySpanExt;

use super::TRACER;

/// How often late steps are asked for.
const LOOK: Duration = Duration::from_secs(1);

/// Asks for late steps until it is stopped.
pub async fn watch(registry: Arc<Registry>) {
    let tracer = global::tracer(TRACER);
    let mut looks = tokio::time::interval(LOOK);
    loop {
        looks.tick().await;
        let now = (SystemTime::now(), MonotonicClock::now_ns());
        for session in registry.list() {
            let late = session.take_late_steps();
            if late.is_empty() {
                continue;
            }
            let (id, life) = (session.id().to_string(), session.span().context());
            late.iter().for_each(|late| tell(&tracer, &life, &id, late, now));
        }
    }
}

fn tell(tracer: &BoxedTracer, life: &Context, id: &str, late: &LateStep, (now, now_ns): (SystemTime, u64)) {
    let ended = now - Duration::from_nanos(now_ns.saturating_sub(late.ended_ns));
    let attributes = [
        KeyValue::new("session.id", id.to_owned()),
        KeyValue::new("step", i64::try_from(late.step).unwrap_or(i64::MAX)),
        KeyValue::new("lag_ms", late.lag_ns as f64 * 1e-6),
    ];
    let span = tracer.span_builder("late step").with_start_time(ended - Duration::from_nanos(late.elapsed_ns));
    span.with_attributes(attributes).start_with_context(tracer, life).end_with_timestamp(ended);
}
