//! Messages of clients, and what clients read.

use std::sync::{Arc, LazyLock};

use kerf_proto::MAX_MESSAGE_BYTES;
use kerf_proto::v1::{self, ViewResponse, tool_motion};
use kerf_replica::{Assembler, Body, Replica};
use kerf_server::wire::steps;
use kerf_session::{Phase, Registry, Session, SessionOptions};
use prost::Message;
use tokio::runtime::Runtime;

use super::{Reader, block, inputs_of, runtime};

/// What viewers are sent.
pub const VIEW: Reader = Reader {
    name: "view",
    seeds: || [inputs_of("../proto/vectors", ".bin"), inputs_of("corpus/views", ".bin")].concat(),
    read: |file| {
        let _refused = view(file);
    },
};

/// Steps of a session, in one call.
pub const POSES: Reader = Reader {
    name: "poses",
    seeds: || {
        let with_motions = v1::StepSessionRequest { steps: 9, inputs: motions(), ..Default::default() };
        let without = v1::StepSessionRequest { steps: 3, ..Default::default() };
        vec![with_motions.encode_to_vec(), without.encode_to_vec()]
    },
    read: |bytes| {
        let Ok(request) = v1::StepSessionRequest::decode(bytes) else { return };
        let (runtime, session) = &*PAUSED;
        let Ok(steps) = steps(&request, &session.limits().pose) else { return };
        runtime.block_on(async {
            session.reset().await.expect("the session lives");
            drop(session.step(steps).await);
            let status = session.describe().await.expect("the session lives");
            assert_eq!(status.phase, Phase::Paused);
            assert!(status.energy.residual_j.is_finite(), "{status:?}");
        });
    },
};

/// A session that waits for calls.
static PAUSED: LazyLock<(Runtime, Arc<Session>)> = LazyLock::new(|| {
    let runtime = runtime();
    let session = runtime.block_on(async {
        let registry = Registry::new(Default::default(), Default::default()).expect("limits");
        let session = registry.create(block(), SessionOptions::default()).await.expect("a session");
        session.pause().await.expect("a pause");
        session
    });
    (runtime, session)
});

/// What a viewer does with a file of messages, each behind its length; answers with how many it refuses.
///
/// # Panics
/// It takes more memory than messages may ask for.
#[must_use]
pub fn view(file: &[u8]) -> usize {
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

/// The messages of a file, each behind its length; of one that ends too soon what there is.
#[must_use]
pub fn messages_of(mut file: &[u8]) -> Vec<&[u8]> {
    let mut messages = Vec::new();
    while let Some((length, rest)) = file.split_first_chunk::<4>() {
        let (message, rest) = rest.split_at(rest.len().min(u32::from_le_bytes(*length) as usize));
        messages.push(message);
        file = rest;
    }
    messages
}

/// Steps of a tool that cuts, and is lifted.
#[must_use]
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
