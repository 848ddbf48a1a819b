//! The session that the links of a station's devices drive together.

use std::sync::Arc;
use std::time::Duration;

use kerf_access::{Wire, make_session};
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, create_session_request};
use tokio::sync::Mutex;
use tonic::{Request, Status};

use super::connection::{Ended, STEP_TIMEOUT, connect, refused};
use crate::config::ServerConfig;

/// Building the largest scenes takes seconds.
const CREATE_TIMEOUT: Duration = Duration::from_secs(120);

/// A session that exists, or one of a scene: it is created by the first that needs it, again when it is gone, and closed
/// by the last that leaves.
#[derive(Debug)]
pub struct SharedSession {
    /// `None`: it exists, and is not ours to create or to close.
    scene: Option<String>,
    /// Once it is known.
    id: Mutex<Option<String>>,
}

impl SharedSession {
    /// A session that exists.
    #[must_use]
    pub fn join(id: &str) -> Arc<Self> {
        Arc::new(Self { scene: None, id: Mutex::new(Some(id.to_owned())) })
    }

    /// A new session of a scene.
    #[must_use]
    pub fn create(scene: &str) -> Arc<Self> {
        Arc::new(Self { scene: Some(scene.to_owned()), id: Mutex::default() })
    }

    /// Its scene and its id, as the server describes them: tools go by their names there.
    ///
    /// # Errors
    /// What went wrong, for people.
    pub async fn describe(&self, server: &ServerConfig) -> Result<(v1::SceneSummary, String), String> {
        let wire = connect(server).await.map_err(Ended::text)?;
        let session_id = match self.id(&wire).await {
            Ok(session_id) => session_id,
            Err(Ended::SessionGone(why)) => return Err(format!("{why}{}", scenes(wire).await)),
            Err(ended) => return Err(ended.text()),
        };
        let request = v1::DescribeSessionRequest { session_id: session_id.clone() };
        let reply = SessionServiceClient::new(wire).describe_session(request).await;
        let reply = reply.map_err(|status| refused("the session", &status).text())?.into_inner();
        let scene = reply.session.and_then(|session| session.scene);
        Ok((scene.ok_or("the server described a session without its scene")?, session_id))
    }

    /// Its id; where it has none it is created.
    pub(super) async fn id(&self, wire: &Wire) -> Result<String, Ended> {
        // Held meanwhile: the others wait for the session that is being created.
        let mut id = self.id.lock().await;
        if let (None, Some(scene)) = (&*id, &self.scene) {
            let created = create(wire.clone(), scene).await;
            *id = Some(created.map_err(|status| refused(&format!("creating `{scene}`"), &status))?);
        }
        id.clone().ok_or_else(|| Ended::Hopeless("no session was given".into()))
    }

    /// A session of this id is not there any more: what happens next, or else what to do.
    pub(super) async fn gone(&self, gone_id: &str) -> Result<String, String> {
        let Some(scene) = &self.scene else {
            return Err(format!("start the station with another session than {gone_id}"));
        };
        // Another link may have found out before.
        self.id.lock().await.take_if(|id| id == gone_id);
        Ok(format!("a new one of `{scene}` is created, with an organ that is not cut yet"))
    }

    /// The last one closes what was created.
    pub async fn leave(self: &Arc<Self>, server: &ServerConfig) {
        if self.scene.is_none() || Arc::strong_count(self) > 1 {
            return;
        }
        let Some(session_id) = self.id.lock().await.take() else { return };
        if let Ok(wire) = connect(server).await {
            let mut request = Request::new(v1::CloseSessionRequest { session_id });
            request.set_timeout(STEP_TIMEOUT);
            // The server closes what nobody uses by itself.
            let _ = SessionServiceClient::new(wire).close_session(request).await;
        }
    }
}

/// What a server could create instead.
async fn scenes(wire: Wire) -> String {
    let Ok(reply) = SessionServiceClient::new(wire).list_scenes(v1::ListScenesRequest {}).await else {
        return String::new();
    };
    let names: Vec<String> = reply.into_inner().scenes.into_iter().map(|scene| scene.name).collect();
    format!("; the server has: {}", names.join(", "))
}

async fn create(wire: Wire, scene: &str) -> Result<String, Status> {
    let scene = Some(create_session_request::Scene::SceneName(scene.to_owned()));
    let request = v1::CreateSessionRequest { scene, ..Default::default() };
    let created = make_session(&mut SessionServiceClient::new(wire), request, CREATE_TIMEOUT).await?;
    let session = created.session.ok_or_else(|| Status::internal("a session without a description"))?;
    Ok(session.session_id)
}
