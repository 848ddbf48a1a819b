//! Scenes and the life of sessions.

use std::sync::Arc;
use std::time::Duration;

use futures_util::future::join_all;
use futures_util::{Stream, stream};
use kerf_physics::SoundScene;
use kerf_physics::making::Making;
use kerf_physics::scene::wording::did_you_mean;
use kerf_proto::v1;
use kerf_proto::v1::create_session_request::Scene as Wanted;
use kerf_proto::v1::get_scene_request::Of as SceneOf;
use kerf_proto::v1::make_session_response::State;
use kerf_session::player::SPEEDS;
use kerf_session::stepping::Steps;
use kerf_session::{Position, Registry, Seek, Session, SessionId, SessionOptions};
use tokio::sync::watch;
use tonic::{Request, Response, Status, Streaming};
use tracing::{Instrument, Span};

use super::checkpoint_files::CheckpointFiles;
use super::in_parts::InParts;
use super::moving::Moving;
use super::owned::Owned;
use super::sent_files::SentFiles;
use super::{Outgoing, in_time};
use crate::config::{ServerConfig, setting};
use crate::convert::scene::{checkpoint, dial, making_progress, session_description, session_info};
use crate::convert::stepping::{check_steps_together, step_response, steps};
use crate::journal::Journals;
use crate::places::Place;
use crate::recording::Recordings;
use crate::scene_list::{Listed, SceneList};
use crate::security::caller::Caller;
use crate::security::guests::Guests;
use crate::status::RequestError;
use crate::{machine, pace};

/// The service.
#[derive(Clone)]
pub struct SessionService {
    registry: Arc<Registry>,
    scenes: Arc<SceneList>,
    config: Arc<ServerConfig>,
    recordings: Arc<Recordings>,
    journals: Arc<Journals>,
    in_parts: Arc<InParts>,
    sent_files: SentFiles,
    files: CheckpointFiles,
    moving: Moving,
    guests: Arc<Guests>,
    owned: Owned,
}

impl SessionService {
    pub fn new(
        registry: Arc<Registry>,
        config: Arc<ServerConfig>,
        (recordings, journals): (Arc<Recordings>, Arc<Journals>),
        guests: Arc<Guests>,
    ) -> Self {
        let scenes = Arc::new(SceneList::new(config.scene_dir.clone()));
        let in_parts = Arc::new(InParts::new(&config.transport));
        let sent_files = SentFiles::new(Arc::clone(&in_parts));
        let files = CheckpointFiles::new(Arc::clone(&in_parts));
        let owned = Owned::new(config.security.max_sessions_per_token);
        let moving = Moving {
            registry: Arc::clone(&registry),
            recordings: Arc::clone(&recordings),
            journals: Arc::clone(&journals),
            in_parts: Arc::clone(&in_parts),
        };
        Self { registry, scenes, config, recordings, journals, in_parts, sent_files, files, moving, guests, owned }
    }

    /// The session that a request names, if its caller is to know of it.
    fn get<T>(&self, request: &Request<T>, id: &str) -> Result<Arc<Session>, RequestError> {
        Caller::of(request.extensions())?.session(&self.registry, id)
    }

    /// The session that is to take steps, and these, if they are valid.
    fn steps<T>(
        &self,
        request: &Request<T>,
        asked: &v1::StepSessionRequest,
    ) -> Result<(Arc<Session>, Steps), RequestError> {
        let session = self.get(request, &asked.session_id)?;
        let steps = steps(asked, &session.limits().pose)?;
        Ok((session, steps))
    }

    fn limit_s(&self) -> f64 {
        self.config.transport.request_timeout_s
    }

    /// What became of the recording of a session that has ended. A disk that is slow is not waited for without end.
    async fn finish(&self, session: SessionId) -> Option<v1::Recording> {
        let so_far = self.recordings.so_far(session);
        let limit = Duration::from_secs_f64(self.limit_s());
        tokio::time::timeout(limit, self.recordings.finish(session)).await.unwrap_or_else(|_| {
            let name = setting!(transport.request_timeout_s);
            let error = format!("not written out within {} s ({name})", self.limit_s());
            so_far.map(|recording| v1::Recording { error, ..recording })
        })
    }

    /// Puts the files that came in calls before to what a caller asks for; with the place that they take.
    async fn with_sent_files(
        &self,
        caller: &Caller,
        mut request: v1::CreateSessionRequest,
    ) -> Result<(v1::CreateSessionRequest, Option<Place>), RequestError> {
        if request.upload_id.is_empty() {
            return Ok((request, None));
        }
        let (files, place) = self.sent_files.take(caller, &request.upload_id).await?;
        request.files.extend(files);
        Ok((request, Some(place)))
    }

    /// A session as a caller asks for it, and what it is warned of. The place of its files is held until they are read.
    async fn create(
        &self,
        caller: &Caller,
        request: v1::CreateSessionRequest,
        place_of_files: Option<Place>,
        making: watch::Sender<Option<Making>>,
    ) -> Result<v1::CreateSessionResponse, RequestError> {
        let _place = self.owned.take(&self.registry, caller)?;
        let options = SessionOptions {
            is_recorded: self.recordings.is_on(),
            is_journaled: self.journals.is_on(),
            start_paused: request.start_paused,
            dial: request.dial.map(dial).transpose()?,
            owner: caller.owner(request.private)?,
            making,
        };
        let wanted = request.scene.ok_or(RequestError::Missing { field: "scene" })?;
        if request.fit_step_rate && request.step_rate_hz.is_some() {
            let message = "fit_step_rate: not together with step_rate_hz".into();
            return Err(RequestError::SceneText { message });
        }
        let (scenes, max_bytes) = (Arc::clone(&self.scenes), self.config.transport.max_scene_bytes);
        let read = move || {
            let _place = place_of_files;
            let mut scene = match wanted {
                Wanted::SceneName(name) => by_name(&scenes, &name),
                Wanted::SceneToml(text) => from_text(&text, request.files, max_bytes),
            }?;
            if let Some(step_rate_hz) = request.step_rate_hz {
                scene = at_step_rate(scene, step_rate_hz)?;
            }
            if request.fit_step_rate {
                let kept_hz = pace::kept_rate_hz(&scene);
                scene = at_step_rate(scene, kept_hz)?;
            }
            Ok(scene)
        };
        let session = in_time(self.limit_s(), self.registry.create_from::<RequestError>(read, options)).await?;
        session.note_in(&Span::current());
        // Before anything that is waited for: a client may go away at any time.
        let claim = Claim { registry: Arc::clone(&self.registry), session: Some(Arc::clone(&session)) };
        let mut warnings = session.warnings().to_vec();
        let (recordings, journals) = (Arc::clone(&self.recordings), Arc::clone(&self.journals));
        let begun = Arc::clone(&session);
        let begin = move || {
            recordings.begin(&begun);
            journals.begin(&begun)
        };
        warnings.extend(tokio::task::spawn_blocking(begin).await.ok().flatten());
        let refused = self.recordings.so_far(session.id()).filter(|recording| !recording.error.is_empty());
        warnings.extend(refused.map(|recording| format!("the session is not recorded: {}", recording.error)));
        let session = self.describe(&session).await?;
        claim.release();
        Ok(v1::CreateSessionResponse { session: Some(session), warnings })
    }

    async fn describe(&self, session: &Session) -> Result<v1::SessionDescription, RequestError> {
        let status = in_time(self.limit_s(), session.describe()).await?;
        let kept = (self.recordings.so_far(session.id()), self.journals.so_far(session.id()));
        Ok(session_description(session, &status, &self.config.control, kept))
    }
}

/// How far a session is that is being made, and last of all the session. Who stops listening gives it up.
fn made<T>(
    create: T,
    told: watch::Receiver<Option<Making>>,
) -> impl Stream<Item = Result<v1::MakeSessionResponse, Status>>
where
    T: Future<Output = Result<v1::CreateSessionResponse, RequestError>> + Unpin,
{
    stream::unfold(Some((create, told)), |state| async {
        let (mut create, mut told) = state?;
        let (state, rest) = tokio::select! {
            created = &mut create => match created {
                Ok(created) => (State::Created(created), None),
                Err(error) => return Some((Err(error.into()), None)),
            },
            Ok(()) = told.changed() => {
                let making = *told.borrow_and_update();
                (State::Progress(making_progress(making)), Some((create, told)))
            }
        };
        Some((Ok(v1::MakeSessionResponse { state: Some(state) }), rest))
    })
}

/// The client's step rate goes before the scene's, within the same limits.
fn at_step_rate(scene: SoundScene, step_rate_hz: f64) -> Result<SoundScene, RequestError> {
    let refuse = |problems| RequestError::SceneText { message: format!("step_rate_hz: {problems}") };
    scene.with(|desc| desc.rate_hz = step_rate_hz).map_err(refuse)
}

#[tonic::async_trait]
impl v1::session_service_server::SessionService for SessionService {
    async fn list_scenes(
        &self,
        _request: Request<v1::ListScenesRequest>,
    ) -> Result<Response<v1::ListScenesResponse>, Status> {
        let scenes = Arc::clone(&self.scenes);
        let listed = tokio::task::spawn_blocking(move || scenes.list()).await.unwrap_or_default();
        let info = |listed: Listed| v1::SceneInfo { name: listed.name, description: listed.description };
        let scenes = listed.into_iter().map(info).collect();
        Ok(Response::new(v1::ListScenesResponse { scenes }))
    }

    async fn get_scene(&self, request: Request<v1::GetSceneRequest>) -> Result<Response<v1::GetSceneResponse>, Status> {
        let desc = match request.get_ref().of.as_ref().ok_or(RequestError::Missing { field: "of" })? {
            SceneOf::SceneName(name) => by_name(&self.scenes, name)?.into_scene().desc,
            SceneOf::SessionId(id) => self.get(&request, id)?.scene().desc.clone(),
        };
        let scene_toml =
            toml::to_string(&desc).map_err(|error| RequestError::SceneText { message: error.to_string() })?;
        Ok(Response::new(v1::GetSceneResponse { scene_toml }))
    }

    async fn create_session(
        &self,
        request: Request<v1::CreateSessionRequest>,
    ) -> Result<Response<v1::CreateSessionResponse>, Status> {
        let caller = Caller::of(request.extensions())?;
        let (request, place) = self.with_sent_files(&caller, request.into_inner()).await?;
        Ok(Response::new(self.create(&caller, request, place, watch::Sender::default()).await?))
    }

    type MakeSessionStream = Outgoing<v1::MakeSessionResponse>;

    async fn make_session(
        &self,
        request: Request<v1::MakeSessionRequest>,
    ) -> Result<Response<Self::MakeSessionStream>, Status> {
        let (making, mut told) = watch::channel(None);
        told.mark_changed();
        let (service, caller) = (self.clone(), Caller::of(request.extensions())?);
        let request = request.into_inner().request.ok_or(RequestError::Missing { field: "request" })?;
        let create = async move {
            let (request, place) = service.with_sent_files(&caller, request).await?;
            service.create(&caller, request, place, making).await
        };
        Ok(Response::new(Box::pin(made(Box::pin(create.instrument(Span::current())), told))))
    }

    async fn send_scene_file(
        &self,
        request: Request<v1::SendSceneFileRequest>,
    ) -> Result<Response<v1::SendSceneFileResponse>, Status> {
        let (connection, caller) = (request.remote_addr(), Caller::of(request.extensions())?);
        Ok(Response::new(self.sent_files.push(connection, &caller, request.into_inner())?))
    }

    async fn upload_scene(
        &self,
        request: Request<Streaming<v1::UploadSceneRequest>>,
    ) -> Result<Response<v1::UploadSceneResponse>, Status> {
        let (connection, caller) = (request.remote_addr(), Caller::of(request.extensions())?);
        let parts = self.in_parts.scene(request.into_inner());
        let (request, place) = self.in_parts.receive(connection, parts).await?;
        let created = self.create(&caller, request, Some(place), watch::Sender::default()).await?;
        let v1::CreateSessionResponse { session, warnings } = created;
        Ok(Response::new(v1::UploadSceneResponse { session, warnings }))
    }

    async fn describe_session(
        &self,
        request: Request<v1::DescribeSessionRequest>,
    ) -> Result<Response<v1::DescribeSessionResponse>, Status> {
        let session = self.get(&request, &request.get_ref().session_id)?;
        let session = Some(self.describe(&session).await?);
        Ok(Response::new(v1::DescribeSessionResponse { session }))
    }

    async fn list_sessions(
        &self,
        request: Request<v1::ListSessionsRequest>,
    ) -> Result<Response<v1::ListSessionsResponse>, Status> {
        let caller = Caller::of(request.extensions())?;
        let known = self.registry.list().into_iter().filter(|session| caller.knows(session));
        let sessions = known.map(|session| session_info(&session, self.journals.so_far(session.id()))).collect();
        let server = v1::ServerVitals {
            version: crate::VERSION.into(),
            resident_memory_bytes: machine::resident_memory_bytes().unwrap_or_default(),
            max_sessions: self.registry.limits().max_sessions as u32,
            expected_sessions: self.registry.expected() as u32,
        };
        let server_instance = self.registry.instance().to_string();
        Ok(Response::new(v1::ListSessionsResponse { sessions, server_instance, server: Some(server) }))
    }

    async fn close_session(
        &self,
        request: Request<v1::CloseSessionRequest>,
    ) -> Result<Response<v1::CloseSessionResponse>, Status> {
        let id = &request.get_ref().session_id;
        let caller = Caller::of(request.extensions())?;
        let session = caller.session(&self.registry, id)?;
        caller.check_end(&session)?;
        in_time(self.limit_s(), self.registry.close(id)).await?;
        let recording = self.finish(session.id()).await;
        self.journals.finish(session.id()).await;
        Ok(Response::new(v1::CloseSessionResponse { recording }))
    }

    async fn pause_session(
        &self,
        request: Request<v1::PauseSessionRequest>,
    ) -> Result<Response<v1::PauseSessionResponse>, Status> {
        let session = self.get(&request, &request.get_ref().session_id)?;
        let step = in_time(self.limit_s(), session.pause()).await?;
        Ok(Response::new(v1::PauseSessionResponse { step }))
    }

    async fn resume_session(
        &self,
        request: Request<v1::ResumeSessionRequest>,
    ) -> Result<Response<v1::ResumeSessionResponse>, Status> {
        let session = self.get(&request, &request.get_ref().session_id)?;
        let step = in_time(self.limit_s(), session.resume()).await?;
        Ok(Response::new(v1::ResumeSessionResponse { step }))
    }

    async fn step_session(
        &self,
        request: Request<v1::StepSessionRequest>,
    ) -> Result<Response<v1::StepSessionResponse>, Status> {
        let (session, steps) = self.steps(&request, request.get_ref())?;
        let stepped = in_time(self.limit_s(), session.step(steps)).await?;
        Ok(Response::new(step_response(&stepped)))
    }

    async fn step_sessions(
        &self,
        request: Request<v1::StepSessionsRequest>,
    ) -> Result<Response<v1::StepSessionsResponse>, Status> {
        let asked = &request.get_ref().sessions;
        check_steps_together(asked)?;
        let of_one = |(index, asked): (usize, &v1::StepSessionRequest)| {
            let (session, steps) = self.steps(&request, asked).map_err(|error| error.of_session(index))?;
            Ok((index, session, steps))
        };
        let checked: Vec<_> = asked.iter().enumerate().map(of_one).collect::<Result<_, RequestError>>()?;
        let stepped = join_all(checked.into_iter().map(async |(index, session, steps)| {
            in_time(self.limit_s(), session.step(steps)).await.map_err(|error| error.of_session(index))
        }));
        // All of them have ended before the error of one is told.
        let stepped: Vec<_> = stepped.await.into_iter().collect::<Result<_, _>>()?;
        Ok(Response::new(v1::StepSessionsResponse { sessions: stepped.iter().map(step_response).collect() }))
    }

    async fn reset_session(
        &self,
        request: Request<v1::ResetSessionRequest>,
    ) -> Result<Response<v1::ResetSessionResponse>, Status> {
        let session = self.get(&request, &request.get_ref().session_id)?;
        in_time(self.limit_s(), session.reset()).await?;
        let recording = self.recordings.so_far(session.id());
        Ok(Response::new(v1::ResetSessionResponse { recording }))
    }

    async fn save_checkpoint(
        &self,
        request: Request<v1::SaveCheckpointRequest>,
    ) -> Result<Response<v1::SaveCheckpointResponse>, Status> {
        let v1::SaveCheckpointRequest { session_id, name } = request.get_ref();
        let step = in_time(self.limit_s(), self.get(&request, session_id)?.save_checkpoint(name)).await?;
        Ok(Response::new(v1::SaveCheckpointResponse { step }))
    }

    async fn restore_checkpoint(
        &self,
        request: Request<v1::RestoreCheckpointRequest>,
    ) -> Result<Response<v1::RestoreCheckpointResponse>, Status> {
        let v1::RestoreCheckpointRequest { session_id, name } = request.get_ref();
        let session = self.get(&request, session_id)?;
        let step = in_time(self.limit_s(), session.restore_checkpoint(name)).await?;
        let recording = self.recordings.so_far(session.id());
        Ok(Response::new(v1::RestoreCheckpointResponse { step, recording }))
    }

    async fn list_checkpoints(
        &self,
        request: Request<v1::ListCheckpointsRequest>,
    ) -> Result<Response<v1::ListCheckpointsResponse>, Status> {
        let session = self.get(&request, &request.get_ref().session_id)?;
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
        in_time(self.limit_s(), self.get(&request, session_id)?.delete_checkpoint(name)).await?;
        Ok(Response::new(v1::DeleteCheckpointResponse {}))
    }

    type DownloadCheckpointStream = Outgoing<v1::DownloadCheckpointResponse>;

    async fn download_checkpoint(
        &self,
        request: Request<v1::DownloadCheckpointRequest>,
    ) -> Result<Response<Self::DownloadCheckpointStream>, Status> {
        let connection = request.remote_addr();
        let v1::DownloadCheckpointRequest { session_id, name } = request.get_ref();
        Ok(Response::new(self.files.download(connection, &*self.get(&request, session_id)?, name).await?))
    }

    async fn upload_checkpoint(
        &self,
        request: Request<Streaming<v1::UploadCheckpointRequest>>,
    ) -> Result<Response<v1::UploadCheckpointResponse>, Status> {
        let (connection, caller) = (request.remote_addr(), Caller::of(request.extensions())?);
        let find = |id: &str| caller.session(&self.registry, id);
        let step = self.files.upload(connection, request.into_inner(), find).await?;
        Ok(Response::new(v1::UploadCheckpointResponse { step }))
    }

    async fn invite_viewer(
        &self,
        request: Request<v1::InviteViewerRequest>,
    ) -> Result<Response<v1::InviteViewerResponse>, Status> {
        let caller = Caller::of(request.extensions())?;
        let session = caller.session(&self.registry, &request.get_ref().session_id)?;
        let host = caller.name().ok_or(RequestError::NoGuests)?;
        let (token, stay) = self.guests.invite(host, session.id())?;
        let (token, good_for_s) = (token.reveal().into(), stay.as_secs_f64());
        Ok(Response::new(v1::InviteViewerResponse { token, good_for_s }))
    }

    async fn move_session(
        &self,
        request: Request<v1::MoveSessionRequest>,
    ) -> Result<Response<v1::MoveSessionResponse>, Status> {
        let session = self.get(&request, &request.get_ref().session_id)?;
        let id = session.id();
        let step = self.moving.send(session, request.into_inner()).await?;
        self.finish(id).await;
        Ok(Response::new(v1::MoveSessionResponse { step }))
    }

    async fn take_session(
        &self,
        request: Request<Streaming<v1::TakeSessionRequest>>,
    ) -> Result<Response<v1::TakeSessionResponse>, Status> {
        let step = self.moving.take(request.remote_addr(), request.into_inner()).await?;
        Ok(Response::new(v1::TakeSessionResponse { step }))
    }

    async fn seek_replay(
        &self,
        request: Request<v1::SeekReplayRequest>,
    ) -> Result<Response<v1::SeekReplayResponse>, Status> {
        let caller = Caller::of(request.extensions())?;
        let v1::SeekReplayRequest { session_id, time_s, speed } = request.into_inner();
        if let Some(value) = time_s.filter(|time_s| !(time_s.is_finite() && *time_s >= 0.0)) {
            return Err(RequestError::Rate { field: "time_s", value }.into());
        }
        if let Some(speed) = speed.filter(|speed| !SPEEDS.contains(speed)) {
            return Err(RequestError::Speed { speed }.into());
        }
        let session = caller.session(&self.registry, &session_id)?;
        let Position { time_s, length_s, speed, step } =
            in_time(self.limit_s(), session.seek(Seek { time_s, speed })).await?;
        Ok(Response::new(v1::SeekReplayResponse { time_s, length_s, speed, step }))
    }
}

/// A session that its client has not been told of. One that goes away before leaves it to nobody.
struct Claim {
    registry: Arc<Registry>,
    session: Option<Arc<Session>>,
}

impl Claim {
    /// The client is about to be told.
    fn release(mut self) {
        self.session = None;
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        if let Some(session) = self.session.take() {
            let registry = Arc::clone(&self.registry);
            tokio::spawn(async move { drop(registry.close(&session.id().to_string()).await) });
        }
    }
}

fn by_name(scenes: &SceneList, name: &str) -> Result<SoundScene, RequestError> {
    let scene = scenes.load(name).ok_or_else(|| {
        let name: String = name.chars().take(64).collect();
        let known = scenes.list();
        let guess = did_you_mean(&name, known.iter().map(|listed| listed.name.as_str()));
        RequestError::NoScene { name, guess }
    })?;
    scene.map_err(|error| RequestError::SceneText { message: error.to_string() })
}

/// A scene from a client's text, which is measured before it is read, and the files that came with it.
fn from_text(text: &str, files: Vec<v1::SceneFile>, max_bytes: usize) -> Result<SoundScene, RequestError> {
    let refuse = |message: String| RequestError::SceneText { message };
    if text.len() > max_bytes {
        let name = setting!(transport.max_scene_bytes);
        return Err(refuse(format!("scene_toml: {} bytes, at most {max_bytes} ({name})", text.len())));
    }
    let files = files.into_iter().map(|file| (file.name, file.data)).collect();
    kerf_scenes::file::from_text("scene_toml", text, &files).map_err(|error| refuse(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_that_is_too_large_is_refused_before_it_is_read() {
        let refused = from_text(&"x".repeat(11), Vec::new(), 10).unwrap_err().to_string();
        assert!(refused.contains("11 bytes, at most 10"), "{refused}");
    }
}
