//! Messages about sessions are read whole before anybody answers them, so that one that never ends holds up nobody. Small
//! ones cost what their stream costs; for large ones there are so many places, which a message that is read gives up
//! when another needs it.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use axum::middleware::Next;
use axum::response::Response;
use futures_util::StreamExt;
use kerf_proto::v1::session_service_server::SERVICE_NAME as SESSION_SERVICE;
use tonic::transport::server::TcpConnectInfo;

use crate::config::TransportLimits;
use crate::places::{Place, Places};
use crate::status::{RequestError, refusal};

/// What encloses a message on its way, bytes: gRPC's prefix, and the trailers of gRPC-Web.
const FRAMING_BYTES: usize = 1024;

/// The calls about sessions that are read part by part: their service has places of its own for what it reads.
const IN_PARTS: [&str; 2] = ["/UploadCheckpoint", "/UploadScene"];

/// The large messages that are read or answered. A place is kept once its message is whole.
pub struct LargeMessages {
    limits: TransportLimits,
    places: Arc<Places>,
}

/// Reads the message of a call about sessions and hands it on.
pub async fn read_whole(State(large): State<Arc<LargeMessages>>, request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let method = path.strip_prefix('/').and_then(|path| path.strip_prefix(SESSION_SERVICE));
    if !method.is_some_and(|method| method.starts_with('/') && !IN_PARTS.contains(&method)) {
        return next.run(request).await;
    }
    let (parts, body) = request.into_parts();
    let connection = parts.extensions.get::<TcpConnectInfo>().and_then(TcpConnectInfo::remote_addr);
    match large.read(connection, max_bytes(&large.limits, &parts.headers), body).await {
        Ok((message, _place)) => next.run(Request::from_parts(parts, message.into())).await,
        Err(error) => refusal(&parts.headers, error),
    }
}

/// Most bytes of a body: gRPC-Web as text has four for three of the message.
fn max_bytes(limits: &TransportLimits, headers: &HeaderMap) -> usize {
    let is_text =
        headers.get(CONTENT_TYPE).is_some_and(|kind| kind.as_bytes().starts_with(b"application/grpc-web-text"));
    limits.max_request_bytes + FRAMING_BYTES + if is_text { limits.max_request_bytes / 3 } else { 0 }
}

impl LargeMessages {
    /// None yet.
    pub fn new(limits: TransportLimits) -> Arc<Self> {
        let places = Places::new(limits.max_large_requests);
        Arc::new(Self { limits, places })
    }

    /// The whole message, and its place if it is large.
    async fn read(
        &self,
        connection: Option<SocketAddr>,
        max_bytes: usize,
        body: Body,
    ) -> Result<(Vec<u8>, Option<Place>), RequestError> {
        let limit_s = self.limits.request_timeout_s;
        let collected = self.collect(connection, max_bytes, body);
        let in_time = tokio::time::timeout(Duration::from_secs_f64(limit_s), collected).await;
        in_time.map_err(|_| RequestError::UnreadInTime { limit_s })?
    }

    async fn collect(
        &self,
        connection: Option<SocketAddr>,
        max_bytes: usize,
        body: Body,
    ) -> Result<(Vec<u8>, Option<Place>), RequestError> {
        let (mut message, mut place) = (Vec::new(), None::<Place>);
        let mut body = body.into_data_stream();
        loop {
            let next = match &mut place {
                None => body.next().await,
                Some(place) => tokio::select! {
                    next = body.next() => next,
                    () = place.given_up() => return Err(self.too_many()),
                },
            };
            let Some(bytes) = next else { break };
            message.extend_from_slice(&bytes.map_err(|error| RequestError::Unread { message: error.to_string() })?);
            if message.len() > max_bytes {
                return Err(RequestError::LargeMessage { limit: self.limits.max_request_bytes });
            }
            if place.is_none() && message.len() > self.limits.max_incoming_bytes {
                place = Some(self.take(connection)?);
            }
        }
        place.iter().for_each(Place::keep);
        Ok((message, place))
    }

    fn take(&self, connection: Option<SocketAddr>) -> Result<Place, RequestError> {
        self.places.take(connection).ok_or_else(|| self.too_many())
    }

    fn too_many(&self) -> RequestError {
        RequestError::TooManyLargeMessages { limit: self.limits.max_large_requests }
    }
}
