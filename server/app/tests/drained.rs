//! A server that is told to stop while sessions run, and lets them end.

use std::process::Stdio;

use kerf_proto::v1::{self, create_session_request};
use tonic::Code;

use super::process::{BLOCK, Process, at, soon};

#[tokio::test(flavor = "multi_thread")]
async fn the_first_signal_lets_sessions_end_and_the_second_ends_them() {
    let set = ["--set", "session.drain_s=600", "--log-filter", "warn"];
    let mut process = Process::serve(&set, Stdio::inherit()).await;
    let session_id = process.stand().await;
    process.signal("-TERM");
    let refused = soon("a refusal", async {
        loop {
            let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
            match process.client.create_session(v1::CreateSessionRequest { scene, ..Default::default() }).await {
                // The signal has yet to come.
                Ok(created) => {
                    let session_id = created.into_inner().session.unwrap().session_id;
                    process.client.close_session(v1::CloseSessionRequest { session_id }).await.unwrap();
                }
                Err(refused) => break refused,
            }
        }
    });
    let refused = refused.await;
    assert!(refused.code() == Code::Unavailable && refused.message().contains("session.drain_s"), "{refused}");
    assert_eq!(process.step(&session_id, &[at(0.02)]).await.outcomes.len(), 1, "it goes on");
    assert!(process.stop().success());
}
