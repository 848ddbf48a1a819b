//! Messages of clients, and what clients read.

use std::panic::catch_unwind;
use std::time::Instant;

use kerf_proto::MAX_MESSAGE_BYTES;
use kerf_proto::v1::{self, ViewResponse, tool_motion};
use kerf_replica::{Assembler, Body, Replica};
use prost::Message;
use tonic::Code;

use super::{PATIENCE, fuzz, inputs_of, messages_of, paths_of};
use crate::grpc::harness::Harness;

/// What a viewer does with a file of messages, each behind its length; answers with how many it refuses.
fn view(file: &[u8]) -> usize {
    let (mut assembler, mut replica) = (Assembler::default(), Replica::default());
    let mut refused = 0;
    for message in messages_of(file) {
        let Some(whole) = ViewResponse::decode(message).ok().and_then(|part| assembler.take(part).ok()) else {
            refused += 1;
            continue;
        };
        let Some(message) = whole.and_then(|whole| whole.message) else { continue };
        match replica.apply(&message) {
            Ok(()) => drop(replica.surfaces()),
            Err(error) => {
                assert!(!error.to_string().is_empty());
                refused += 1;
            }
        }
        let nodes: usize = replica.bodies().iter().map(Body::node_slots).sum();
        assert!(nodes <= MAX_MESSAGE_BYTES / 12, "{nodes} nodes");
    }
    refused
}

#[test]
fn views_that_every_client_replays() {
    for path in paths_of("corpus/views", ".bin") {
        let (path, file) = (path.display().to_string(), std::fs::read(&path).expect("readable"));
        let began = Instant::now();
        let refused = catch_unwind(|| view(&file)).unwrap_or_else(|_| panic!("{path}"));
        assert!(refused == 0 || !path.ends_with("sound.bin"), "{path}: {refused} messages are refused");
        assert!(began.elapsed() < PATIENCE, "{path}: {:?}", began.elapsed());
    }
}

#[test]
fn views() {
    let mut corpus = inputs_of("../proto/vectors", ".bin");
    corpus.extend(inputs_of("corpus/views", ".bin"));
    fuzz("view", &corpus, |file| {
        view(file);
    });
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
