//! Shows sessions to viewers.

use std::sync::Arc;

use futures_util::stream;
use kerf_proto::v1;
use kerf_session::Registry;
use tonic::{Request, Response, Status};

use super::{Outgoing, check_version, grant_rate_hz};
use crate::convert::view::view_event;
use crate::status::RequestError;

/// The rate when a viewer states no wish: a screen's.
const DEFAULT_RATE_HZ: f64 = 60.0;

/// The service.
pub struct ViewService {
    registry: Arc<Registry>,
}

impl ViewService {
    pub fn new(registry: Arc<Registry>) -> Self {
        Self { registry }
    }
}

#[tonic::async_trait]
impl v1::view_service_server::ViewService for ViewService {
    type ViewStream = Outgoing<v1::ViewEvent>;

    async fn view(&self, request: Request<v1::ViewRequest>) -> Result<Response<Self::ViewStream>, Status> {
        let request = request.into_inner();
        check_version(request.protocol_version)?;
        let max_hz = self.registry.limits().view_rate_hz;
        let rate_hz = grant_rate_hz("rate_hz", request.rate_hz, DEFAULT_RATE_HZ, max_hz)?;
        let session = self.registry.get(&request.session_id).map_err(RequestError::from)?;
        let mut viewer = session.view().map_err(RequestError::from)?;
        // Half a published interval early is in time: the next one would be half an interval late.
        let interval_s = 1.0 / rate_hz - 0.5 / max_hz;
        viewer.set_interval_ns((interval_s * 1e9) as u64);
        let messages = stream::unfold(viewer, move |mut viewer| async move {
            let message = viewer.next().await?;
            Some((Ok(view_event(&message, request.wants_energy)), viewer))
        });
        Ok(Response::new(Box::pin(messages)))
    }
}
