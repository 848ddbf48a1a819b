//! Messages of clients, and what clients read.

use kerf_proto::v1::{self, ViewResponse, tool_motion};
use kerf_replica::{Assembler, Replica};
use prost::Message;
use tonic::Code;

use super::fuzz;
use crate::grpc::harness::Harness;

/// What a viewer does with a file of messages, each behind its length.
fn view(mut file: &[u8]) {
    let (mut assembler, mut replica) = (Assembler::default(), Replica::default());
    while let Some((length, rest)) = file.split_first_chunk::<4>() {
        let (message, rest) = rest.split_at(rest.len().min(u32::from_le_bytes(*length) as usize));
        file = rest;
        let whole = ViewResponse::decode(message).ok().and_then(|part| assembler.take(part).ok().flatten());
        let Some(message) = whole.and_then(|whole| whole.message) else { continue };
        match replica.apply(&message) {
            Ok(()) => drop(replica.surfaces()),
            Err(refused) => assert!(!refused.to_string().is_empty()),
        }
    }
}

#[test]
fn views() {
    let vectors = ["cut.bin", "cut-vertices.bin"].map(|name| {
        let path = format!("{}/../proto/vectors/{name}", env!("CARGO_MANIFEST_DIR"));
        std::fs::read(path).expect("the vectors of the protocol")
    });
    fuzz("view", &vectors, view);
}

pub fn motions() -> Vec<v1::StepInput> {
    let at = |step: u32| {
        let position_m = Some(v1::Vec3 { x: 0.0, y: 0.012 - 1e-3 * step as f32, z: 4e-4 });
        let pose = v1::Pose { position_m, orientation: Some(v1::Quat { w: 1.0, ..Default::default() }) };
        tool_motion::Motion::Pose(v1::ToolPose {
            pose: Some(pose),
            opening: Some(0.5),
            seq: step.into(),
            ..Default::default()
        })
    };
    let lift = tool_motion::Motion::Lift(v1::LiftTool { tool_id: 1 });
    let motion = |motion| v1::StepInput { motions: vec![v1::ToolMotion { motion: Some(motion) }] };
    (0..8).map(at).chain([lift]).map(motion).collect()
}

#[test]
fn pose_batches() {
    let runtime =
        tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(1).build().expect("a runtime");
    let (harness, session_id) = runtime.block_on(async {
        let mut harness = Harness::start().await;
        let session_id = harness.create().await.expect("a session");
        harness.pause(&session_id).await;
        (harness, session_id)
    });
    let request = v1::StepSessionRequest { session_id: session_id.clone(), steps: 9, inputs: motions() };
    let before = v1::StepSessionRequest { session_id: session_id.clone(), steps: 3, inputs: Vec::new() };
    fuzz("poses", &[request.encode_to_vec(), before.encode_to_vec()], |bytes| {
        let Ok(request) = v1::StepSessionRequest::decode(bytes) else { return };
        let request = v1::StepSessionRequest { session_id: session_id.clone(), ..request };
        runtime.block_on(async {
            let mut sessions = harness.sessions.clone();
            if let Err(refused) = sessions.step_session(request).await {
                assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
            }
            let request = v1::DescribeSessionRequest { session_id: session_id.clone() };
            let described = sessions.describe_session(request).await.expect("the session lives").into_inner().session;
            let described = described.expect("a description");
            assert_eq!(described.state(), v1::SessionState::Paused, "{}", described.failure);
            // What was asked for in words that the server takes is no fault, and none leaves numbers behind that are none.
            assert!(described.energy.is_some_and(|energy| energy.residual_j.is_finite()), "{described:?}");
        });
    });
}
