//! Requests of a released client, byte for byte, as proto/vectors/<version>/requests.bin has them: whatever becomes of the
//! protocol, a server takes them.
//!
//! Entries follow each other: a call and its message, each behind its length in bytes, an unsigned 32-bit integer, lowest
//! byte first. Messages to one stream stand together. A session has the id `session-00000000-0` there.

use std::path::PathBuf;

use kerf_proto::v1::{self, control_request, create_session_request, tool_motion};
use kerf_proto::{PROTOCOL_VERSION, v1::view_response};
use prost::Message;
use prost::bytes::{Buf, BufMut};
use tonic::codec::{Codec, DecodeBuf, Decoder, EncodeBuf, Encoder};
use tonic::codegen::http::uri::PathAndQuery;
use tonic::{Request, Status};

use super::harness::{BLOCK, Harness, soon};

/// What stands for the id of the session.
const SESSION: &str = "session-00000000-0";
const CONTROL: &str = "kerf.v1.ControlService/Control";
const VIEW: &str = "kerf.v1.ViewService/View";

fn file() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../proto/vectors/0.1/requests.bin"))
}

/// Messages as they are on the wire.
#[derive(Clone, Copy, Default)]
struct Raw;

impl Codec for Raw {
    type Encode = Vec<u8>;
    type Decode = Vec<u8>;
    type Encoder = Self;
    type Decoder = Self;

    fn encoder(&mut self) -> Self {
        *self
    }

    fn decoder(&mut self) -> Self {
        *self
    }
}

impl Encoder for Raw {
    type Item = Vec<u8>;
    type Error = Status;

    fn encode(&mut self, message: Vec<u8>, into: &mut EncodeBuf<'_>) -> Result<(), Status> {
        into.put_slice(&message);
        Ok(())
    }
}

impl Decoder for Raw {
    type Item = Vec<u8>;
    type Error = Status;

    fn decode(&mut self, from: &mut DecodeBuf<'_>) -> Result<Option<Vec<u8>>, Status> {
        Ok(Some(from.copy_to_bytes(from.remaining()).to_vec()))
    }
}

/// What a client of the present version sends in a session: all that one drives, watches and keeps by.
fn of_today() -> Vec<(&'static str, Vec<u8>)> {
    let session_id = || SESSION.to_owned();
    let name = || "kept".to_owned();
    let pose_at = |height_m: f32| {
        let position_m = Some(v1::Vec3 { x: 0.0, y: height_m, z: 4e-4 });
        let pose = v1::Pose { position_m, orientation: Some(v1::Quat { w: 1.0, ..Default::default() }) };
        v1::ToolPose { pose: Some(pose), opening: Some(1.0), seq: 1, ..Default::default() }
    };
    let at = |height_m| v1::StepInput {
        motions: vec![v1::ToolMotion { motion: Some(tool_motion::Motion::Pose(pose_at(height_m))) }],
    };
    let inputs = (0..60).map(|step| at(0.012 - 2e-4 * step as f32)).collect();
    let lift = v1::ToolMotion { motion: Some(tool_motion::Motion::Lift(v1::LiftTool::default())) };
    let hello = v1::ClientHello {
        protocol_version: PROTOCOL_VERSION,
        session_id: session_id(),
        tool_ids: vec![0],
        ..Default::default()
    };
    let control = |message| v1::ControlRequest { message: Some(message), received: 0 }.encode_to_vec();
    let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
    let create = v1::CreateSessionRequest { scene, start_paused: true, ..Default::default() };
    let view = v1::ViewRequest {
        protocol_version: PROTOCOL_VERSION,
        session_id: session_id(),
        rate_hz: 30.0,
        ..Default::default()
    };
    let step = |inputs: Vec<v1::StepInput>| v1::StepSessionRequest {
        session_id: session_id(),
        steps: inputs.len().max(1) as u32,
        inputs,
    };
    vec![
        ("kerf.v1.SessionService/ListScenes", v1::ListScenesRequest::default().encode_to_vec()),
        ("kerf.v1.SessionService/CreateSession", create.encode_to_vec()),
        ("kerf.v1.SessionService/ListSessions", v1::ListSessionsRequest::default().encode_to_vec()),
        (
            "kerf.v1.SessionService/DescribeSession",
            v1::DescribeSessionRequest { session_id: session_id() }.encode_to_vec(),
        ),
        (VIEW, view.encode_to_vec()),
        ("kerf.v1.SessionService/StepSession", step(inputs).encode_to_vec()),
        (
            "kerf.v1.SessionService/SaveCheckpoint",
            v1::SaveCheckpointRequest { session_id: session_id(), name: name() }.encode_to_vec(),
        ),
        ("kerf.v1.SessionService/StepSession", step(vec![v1::StepInput { motions: vec![lift] }]).encode_to_vec()),
        (
            "kerf.v1.SessionService/RestoreCheckpoint",
            v1::RestoreCheckpointRequest { session_id: session_id(), name: name() }.encode_to_vec(),
        ),
        (
            "kerf.v1.SessionService/ListCheckpoints",
            v1::ListCheckpointsRequest { session_id: session_id() }.encode_to_vec(),
        ),
        ("kerf.v1.SessionService/ResetSession", v1::ResetSessionRequest { session_id: session_id() }.encode_to_vec()),
        ("kerf.v1.SessionService/ResumeSession", v1::ResumeSessionRequest { session_id: session_id() }.encode_to_vec()),
        (CONTROL, control(control_request::Message::Hello(hello))),
        (CONTROL, control(control_request::Message::Pose(pose_at(0.02)))),
        ("kerf.v1.SessionService/PauseSession", v1::PauseSessionRequest { session_id: session_id() }.encode_to_vec()),
        ("kerf.v1.SessionService/CloseSession", v1::CloseSessionRequest { session_id: session_id() }.encode_to_vec()),
    ]
}

fn written(entries: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let behind_length = |bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), bytes].concat();
    entries
        .iter()
        .flat_map(|(call, message)| [behind_length(call.as_bytes()), behind_length(message)])
        .flatten()
        .collect()
}

fn read(mut file: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut next = || {
        let (length, rest) = file.split_first_chunk()?;
        let (bytes, rest) = rest.split_at(u32::from_le_bytes(*length) as usize);
        file = rest;
        Some(bytes.to_vec())
    };
    std::iter::from_fn(|| Some((String::from_utf8(next()?).expect("a name"), next()?))).collect()
}

/// A message with the id of a session in the place of what stands for one: as long, so that no length changes.
fn of_session(message: &[u8], session_id: &str) -> Vec<u8> {
    let mut message = message.to_vec();
    if let Some(at) = message.windows(SESSION.len()).position(|bytes| bytes == SESSION.as_bytes()) {
        message[at..at + SESSION.len()].copy_from_slice(session_id.as_bytes());
    }
    message
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_takes_what_a_client_of_the_last_minor_version_sent() {
    if std::env::var_os("KERF_WRITE_REQUESTS").is_some() {
        std::fs::create_dir_all(file().parent().expect("a folder")).expect("a folder");
        std::fs::write(file(), written(&of_today())).expect("writable");
    }
    let entries = read(&std::fs::read(file()).expect("the recorded requests"));
    let harness = Harness::start().await;
    let mut session_id = SESSION.to_owned();
    let mut views = Vec::new();
    let mut taken = 0;
    for together in entries.chunk_by(|(call, _), (next, _)| call == next && call == CONTROL) {
        let call = together[0].0.as_str();
        let messages: Vec<_> = together.iter().map(|(_, message)| of_session(message, &session_id)).collect();
        let mut client = tonic::client::Grpc::new(harness.channel.clone());
        client.ready().await.expect("a connection");
        let path: PathAndQuery = format!("/{call}").parse().expect("a path");
        match call {
            CONTROL => {
                // It stays open until something has come back.
                let sent = tokio_stream::StreamExt::chain(tokio_stream::iter(messages), tokio_stream::pending());
                let mut heard = client.streaming(Request::new(sent), path, Raw).await.expect(call).into_inner();
                for _ in 0..2 {
                    let answer = soon(call, heard.message()).await.expect(call).expect("an answer");
                    v1::ControlResponse::decode(&answer[..]).expect("an answer");
                }
            }
            VIEW => {
                let [request] = <[_; 1]>::try_from(messages).expect("one request");
                let seen = client.server_streaming(Request::new(request), path, Raw).await;
                let mut seen = seen.expect(call).into_inner();
                let first = soon(call, seen.message()).await.expect(call).expect("a message");
                let first = v1::ViewResponse::decode(&first[..]).expect("a message").message;
                assert!(matches!(first, Some(view_response::Message::Hello(_))), "{first:?}");
                views.push(seen);
            }
            _ => {
                let [request] = <[_; 1]>::try_from(messages).expect("one request");
                let answer = client.unary(Request::new(request), path, Raw).await.expect(call).into_inner();
                if call.ends_with("/CreateSession") {
                    let created = v1::CreateSessionResponse::decode(&answer[..]).expect("an answer");
                    session_id = created.session.expect("a session").session_id;
                    assert_eq!(session_id.len(), SESSION.len());
                }
            }
        }
        taken += together.len();
    }
    assert!(taken == entries.len() && taken > 15, "{taken} of {}", entries.len());
}
