//! Messages about sessions are read whole before anybody answers them, so that one that never ends holds up nobody. Small
//! ones cost what their stream costs; for large ones there are so many places, which a message that is read gives up
//! when another needs it.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use axum::middleware::Next;
use axum::response::Response;
use futures_util::StreamExt;
use kerf_proto::v1::session_service_server::SERVICE_NAME as SESSION_SERVICE;
use tokio::sync::oneshot;
use tonic::transport::server::TcpConnectInfo;

use crate::config::TransportLimits;
use crate::status::{RequestError, refusal};

/// What encloses a message on its way, bytes: gRPC's prefix, and the trailers of gRPC-Web.
const FRAMING_BYTES: usize = 1024;

/// The large messages that are read or answered.
pub struct Uploads {
    limits: TransportLimits,
    held: Mutex<Held>,
}

#[derive(Default)]
struct Held {
    next_id: u64,
    /// In the order of their coming.
    uploads: BTreeMap<u64, Upload>,
}

struct Upload {
    connection: Option<SocketAddr>,
    /// What gives the message up by its own end; `None` once it is whole.
    reading: Option<oneshot::Sender<()>>,
}

/// Reads the message of a call about sessions and hands it on.
pub async fn read_whole(State(uploads): State<Arc<Uploads>>, request: Request, next: Next) -> Response {
    let path = request.uri().path();
    if !path.strip_prefix('/').and_then(|path| path.strip_prefix(SESSION_SERVICE)).is_some_and(|m| m.starts_with('/')) {
        return next.run(request).await;
    }
    let (parts, body) = request.into_parts();
    let connection = parts.extensions.get::<TcpConnectInfo>().and_then(TcpConnectInfo::remote_addr);
    match uploads.read(connection, max_bytes(&uploads.limits, &parts.headers), body).await {
        Ok((message, _place)) => next.run(Request::from_parts(parts, message.into())).await,
        Err(error) => refusal(&parts.headers, error),
    }
}

/// Most bytes of a body: gRPC-Web as text has four for three of the message.
fn max_bytes(limits: &TransportLimits, headers: &HeaderMap) -> usize {
    let is_text =
        headers.get(CONTENT_TYPE).is_some_and(|kind| kind.as_bytes().starts_with(b"application/grpc-web-text"));
    limits.max_upload_bytes + FRAMING_BYTES + if is_text { limits.max_upload_bytes / 3 } else { 0 }
}

impl Uploads {
    /// None yet.
    pub fn new(limits: TransportLimits) -> Arc<Self> {
        Arc::new(Self { limits, held: Mutex::default() })
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The whole message, and its place if it is large.
    async fn read(
        self: &Arc<Self>,
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
        self: &Arc<Self>,
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
                    _ = &mut place.given_up => return Err(self.too_many()),
                },
            };
            let Some(bytes) = next else { break };
            message.extend_from_slice(&bytes.map_err(|error| RequestError::Unread { message: error.to_string() })?);
            if message.len() > max_bytes {
                return Err(RequestError::LargeMessage { limit: self.limits.max_upload_bytes });
            }
            if place.is_none() && message.len() > self.limits.max_incoming_bytes {
                place = Some(self.take(connection)?);
            }
        }
        place.iter().for_each(Place::keep);
        Ok((message, place))
    }

    /// A place for a large message. Where all are taken, one that is still read is given up: the oldest of the connection
    /// that has most of them.
    fn take(self: &Arc<Self>, connection: Option<SocketAddr>) -> Result<Place, RequestError> {
        let mut held = self.lock();
        if held.uploads.len() >= self.limits.max_uploads {
            let unread = || held.uploads.iter().filter(|(_, upload)| upload.reading.is_some());
            let count = |of| unread().filter(|(_, upload)| upload.connection == of).count();
            let oldest = unread().max_by_key(|(id, upload)| (count(upload.connection), Reverse(**id)));
            let oldest = *oldest.ok_or_else(|| self.too_many())?.0;
            held.uploads.remove(&oldest);
        }
        let (id, (reading, given_up)) = (held.next_id, oneshot::channel());
        held.next_id += 1;
        held.uploads.insert(id, Upload { connection, reading: Some(reading) });
        Ok(Place { id, uploads: Arc::clone(self), given_up })
    }

    fn too_many(&self) -> RequestError {
        RequestError::TooManyUploads { limit: self.limits.max_uploads }
    }
}

/// The place of a large message, until it is answered.
struct Place {
    id: u64,
    uploads: Arc<Uploads>,
    /// Ends when another message gets the place.
    given_up: oneshot::Receiver<()>,
}

impl Place {
    /// The message is whole: from now on nothing takes the place away.
    fn keep(&self) {
        if let Some(upload) = self.uploads.lock().uploads.get_mut(&self.id) {
            upload.reading = None;
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.uploads.lock().uploads.remove(&self.id);
    }
}
