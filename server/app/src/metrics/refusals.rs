//! How often calls are refused, and why: by what the answer was made of, which no client sees.

use std::collections::BTreeMap;
use std::error::Error;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::Response;
use kerf_session::SessionError;
use tonic::{Code, Status};

use crate::status::{RequestError, in_section};

/// Refused calls, by reason: those that there were yet. All reasons are words of this file, and names of settings.
#[derive(Default)]
pub struct Refusals(Mutex<BTreeMap<&'static str, u64>>);

impl Refusals {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<&'static str, u64>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How many there were of each.
    pub fn counts(&self) -> BTreeMap<&'static str, u64> {
        self.lock().clone()
    }
}

/// Hands on a request, and counts it if it is refused. A stream that ends in an error later is none.
pub async fn count(State(refusals): State<Arc<Refusals>>, request: Request, next: Next) -> Response {
    let response = next.run(request).await;
    if let Some(status) = response.extensions().get::<Status>().filter(|status| status.code() != Code::Ok) {
        *refusals.lock().entry(reason(status)).or_default() += 1;
    }
    response
}

/// The limit by the name that its setting has in its section, or the rule; others are told by their code.
fn reason(status: &Status) -> &'static str {
    let cause = status.source().and_then(|cause| cause.downcast_ref::<RequestError>());
    let limit = cause.and_then(RequestError::setting).map(in_section);
    limit.or_else(|| cause.and_then(rule)).unwrap_or_else(|| code(status.code()))
}

/// The rule that was in the way.
fn rule(error: &RequestError) -> Option<&'static str> {
    use RequestError as Error;
    Some(match error {
        Error::TokenMissing => "token_missing",
        Error::TokenUnknown => "token_unknown",
        Error::Role { .. } => "role",
        Error::NotOwner { .. } => "not_owner",
        Error::OfOneSession { .. } => "token_of_one_session",
        Error::ForeignHost { .. } => "foreign_host",
        Error::ForeignOrigin { .. } => "foreign_origin",
        Error::NoCall { .. } => "no_such_call",
        Error::ProtocolVersion { .. } => "protocol_version",
        Error::OfSession { error, .. } => return rule(error),
        Error::Session(SessionError::ToolTaken { .. }) => "tool_taken",
        Error::Session(SessionError::Failed { .. }) => "session_failed",
        Error::Session(SessionError::Draining { .. }) => "draining",
        _ => return None,
    })
}

fn code(code: Code) -> &'static str {
    match code {
        Code::Ok => "ok",
        Code::Cancelled => "cancelled",
        Code::Unknown => "unknown",
        Code::InvalidArgument => "invalid_argument",
        Code::DeadlineExceeded => "deadline_exceeded",
        Code::NotFound => "not_found",
        Code::AlreadyExists => "already_exists",
        Code::PermissionDenied => "permission_denied",
        Code::ResourceExhausted => "resource_exhausted",
        Code::FailedPrecondition => "failed_precondition",
        Code::Aborted => "aborted",
        Code::OutOfRange => "out_of_range",
        Code::Unimplemented => "unimplemented",
        Code::Internal => "internal",
        Code::Unavailable => "unavailable",
        Code::DataLoss => "data_loss",
        Code::Unauthenticated => "unauthenticated",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_known_by_its_limit_and_else_by_its_code() {
        let of = |error: RequestError| reason(&Status::from(error));
        assert_eq!(of(SessionError::TooManySessions { limit: 8 }.into()), "max_sessions");
        assert_eq!(of(RequestError::from(SessionError::Draining { limit_s: 0.0 }).of_session(3)), "draining");
        assert_eq!(of(RequestError::TokenMissing), "token_missing");
        assert_eq!(of(RequestError::NoScene { name: "a".into(), guess: String::new() }), "not_found");
        assert_eq!(reason(&Status::unimplemented("what it is")), "unimplemented");
    }
}
