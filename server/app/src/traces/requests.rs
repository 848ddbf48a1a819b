//! Spans of requests, from their head to the end of their answer: for a stream as long as it goes on. They go on from the
//! span that a client says (W3C's `traceparent`), where it says one.

use std::pin::Pin;
use std::task::{Context, Poll, ready};

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::Request;
use axum::http::HeaderMap;
use axum::middleware::Next;
use axum::response::Response;
use http_body::{Frame, SizeHint};
use kerf_session::TRACES;
use opentelemetry::propagation::{Extractor, TextMapPropagator};
use opentelemetry_sdk::propagation::TraceContextPropagator;
use tonic::{Code, Status};
use tracing::field::Empty;
use tracing::{Instrument, Span};
use tracing_opentelemetry::OpenTelemetrySpanExt;

use crate::security::roles::CALLS;

/// What a client calls many times a second, whose spans would tell nothing and crowd out the others.
const TOO_MANY: [&str; 2] = ["/kerf.v1.ControlService/SendPose", "/kerf.v1.ViewService/Acknowledge"];

/// Hands on a request within a span, if it is a call that has one.
pub async fn trace(request: Request, next: Next) -> Response {
    let Some(span) = span_of(&request) else { return next.run(request).await };
    let response = next.run(request).instrument(span.clone()).await;
    if let Some(status) = Status::from_header_map(response.headers()) {
        note(&span, &status);
    } else if let Some(status) = response.extensions().get::<Status>() {
        note(&span, status);
    }
    response.map(|body| Body::new(Traced { body, span }))
}

/// The span of a call of one of this program's services. Of names that clients make up, and of health checks, there are none.
fn span_of(request: &Request) -> Option<Span> {
    let asked = request.uri().path();
    if TOO_MANY.contains(&asked) {
        return None;
    }
    let (path, _) = CALLS.iter().find(|(path, _)| *path == asked && path.starts_with("/kerf."))?;
    let (service, method) = path.trim_start_matches('/').split_once('/')?;
    let span = tracing::info_span!(
        target: TRACES,
        parent: None,
        "request",
        otel.name = format!("{service}/{method}"),
        otel.kind = "server",
        otel.status_code = Empty,
        otel.status_description = Empty,
        rpc.system = "grpc",
        rpc.service = service,
        rpc.method = method,
        rpc.grpc.status_code = Empty,
        session.id = Empty,
        scene.name = Empty,
    );
    if span.is_disabled() {
        return None;
    }
    let said = TraceContextPropagator::new().extract(&Headers(request.headers()));
    // A span that the layer does not know cannot go on from another.
    let _ = span.set_parent(said);
    Some(span)
}

/// Notes how a call ended. By OpenTelemetry's conventions what is a client's own fault is no error of a server.
fn note(span: &Span, status: &Status) {
    span.record("rpc.grpc.status_code", status.code() as i32);
    let is_fault = matches!(
        status.code(),
        Code::Unknown
            | Code::DeadlineExceeded
            | Code::Unimplemented
            | Code::Internal
            | Code::Unavailable
            | Code::DataLoss
    );
    if is_fault {
        span.record("otel.status_code", "ERROR").record("otel.status_description", status.message());
    }
}

struct Headers<'a>(&'a HeaderMap);

impl Extractor for Headers<'_> {
    fn get(&self, key: &str) -> Option<&str> {
        self.0.get(key).and_then(|value| value.to_str().ok())
    }

    fn keys(&self) -> Vec<&str> {
        self.0.keys().map(|name| name.as_str()).collect()
    }
}

/// The body of an answer, whose end is that of its span.
struct Traced {
    body: Body,
    span: Span,
}

impl HttpBody for Traced {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = ready!(Pin::new(&mut self.body).poll_frame(context));
        let trailers = frame.as_ref().and_then(|frame| frame.as_ref().ok()?.trailers_ref());
        if let Some(status) = trailers.and_then(Status::from_header_map) {
            note(&self.span, &status);
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
