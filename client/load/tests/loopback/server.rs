//! A server of a few lines: a box that pushes back like a spring, and whose top opens once.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use kerf_proto::v1::control_service_server::{ControlService, ControlServiceServer};
use kerf_proto::v1::session_service_server::{SessionService, SessionServiceServer};
use kerf_proto::v1::view_service_server::{ViewService, ViewServiceServer};
use kerf_proto::v1::{
    self, ControlRequest, ControlResponse, ViewResponse, control_request, control_response, view_response,
};
use kerf_replica::surface_hash;
use tokio::net::TcpListener;
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Behaviour {
    Good,
    /// Every patch carries a wrong hash.
    WrongHash,
    /// The control stream ends after a few contacts.
    DropsDriver,
    /// Every fifth pose is rejected.
    RejectsPoses,
    /// A fifth session is refused.
    TakesFourSessions,
}

/// Height of the box, m.
const TOP_M: f32 = 0.05;
/// Stiffness of its spring, N/m.
pub const STIFFNESS_N_PER_M: f32 = 100.0;
const STEP_S: f64 = 1e-3;
/// Calls and streams that a connection may have at a time.
const STREAMS_PER_CONNECTION: u32 = 4;
/// How long after its deadline each step ends, ns.
pub const LAG_NS: u64 = 700_000;

#[derive(Clone)]
pub struct Server {
    behaviour: Behaviour,
    created: Arc<AtomicU32>,
}

/// Serves on a free port and returns its address.
pub async fn start(behaviour: Behaviour) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("loopback has free ports");
    let address = listener.local_addr().expect("bound");
    let server = Server { behaviour, created: Arc::default() };
    let routes = tonic::transport::Server::builder()
        .tcp_nodelay(true)
        .max_concurrent_streams(STREAMS_PER_CONNECTION)
        .add_service(SessionServiceServer::new(server.clone()))
        .add_service(ControlServiceServer::new(server.clone()))
        .add_service(ViewServiceServer::new(server));
    tokio::spawn(routes.serve_with_incoming(TcpListenerStream::new(listener)));
    address.to_string()
}

fn vec3(x: f32, y: f32, z: f32) -> v1::Vec3 {
    v1::Vec3 { x, y, z }
}

fn scene() -> v1::SceneSummary {
    let scalpel = v1::tool_summary::Kind::Blade(v1::BladeSummary { width_m: 0.02, ..Default::default() });
    v1::SceneSummary {
        name: "box".to_owned(),
        dt_s: STEP_S,
        objects: vec![v1::ObjectSummary {
            name: "box".to_owned(),
            rest_min_m: Some(vec3(-0.1, 0.0, -0.05)),
            rest_max_m: Some(vec3(0.1, TOP_M, 0.05)),
            fracture_energy_j_per_m2: Some(100.0),
            ..Default::default()
        }],
        tools: vec![v1::ToolSummary { name: "scalpel".to_owned(), kind: Some(scalpel) }],
        ..Default::default()
    }
}

fn limits() -> v1::Limits {
    v1::Limits { max_tool_speed_m_per_s: 1.0, lease_s: 2.0, ..Default::default() }
}

fn description() -> v1::SessionDescription {
    v1::SessionDescription {
        session_id: "one".to_owned(),
        scene: Some(scene()),
        limits: Some(limits()),
        ..Default::default()
    }
}

/// The box as one element with top and bottom.
fn structure() -> v1::BodyStructure {
    let corners = (0..8).map(|c| [c & 1, c >> 1 & 1, c >> 2]);
    v1::BodyStructure {
        node_count: 8,
        node_ids: (0..8).collect(),
        node_rest_m: corners
            .clone()
            .flat_map(|[x, y, z]| [0.2 * x as f32 - 0.1, TOP_M * y as f32, 0.1 * z as f32 - 0.05])
            .collect(),
        element_ids: vec![0],
        element_nodes: (0..8).collect(),
        vertex_ids: (0..8).collect(),
        vertex_elements: vec![0; 8],
        vertex_local: corners.flat_map(|corner| corner.map(|bit| bit as f32)).collect(),
        quad_ids: vec![0, 2],
        quad_vertices: vec![0, 1, 5, 4, 2, 6, 7, 3],
        quantum_m: 1e-4,
        ..Default::default()
    }
}

fn hash(body: &v1::BodyStructure) -> u64 {
    surface_hash(std::slice::from_ref(body))
}

fn keyframe() -> view_response::Message {
    let body = structure();
    view_response::Message::Keyframe(v1::Keyframe {
        topology_version: 0,
        surface_hash: hash(&body),
        bodies: vec![body],
        ..Default::default()
    })
}

fn patch(behaviour: Behaviour) -> view_response::Message {
    // The other side of the top's link: it becomes a cut.
    let change =
        v1::BodyStructure { node_count: 8, quad_ids: vec![3], quad_vertices: vec![3, 7, 6, 2], ..Default::default() };
    let mut after = structure();
    after.quad_ids.extend(&change.quad_ids);
    after.quad_vertices.extend(&change.quad_vertices);
    view_response::Message::Patch(v1::TopologyPatch {
        from_version: 0,
        to_version: 1,
        bodies: vec![change],
        surface_hash: hash(&after) ^ u64::from(behaviour == Behaviour::WrongHash),
    })
}

fn state(topology_version: u64, step: u64) -> view_response::Message {
    view_response::Message::State(v1::State {
        topology_version,
        step,
        sim_time_s: step as f64 * STEP_S,
        bodies: vec![v1::BodyState { displacements: vec![0, 23].into(), ..Default::default() }],
        has_reference: true,
        late_steps: step / 10,
        profile: Some(v1::StepProfile { steps: 10, step_mean_s: 5e-4, step_max_s: 2e-3, ..Default::default() }),
        ..Default::default()
    })
}

#[tonic::async_trait]
impl ControlService for Server {
    type ControlStream = Pin<Box<dyn Stream<Item = Result<ControlResponse, Status>> + Send>>;

    async fn control(
        &self,
        request: Request<Streaming<ControlRequest>>,
    ) -> Result<Response<Self::ControlStream>, Status> {
        let behaviour = self.behaviour;
        let contacts_left = if behaviour == Behaviour::DropsDriver { 5 } else { usize::MAX };
        let answers = request.into_inner().filter_map(move |up| match up.ok()?.message? {
            control_request::Message::Hello(_) => Some(control_response::Message::Hello(v1::ServerHello {
                protocol_version: kerf_proto::PROTOCOL_VERSION,
                limits: Some(limits()),
                scene: Some(scene()),
                contact_rate_hz: 250.0,
                ..Default::default()
            })),
            control_request::Message::Pose(pose) => Some(answer(&pose, behaviour)),
            control_request::Message::Lift(_) => None,
        });
        let downs = answers.map(|message| Ok(ControlResponse { message: Some(message) })).take(contacts_left);
        Ok(Response::new(Box::pin(downs)))
    }

    async fn send_pose(&self, _: Request<v1::SendPoseRequest>) -> Result<Response<v1::SendPoseResponse>, Status> {
        Err(Status::unimplemented("streams only"))
    }
}

fn answer(pose: &v1::ToolPose, behaviour: Behaviour) -> control_response::Message {
    if behaviour == Behaviour::RejectsPoses && pose.seq.is_multiple_of(5) {
        let (field, limit) = ("pose.position_m.x".to_owned(), "at most 1 m".to_owned());
        return control_response::Message::Rejected(v1::PoseRejected {
            tool_id: pose.tool_id,
            seq: pose.seq,
            field,
            limit,
        });
    }
    let height_m = pose.pose.and_then(|pose| pose.position_m).map_or(1.0, |position_m| position_m.y);
    control_response::Message::Contact(v1::Contact {
        step: pose.seq,
        sim_time_s: pose.seq as f64 * STEP_S,
        echo_seq: pose.seq,
        echo_ns: pose.client_ns,
        // Twice as long as it simulates.
        server_ns: (pose.seq as f64 * 2e9 * STEP_S) as u64,
        lag_ns: LAG_NS,
        wrench: Some(v1::Wrench {
            force_n: Some(vec3(0.0, STIFFNESS_N_PER_M * (TOP_M - height_m).max(0.0), 0.0)),
            torque_nm: Some(vec3(0.0, 0.0, 0.0)),
        }),
        ..Default::default()
    })
}

#[tonic::async_trait]
impl ViewService for Server {
    type ViewStream = ReceiverStream<Result<ViewResponse, Status>>;

    async fn view(&self, _: Request<v1::ViewRequest>) -> Result<Response<Self::ViewStream>, Status> {
        let behaviour = self.behaviour;
        let (events, stream) = tokio::sync::mpsc::channel(1);
        tokio::spawn(async move {
            let hello = view_response::Message::Hello(v1::ViewHello::default());
            let opening = [hello, keyframe(), state(0, 0), state(0, 10), patch(behaviour), state(1, 20)];
            let later = (3u64..).map(|n| state(1, 10 * n));
            for (number, message) in opening.into_iter().chain(later).enumerate() {
                if events.send(Ok(ViewResponse { message: Some(message), number: number as u64 })).await.is_err() {
                    return;
                }
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        });
        Ok(Response::new(ReceiverStream::new(stream)))
    }

    async fn acknowledge(
        &self,
        _: Request<v1::AcknowledgeRequest>,
    ) -> Result<Response<v1::AcknowledgeResponse>, Status> {
        Ok(Response::new(v1::AcknowledgeResponse {}))
    }

    async fn get_interior(
        &self,
        _: Request<v1::GetInteriorRequest>,
    ) -> Result<Response<v1::GetInteriorResponse>, Status> {
        Err(Status::unimplemented("not part of this stand-in"))
    }
}

#[tonic::async_trait]
impl SessionService for Server {
    async fn create_session(
        &self,
        request: Request<v1::CreateSessionRequest>,
    ) -> Result<Response<v1::CreateSessionResponse>, Status> {
        let before = self.created.fetch_add(1, Ordering::Relaxed);
        if self.behaviour == Behaviour::TakesFourSessions && before >= 4 {
            return Err(Status::resource_exhausted("four sessions"));
        }
        match request.into_inner().scene {
            Some(v1::create_session_request::Scene::SceneName(name)) if name == "box" => {
                Ok(Response::new(v1::CreateSessionResponse { session: Some(description()), warnings: Vec::new() }))
            }
            other => Err(Status::not_found(format!("no scene {other:?}"))),
        }
    }

    async fn upload_scene(
        &self,
        _: Request<Streaming<v1::UploadSceneRequest>>,
    ) -> Result<Response<v1::UploadSceneResponse>, Status> {
        Err(Status::unimplemented("not part of this stand-in"))
    }

    type MakeSessionStream = tokio_stream::Once<Result<v1::MakeSessionResponse, Status>>;

    async fn make_session(
        &self,
        request: Request<v1::MakeSessionRequest>,
    ) -> Result<Response<Self::MakeSessionStream>, Status> {
        let asked = request.into_inner().request.unwrap_or_default();
        let created = self.create_session(Request::new(asked)).await?.into_inner();
        let state = Some(v1::make_session_response::State::Created(created));
        Ok(Response::new(tokio_stream::once(Ok(v1::MakeSessionResponse { state }))))
    }

    async fn send_scene_file(
        &self,
        _: Request<v1::SendSceneFileRequest>,
    ) -> Result<Response<v1::SendSceneFileResponse>, Status> {
        Err(Status::unimplemented("not part of this stand-in"))
    }

    async fn describe_session(
        &self,
        _: Request<v1::DescribeSessionRequest>,
    ) -> Result<Response<v1::DescribeSessionResponse>, Status> {
        Ok(Response::new(v1::DescribeSessionResponse { session: Some(description()) }))
    }

    async fn close_session(
        &self,
        _: Request<v1::CloseSessionRequest>,
    ) -> Result<Response<v1::CloseSessionResponse>, Status> {
        Ok(Response::new(v1::CloseSessionResponse { recording: None }))
    }

    async fn list_scenes(&self, _: Request<v1::ListScenesRequest>) -> Result<Response<v1::ListScenesResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn list_sessions(
        &self,
        _: Request<v1::ListSessionsRequest>,
    ) -> Result<Response<v1::ListSessionsResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn pause_session(
        &self,
        _: Request<v1::PauseSessionRequest>,
    ) -> Result<Response<v1::PauseSessionResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn resume_session(
        &self,
        _: Request<v1::ResumeSessionRequest>,
    ) -> Result<Response<v1::ResumeSessionResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn get_scene(&self, _: Request<v1::GetSceneRequest>) -> Result<Response<v1::GetSceneResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn step_session(
        &self,
        _: Request<v1::StepSessionRequest>,
    ) -> Result<Response<v1::StepSessionResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn step_sessions(
        &self,
        _: Request<v1::StepSessionsRequest>,
    ) -> Result<Response<v1::StepSessionsResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn move_session(
        &self,
        _: Request<v1::MoveSessionRequest>,
    ) -> Result<Response<v1::MoveSessionResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn take_session(
        &self,
        _: Request<Streaming<v1::TakeSessionRequest>>,
    ) -> Result<Response<v1::TakeSessionResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn reset_session(
        &self,
        _: Request<v1::ResetSessionRequest>,
    ) -> Result<Response<v1::ResetSessionResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn save_checkpoint(
        &self,
        _: Request<v1::SaveCheckpointRequest>,
    ) -> Result<Response<v1::SaveCheckpointResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn restore_checkpoint(
        &self,
        _: Request<v1::RestoreCheckpointRequest>,
    ) -> Result<Response<v1::RestoreCheckpointResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn list_checkpoints(
        &self,
        _: Request<v1::ListCheckpointsRequest>,
    ) -> Result<Response<v1::ListCheckpointsResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn delete_checkpoint(
        &self,
        _: Request<v1::DeleteCheckpointRequest>,
    ) -> Result<Response<v1::DeleteCheckpointResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    type DownloadCheckpointStream = tokio_stream::Empty<Result<v1::DownloadCheckpointResponse, Status>>;

    async fn download_checkpoint(
        &self,
        _: Request<v1::DownloadCheckpointRequest>,
    ) -> Result<Response<Self::DownloadCheckpointStream>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn upload_checkpoint(
        &self,
        _: Request<tonic::Streaming<v1::UploadCheckpointRequest>>,
    ) -> Result<Response<v1::UploadCheckpointResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn invite_viewer(
        &self,
        _: Request<v1::InviteViewerRequest>,
    ) -> Result<Response<v1::InviteViewerResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }

    async fn seek_replay(&self, _: Request<v1::SeekReplayRequest>) -> Result<Response<v1::SeekReplayResponse>, Status> {
        Err(Status::unimplemented("not asked for here"))
    }
}
