//! The services: thin, one file each.

mod checkpoint_files;
mod contact_deadband;
pub mod control_service;
mod control_stream;
mod in_flight;
mod in_parts;
mod interiors;
mod moving;
mod owned;
mod pose_budget;
mod sent_files;
pub mod session_service;
mod unary_drivers;
pub mod view_service;
mod view_stream;
pub mod viewing;

use std::hash::{BuildHasher, RandomState};
use std::pin::Pin;
use std::time::Duration;

use futures_util::Stream;
use kerf_session::{Session, SessionError};
use tonic::Status;

use crate::status::RequestError;

/// What a service answers a stream with: pulled by the transport when it has room, so nothing waits
/// in between.
type Outgoing<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// A name that only the client knows that it is given to: two keyed hashes under fresh keys of the operating system's
/// are not to be guessed.
fn token() -> String {
    format!("{:016x}{:016x}", RandomState::new().hash_one(0), RandomState::new().hash_one(1))
}

fn check_version(field: &'static str, theirs: u32) -> Result<(), RequestError> {
    match theirs == kerf_proto::PROTOCOL_VERSION {
        true => Ok(()),
        false => Err(RequestError::ProtocolVersion { field, theirs }),
    }
}

/// The rate that is granted for a wish: 0 means `default_hz`, and nothing is above `max_hz`.
fn grant_rate_hz(field: &'static str, wish_hz: f64, default_hz: f64, max_hz: f64) -> Result<f64, RequestError> {
    if !wish_hz.is_finite() || wish_hz < 0.0 {
        return Err(RequestError::Rate { field, value: wish_hz });
    }
    // Slower than once in a thousand seconds is never meant.
    Ok(if wish_hz == 0.0 { default_hz } else { wish_hz.max(1e-3) }.min(max_hz))
}

/// What a stream of a session that has left ends in.
fn moved(session: &Session) -> Option<RequestError> {
    let (id, to) = (session.id().to_string(), session.moved_to()?.to_owned());
    Some(SessionError::Moved { id, to }.into())
}

/// The session's answer, unless it takes too long.
async fn in_time<T, E: Into<RequestError>>(
    limit_s: f64,
    answer: impl Future<Output = Result<T, E>>,
) -> Result<T, RequestError> {
    match tokio::time::timeout(Duration::from_secs_f64(limit_s), answer).await {
        Ok(answer) => answer.map_err(Into::into),
        Err(_) => Err(RequestError::Unresponsive { limit_s }),
    }
}
