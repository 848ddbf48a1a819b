//! Shows sessions to viewers.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use futures_util::stream;
use kerf_proto::v1;
use kerf_proto::v1::view_response::Message;
use kerf_session::{Registry, Session, SessionId};
use tokio::sync::watch;
use tonic::{Request, Response, Status};

use super::interiors::Interiors;
use super::view_stream::ViewStream;
use super::viewing::Viewing;
use super::{Outgoing, check_version, grant_rate_hz, in_time, moved, token};
use crate::config::ViewLimits;
use crate::encode::{Encoder, Encoding};
use crate::security::caller::Caller;
use crate::status::RequestError;

/// The rate when a viewer states no wish: a screen's.
const DEFAULT_RATE_HZ: f64 = 60.0;

/// The service.
pub struct ViewService {
    registry: Arc<Registry>,
    limits: ViewLimits,
    /// How long a session has to answer.
    request_timeout_s: f64,
    viewers: Arc<Acknowledged>,
    encoders: Encoders,
    interiors: Interiors,
    viewing: Arc<Viewing>,
}

impl ViewService {
    pub fn new(registry: Arc<Registry>, viewing: Viewing, limits: ViewLimits, request_timeout_s: f64) -> Self {
        Self {
            registry,
            limits,
            request_timeout_s,
            viewers: Arc::default(),
            encoders: Encoders::default(),
            interiors: Interiors::default(),
            viewing: Arc::new(viewing),
        }
    }
}

#[tonic::async_trait]
impl v1::view_service_server::ViewService for ViewService {
    type ViewStream = Outgoing<v1::ViewResponse>;

    async fn view(&self, request: Request<v1::ViewRequest>) -> Result<Response<Self::ViewStream>, Status> {
        let caller = Caller::of(request.extensions())?;
        let request = request.into_inner();
        check_version("protocol_version", request.protocol_version)?;
        let max_hz = self.registry.limits().view_rate_hz;
        let rate_hz = grant_rate_hz("rate_hz", request.rate_hz, DEFAULT_RATE_HZ, max_hz)?;
        let encoding = Encoding::granted(&request)?;
        let session = caller.session(&self.registry, &request.session_id)?;
        let mut viewer = session.view().map_err(RequestError::from)?;
        // Half a published interval early is in time: the next one would be half an interval late.
        let interval_s = 1.0 / rate_hz - 0.5 / max_hz;
        viewer.set_interval_ns((interval_s * 1e9) as u64);
        let (registered, acknowledged) = self.viewers.register();
        let hello = v1::ViewHello {
            protocol_version: kerf_proto::PROTOCOL_VERSION,
            server_instance: self.registry.instance().to_string(),
            viewer: registered.name.clone(),
        };
        let encoder = self.encoders.of(&session, encoding);
        let view = ViewStream::new(hello, viewer, acknowledged, encoder, request.wants_energy, &self.limits);
        let viewing = Arc::clone(&self.viewing);
        let messages = stream::unfold(Some((view, registered)), move |state| {
            let (viewing, session) = (Arc::clone(&viewing), Arc::clone(&session));
            async move {
                let (mut view, registered) = state?;
                let (message, view) = viewing.work(async move { (view.next().await, view) }).await?;
                // A session that has left closes here; its viewers are told where it goes on.
                if let (Some(moved), true) = (moved(&session), message.as_ref().is_none_or(is_closing)) {
                    return Some((Err(moved.into()), None));
                }
                Some((Ok(message?), Some((view, registered))))
            }
        });
        Ok(Response::new(Box::pin(messages)))
    }

    async fn acknowledge(
        &self,
        request: Request<v1::AcknowledgeRequest>,
    ) -> Result<Response<v1::AcknowledgeResponse>, Status> {
        let v1::AcknowledgeRequest { viewer, number } = request.get_ref();
        self.viewers.acknowledge(viewer, *number)?;
        Ok(Response::new(v1::AcknowledgeResponse {}))
    }

    async fn get_interior(
        &self,
        request: Request<v1::GetInteriorRequest>,
    ) -> Result<Response<v1::GetInteriorResponse>, Status> {
        let v1::GetInteriorRequest { session_id, object } = request.get_ref();
        let session = Caller::of(request.extensions())?.session(&self.registry, session_id)?;
        let objects = session.object_stats();
        let stats = objects.get(*object as usize);
        let stats = stats.ok_or(RequestError::NoObject { object: *object, objects: objects.len() })?;
        let (voxels, limit) = (stats.voxels, self.limits.max_interior_voxels);
        if voxels > limit {
            return Err(RequestError::TooManyVoxels { object: *object, voxels, limit }.into());
        }
        let interior = in_time(self.request_timeout_s, self.interiors.of(&session, *object as usize)).await?;
        Ok(Response::new(interior.as_ref().clone()))
    }
}

fn is_closing(message: &v1::ViewResponse) -> bool {
    matches!(&message.message, Some(Message::Event(event)) if event.kind() == v1::EventKind::Closing)
}

/// What encodes each session's states, for as long as anybody reads them.
#[derive(Default)]
struct Encoders(Mutex<HashMap<(SessionId, Encoding), SharedEncoder>>);

type SharedEncoder = Weak<Mutex<Encoder>>;

impl Encoders {
    fn of(&self, session: &Session, encoding: Encoding) -> Arc<Mutex<Encoder>> {
        let mut encoders = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        encoders.retain(|_, encoder| encoder.strong_count() > 0);
        let known = encoders.entry((session.id(), encoding)).or_default();
        known.upgrade().unwrap_or_else(|| {
            let voxel_sizes_m = session.object_stats().iter().map(|object| object.voxel_size_m);
            let encoder = Arc::new(Mutex::new(Encoder::new(encoding, voxel_sizes_m)));
            *known = Arc::downgrade(&encoder);
            encoder
        })
    }
}

/// The newest message that each viewer has read, by the viewer's name.
#[derive(Default)]
struct Acknowledged(Mutex<HashMap<String, watch::Sender<u64>>>);

impl Acknowledged {
    fn lock(&self) -> MutexGuard<'_, HashMap<String, watch::Sender<u64>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn register(self: &Arc<Self>) -> (Registered, watch::Receiver<u64>) {
        let (number, acknowledged) = watch::channel(0);
        let name = token();
        self.lock().insert(name.clone(), number);
        (Registered { name, among: Arc::clone(self) }, acknowledged)
    }

    fn acknowledge(&self, viewer: &str, number: u64) -> Result<(), RequestError> {
        let viewers = self.lock();
        let newest = viewers.get(viewer).ok_or(RequestError::NoViewer)?;
        newest.send_if_modified(|newest| {
            let is_newer = number > *newest;
            *newest = number.max(*newest);
            is_newer
        });
        Ok(())
    }
}

/// A viewer that is known as long as its stream lives.
struct Registered {
    name: String,
    among: Arc<Acknowledged>,
}

impl Drop for Registered {
    fn drop(&mut self) {
        self.among.lock().remove(&self.name);
    }
}
