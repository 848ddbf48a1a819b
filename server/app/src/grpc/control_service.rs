//! Tool poses in, contacts out.

use std::sync::Arc;
use std::time::{Duration, Instant};

use kerf_proto::v1;
use kerf_proto::v1::send_pose_request::Motion;
use kerf_session::clock::MonotonicClock;
use kerf_session::{Driver, PoseRefusal, Registry};
use tonic::{Request, Response, Status, Streaming};

use super::contact_deadband::ContactDeadband;
use super::control_stream::{Contacts, Granted, outgoing, submit};
use super::unary_drivers::UnaryDrivers;
use super::{Outgoing, check_version, grant_rate_hz};
use crate::config::ControlLimits;
use crate::convert::contact::{contact, rejection};
use crate::convert::scene::{limits, scene_summary, state};
use crate::security::caller::Caller;
use crate::status::RequestError;

/// What the protocol says of a client's key.
const MAX_CLIENT_KEY_BYTES: usize = 64;

/// The service.
pub struct ControlService {
    registry: Arc<Registry>,
    limits: ControlLimits,
    unary: Arc<UnaryDrivers>,
}

impl ControlService {
    pub fn new(registry: Arc<Registry>, limits: ControlLimits) -> Self {
        let unary = UnaryDrivers::new(limits.max_unary_drivers, limits.max_pose_rate_hz);
        Self { registry, limits, unary }
    }

    /// The first message, which has to be a hello.
    async fn read_hello(&self, incoming: &mut Streaming<v1::ControlRequest>) -> Result<v1::ClientHello, RequestError> {
        let missing = || RequestError::HelloMissing { limit_s: self.limits.hello_timeout_s };
        let limit = Duration::from_secs_f64(self.limits.hello_timeout_s);
        let first = tokio::time::timeout(limit, incoming.message()).await.map_err(|_| missing())?;
        match first.map_err(|status| RequestError::Transport(Box::new(status)))?.and_then(|up| up.message) {
            Some(v1::control_request::Message::Hello(hello)) => Ok(hello),
            _ => Err(missing()),
        }
    }

    /// A driver, and which contacts it is told.
    fn grant(&self, caller: &Caller, hello: &v1::ClientHello) -> Result<Granted, RequestError> {
        check_version("hello.protocol_version", hello.protocol_version)?;
        if hello.tool_ids.is_empty() {
            return Err(RequestError::Missing { field: "hello.tool_ids" });
        }
        if hello.client_key.len() > MAX_CLIENT_KEY_BYTES {
            return Err(RequestError::ClientKey { bytes: hello.client_key.len(), limit: MAX_CLIENT_KEY_BYTES });
        }
        self.unary.purge();
        let session = caller.session(&self.registry, &hello.session_id)?;
        let tools = session.scene().desc.tools.len();
        if let Some((place, tool)) = hello.tool_ids.iter().enumerate().find(|(_, tool)| **tool as usize >= tools) {
            return Err(RequestError::HelloTool { place, tool: *tool, tools });
        }
        let step_rate_hz = session.scene().desc.rate_hz;
        let max_hz = self.limits.max_contact_rate_hz.min(step_rate_hz);
        let default_hz = self.limits.default_contact_rate_hz;
        let rate_hz = grant_rate_hz("hello.contact_rate_hz", hello.contact_rate_hz, default_hz, max_hz)?;
        let tools: Vec<usize> = hello.tool_ids.iter().map(|tool| *tool as usize).collect();
        let deadband = ContactDeadband::new(hello, self.limits.max_contact_age_s)?;
        let driver = session.drive_as(&hello.client_key, &tools)?;
        let contacts = Contacts::new(step_rate_hz, rate_hz);
        if !hello.without_models {
            driver.ask_for_models(contacts.rate_hz());
        }
        Ok(Granted { driver, contacts, deadband, without_models: hello.without_models })
    }

    fn server_hello(&self, Granted { driver, contacts, .. }: &Granted) -> v1::ControlResponse {
        let session = driver.session();
        let hello = v1::ServerHello {
            protocol_version: kerf_proto::PROTOCOL_VERSION,
            limits: Some(limits(session, &self.limits)),
            scene: Some(scene_summary(session)),
            contact_rate_hz: contacts.rate_hz(),
            server_instance: self.registry.instance().to_string(),
        };
        v1::ControlResponse { message: Some(v1::control_response::Message::Hello(hello)) }
    }

    /// The lease of a unary driver: the one it has, or a new one. Whoever has one was to know of its session.
    fn unary_lease(&self, caller: &Caller, request: &v1::SendPoseRequest, tool: usize) -> Result<String, RequestError> {
        if !request.lease.is_empty() {
            self.unary.with(&request.lease, &request.session_id, |kept| kept.driver.claim(&[tool]))??;
            return Ok(request.lease.clone());
        }
        let session = caller.session(&self.registry, &request.session_id)?;
        self.unary.keep(session.drive(&[tool])?)
    }
}

impl ControlService {
    /// What a tool felt after the newest step, unless that is too long ago.
    fn felt(&self, driver: &Driver, tool: usize) -> Option<v1::Contact> {
        let report = driver.last_report()?;
        let age_s = MonotonicClock::now_ns().saturating_sub(report.ended_ns) as f64 * 1e-9;
        (age_s <= self.limits.max_contact_age_s)
            .then(|| contact(&report, tool, driver.id(), (0, self.limits.default_contact_rate_hz), 0))
    }
}

#[tonic::async_trait]
impl v1::control_service_server::ControlService for ControlService {
    type ControlStream = Outgoing<v1::ControlResponse>;

    async fn control(
        &self,
        request: Request<Streaming<v1::ControlRequest>>,
    ) -> Result<Response<Self::ControlStream>, Status> {
        let caller = Caller::of(request.extensions())?;
        let mut incoming = request.into_inner();
        let hello = self.read_hello(&mut incoming).await?;
        let granted = self.grant(&caller, &hello)?;
        let first = self.server_hello(&granted);
        Ok(Response::new(outgoing(first, granted, incoming, &self.limits)))
    }

    async fn send_pose(&self, request: Request<v1::SendPoseRequest>) -> Result<Response<v1::SendPoseResponse>, Status> {
        let caller = Caller::of(request.extensions())?;
        let request = request.into_inner();
        let motion = request.motion.as_ref().ok_or(RequestError::Missing { field: "motion" })?;
        let (tool_id, seq) = match motion {
            Motion::Pose(pose) => (pose.tool_id, pose.seq),
            Motion::Lift(lift) => (lift.tool_id, 0),
        };
        let tool = tool_id as usize;
        self.unary.purge();
        let lease = self.unary_lease(&caller, &request, tool)?;
        let answer = self.unary.with(&lease, &request.session_id, |kept| {
            let rejected = match motion {
                Motion::Pose(_) => kept.budget.take(tool_id, seq, Instant::now()).err(),
                Motion::Lift(_) => None,
            };
            let moved = || move_tool(&kept.driver, motion).map_err(|refusal| rejection(tool_id, seq, &refusal));
            let rejected = rejected.or_else(|| moved().err());
            v1::SendPoseResponse {
                lease: lease.clone(),
                contact: self.felt(&kept.driver, tool),
                rejected,
                state: state(&kept.driver.session().phase()).into(),
            }
        })?;
        Ok(Response::new(answer))
    }
}

fn move_tool(driver: &Driver, motion: &Motion) -> Result<(), PoseRefusal> {
    match motion {
        Motion::Pose(pose) => submit(driver, pose),
        Motion::Lift(lift) => driver.lift(lift.tool_id as usize),
    }
}
