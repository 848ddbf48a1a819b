//! Sessions whose clients go away while they are made.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use kerf_proto::v1;
use kerf_proto::v1::create_session_request::Scene;

use super::harness::{BLOCK, Harness, soon};

/// Keeps a blocking thread of the runtime busy until it is let go, or its sender is dropped.
fn keep_busy() -> Sender<()> {
    let (release, busy): (_, Receiver<()>) = channel();
    tokio::task::spawn_blocking(move || busy.recv());
    release
}

/// One blocking thread, which is kept busy, holds the server where it is about to record the session that it has made.
#[test]
fn a_session_whose_client_goes_away_before_it_is_told_of_it_is_closed() {
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    let runtime = runtime.worker_threads(2).max_blocking_threads(1).enable_all().build().unwrap();
    runtime.block_on(async {
        let folder = tempfile::tempdir().unwrap();
        let harness = Harness::with(|config| config.record_dir = Some(folder.path().into())).await;
        let registry = harness.server.registry();
        let sessions_become = async |count: usize| {
            while registry.list().len() != count {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        let first = keep_busy();
        let (mut sessions, scene) = (harness.sessions.clone(), Some(Scene::SceneToml(BLOCK.into())));
        let creating = tokio::spawn(async move {
            sessions.create_session(v1::CreateSessionRequest { scene, ..Default::default() }).await
        });
        // The scene waits to be read, and what is recorded will wait after it.
        tokio::time::sleep(Duration::from_secs(2)).await;
        let _second = keep_busy();
        drop(first);
        soon("the session", sessions_become(1)).await;
        assert!(!creating.is_finished(), "its client has not been told of it");
        creating.abort();
        soon("its end", sessions_become(0)).await;
    });
}
