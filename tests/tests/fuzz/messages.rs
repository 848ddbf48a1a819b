//! Messages of clients, and what clients read.

use std::panic::catch_unwind;
use std::time::Instant;

use kerf_proto::v1;
use kerf_system_tests::readers::messages::{POSES, VIEW, view};
use kerf_system_tests::readers::paths_of;
use prost::Message;
use tonic::Code;

use super::{PATIENCE, fuzz, fuzz_from};
use crate::grpc::harness::Harness;

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
    fuzz(&VIEW);
}

#[test]
fn pose_batches() {
    let runtime = kerf_system_tests::readers::runtime();
    let (harness, session_id) = runtime.block_on(async {
        let mut harness = Harness::start().await;
        let session_id = harness.create().await.expect("a session");
        harness.pause(&session_id).await;
        (harness, session_id)
    });
    fuzz_from(POSES.name, &(POSES.seeds)(), |bytes| {
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
