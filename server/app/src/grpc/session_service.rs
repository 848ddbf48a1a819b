//! Scenes and the life of sessions.

use std::sync::Arc;
use std::time::Duration;

use kerf_physics::{Scene, SceneError};
use kerf_proto::v1;
use kerf_proto::v1::create_session_request::Scene as Wanted;
use kerf_proto::v1::get_scene_request::Of as SceneOf;
use kerf_scenes::catalog;
use kerf_session::{Registry, Session, SessionOptions};
use tonic::{Request, Response, Status};

use super::in_time;
use crate::config::ServerConfig;
use crate::convert::scene::{checkpoint, dial, session_description, session_info};
use crate::recording;
use crate::status::RequestError;

/// Most steps that a session that stands is told to take at once: a second at 1 kHz.
const MAX_STEPS: u32 = 1000;

/// The service.
pub struct SessionService {
    registry: Arc<Registry>,
    config: Arc<ServerConfig>,
}

impl SessionService {
    pub fn new(registry: Arc<Registry>, config: Arc<ServerConfig>) -> Self {
        Self { registry, config }
    }

    fn get(&self, id: &str) -> Result<Arc<Session>, RequestError> {
        Ok(self.registry.get(id)?)
    }

    /// Keeps what a reset, a way back or the end of a session would lose, unless the session does not answer.
    async fn record(&self, session: &Session) {
        if let Some(folder) = &self.config.record_dir {
            let limit = Duration::from_secs_f64(self.limit_s());
            let _ = tokio::time::timeout(limit, recording::save(folder, session)).await;
        }
    }

    fn limit_s(&self) -> f64 {
        self.config.transport.request_timeout_s
    }

    async fn describe(&self, session: &Session) -> Result<v1::SessionDescription, RequestError> {
        let status = in_time(self.limit_s(), session.describe()).await?;
        Ok(session_description(session, &status, &self.config.control))
    }
}

/// The client's step rate goes before the scene's, within the same limits.
fn set_step_rate(scene: &mut Scene, step_rate_hz: f64) -> Result<(), RequestError> {
    scene.desc.rate_hz = step_rate_hz;
    let refuse = |error: SceneError| RequestError::SceneText { message: format!("step_rate_hz: {error}") };
    scene.desc.validate().map_err(refuse)
}

#[tonic::async_trait]
impl v1::session_service_server::SessionService for SessionService {
    async fn list_scenes(
        &self,
        _request: Request<v1::ListScenesRequest>,
    ) -> Result<Response<v1::ListScenesResponse>, Status> {
        let info = |name: &str| {
            let description = catalog::builtin(name).ok()?.desc.description;
            Some(v1::SceneInfo { name: name.into(), description })
        };
        let scenes = catalog::builtin_names().into_iter().filter_map(info).collect();
        Ok(Response::new(v1::ListScenesResponse { scenes }))
    }

    async fn get_scene(&self, request: Request<v1::GetSceneRequest>) -> Result<Response<v1::GetSceneResponse>, Status> {
        let desc = match request.into_inner().of.ok_or(RequestError::Missing { field: "of" })? {
            SceneOf::SceneName(name) => by_name(&name)?.desc,
            SceneOf::SessionId(id) => self.get(&id)?.scene().desc.clone(),
        };
        let scene_toml =
            toml::to_string(&desc).map_err(|error| RequestError::SceneText { message: error.to_string() })?;
        Ok(Response::new(v1::GetSceneResponse { scene_toml }))
    }

    async fn create_session(
        &self,
        request: Request<v1::CreateSessionRequest>,
    ) -> Result<Response<v1::CreateSessionResponse>, Status> {
        let request = request.into_inner();
        let mut scene = match request.scene.ok_or(RequestError::Missing { field: "scene" })? {
            Wanted::SceneName(name) => by_name(&name),
            Wanted::SceneToml(text) => from_text(&text, self.config.transport.max_scene_bytes),
        }?;
        if let Some(step_rate_hz) = request.step_rate_hz {
            set_step_rate(&mut scene, step_rate_hz)?;
        }
        let options = SessionOptions { start_paused: request.start_paused, dial: request.dial.map(dial).transpose()? };
        let session = in_time(self.limit_s(), self.registry.create(scene, options)).await?;
        let warnings = session.warnings().to_vec();
        let session = Some(self.describe(&session).await?);
        Ok(Response::new(v1::CreateSessionResponse { session, warnings }))
    }

    async fn describe_session(
        &self,
        request: Request<v1::DescribeSessionRequest>,
    ) -> Result<Response<v1::DescribeSessionResponse>, Status> {
        let session = self.get(&request.get_ref().session_id)?;
        let session = Some(self.describe(&session).await?);
        Ok(Response::new(v1::DescribeSessionResponse { session }))
    }

    async fn list_sessions(
        &self,
        _request: Request<v1::ListSessionsRequest>,
    ) -> Result<Response<v1::ListSessionsResponse>, Status> {
        let sessions = self.registry.list().iter().map(|session| session_info(session)).collect();
        Ok(Response::new(v1::ListSessionsResponse { sessions }))
    }

    async fn close_session(
        &self,
        request: Request<v1::CloseSessionRequest>,
    ) -> Result<Response<v1::CloseSessionResponse>, Status> {
        let id = &request.get_ref().session_id;
        self.record(&*self.get(id)?).await;
        in_time(self.limit_s(), self.registry.close(id)).await?;
        Ok(Response::new(v1::CloseSessionResponse {}))
    }

    async fn pause_session(
        &self,
        request: Request<v1::PauseSessionRequest>,
    ) -> Result<Response<v1::PauseSessionResponse>, Status> {
        let session = self.get(&request.get_ref().session_id)?;
        let step = in_time(self.limit_s(), session.pause()).await?;
        Ok(Response::new(v1::PauseSessionResponse { step }))
    }

    async fn resume_session(
        &self,
        request: Request<v1::ResumeSessionRequest>,
    ) -> Result<Response<v1::ResumeSessionResponse>, Status> {
        let session = self.get(&request.get_ref().session_id)?;
        let step = in_time(self.limit_s(), session.resume()).await?;
        Ok(Response::new(v1::ResumeSessionResponse { step }))
    }

    async fn step_session(
        &self,
        request: Request<v1::StepSessionRequest>,
    ) -> Result<Response<v1::StepSessionResponse>, Status> {
        let v1::StepSessionRequest { session_id, steps } = request.get_ref();
        if !(1..=MAX_STEPS).contains(steps) {
            return Err(RequestError::Steps { steps: *steps, limit: MAX_STEPS }.into());
        }
        let step = in_time(self.limit_s(), self.get(session_id)?.step(*steps)).await?;
        Ok(Response::new(v1::StepSessionResponse { step }))
    }

    async fn reset_session(
        &self,
        request: Request<v1::ResetSessionRequest>,
    ) -> Result<Response<v1::ResetSessionResponse>, Status> {
        let session = self.get(&request.get_ref().session_id)?;
        self.record(&session).await;
        in_time(self.limit_s(), session.reset()).await?;
        Ok(Response::new(v1::ResetSessionResponse {}))
    }

    async fn save_checkpoint(
        &self,
        request: Request<v1::SaveCheckpointRequest>,
    ) -> Result<Response<v1::SaveCheckpointResponse>, Status> {
        let v1::SaveCheckpointRequest { session_id, name } = request.get_ref();
        let step = in_time(self.limit_s(), self.get(session_id)?.save_checkpoint(name)).await?;
        Ok(Response::new(v1::SaveCheckpointResponse { step }))
    }

    async fn restore_checkpoint(
        &self,
        request: Request<v1::RestoreCheckpointRequest>,
    ) -> Result<Response<v1::RestoreCheckpointResponse>, Status> {
        let v1::RestoreCheckpointRequest { session_id, name } = request.get_ref();
        let session = self.get(session_id)?;
        self.record(&session).await;
        let step = in_time(self.limit_s(), session.restore_checkpoint(name)).await?;
        Ok(Response::new(v1::RestoreCheckpointResponse { step }))
    }

    async fn list_checkpoints(
        &self,
        request: Request<v1::ListCheckpointsRequest>,
    ) -> Result<Response<v1::ListCheckpointsResponse>, Status> {
        let session = self.get(&request.get_ref().session_id)?;
        let checkpoints = in_time(self.limit_s(), session.checkpoints()).await?;
        Ok(Response::new(v1::ListCheckpointsResponse {
            checkpoints: checkpoints.into_iter().map(checkpoint).collect(),
        }))
    }

    async fn delete_checkpoint(
        &self,
        request: Request<v1::DeleteCheckpointRequest>,
    ) -> Result<Response<v1::DeleteCheckpointResponse>, Status> {
        let v1::DeleteCheckpointRequest { session_id, name } = request.get_ref();
        in_time(self.limit_s(), self.get(session_id)?.delete_checkpoint(name)).await?;
        Ok(Response::new(v1::DeleteCheckpointResponse {}))
    }
}

/// The built-in scene of this name. Paths are not names: a client's word reaches no file.
fn by_name(name: &str) -> Result<Scene, RequestError> {
    catalog::builtin(name).map_err(|_| RequestError::NoScene { name: name.chars().take(64).collect() })
}

/// A scene from a client's text, which is measured before it is read.
fn from_text(text: &str, max_bytes: usize) -> Result<Scene, RequestError> {
    let refuse = |message: String| RequestError::SceneText { message };
    if text.len() > max_bytes {
        return Err(refuse(format!("scene_toml: {} bytes, at most {max_bytes} (max_scene_bytes)", text.len())));
    }
    kerf_scenes::file::from_text("scene_toml", text).map_err(|error| refuse(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_that_is_too_large_is_refused_before_it_is_read() {
        let refused = from_text(&"x".repeat(11), 10).unwrap_err().to_string();
        assert!(refused.contains("11 bytes, at most 10"), "{refused}");
    }
}
