//! Sessions that move from one server to another, each in a process of its own.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use kerf_proto::MOVED_TO;
use kerf_proto::v1;
use kerf_proto::v1::view_service_client::ViewServiceClient;
use tempfile::TempDir;
use tonic::Code;

use super::process::{Process, at, soon};
use super::station::{BACK_WITHIN, feels, touch};

/// A server with a journal.
async fn journaled(folder: &TempDir) -> Process {
    let set = format!("journal_dir={}", folder.path().display());
    Process::serve(&["--set", &set, "--log-filter", "warn"], Stdio::inherit()).await
}

fn url(process: &Process) -> String {
    format!("http://{}", process.address)
}

/// What `kerf-server session move` says.
async fn move_session(process: &Process, session_id: &str, to: String) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    command.args(["session", "--server", &process.address.to_string(), "move", session_id, &to]);
    tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap()
}

fn journals(folder: &Path) -> usize {
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    names.filter(|name| name.to_str().unwrap().ends_with(".mcap")).count()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_station_and_a_viewer_follow_a_session_that_moves_and_its_journal_moves_with_it() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let mut first = journaled(&folders[0]).await;
    let mut second = journaled(&folders[1]).await;
    let session_id = first.create().await.session.unwrap().session_id;
    let mut station = touch(&session_id, url(&first));
    feels(&mut station).await;
    let request = v1::ViewRequest {
        session_id: session_id.clone(),
        protocol_version: kerf_proto::PROTOCOL_VERSION,
        ..Default::default()
    };
    let mut viewer = ViewServiceClient::connect(url(&first)).await.unwrap();
    let mut seen = viewer.view(request).await.unwrap().into_inner();
    let step = first.until(&session_id, |_| true).await.step;

    let began = Instant::now();
    let moved = move_session(&first, &session_id, url(&second)).await;
    let said = String::from_utf8_lossy(&moved.stdout).into_owned();
    assert!(moved.status.success() && said.starts_with(&format!("moved to {} at step ", url(&second))), "{moved:?}");
    second.until(&session_id, |described| described.step > step && described.leased_tool_ids == [0]).await;
    feels(&mut station).await;
    let elapsed = began.elapsed();
    println!("felt again {:.2} s after the session began to move", elapsed.as_secs_f64());
    assert!(elapsed < BACK_WITHIN, "{elapsed:?}; {:?}", station.link());

    let ended = soon("the viewer's end", async {
        loop {
            if let Err(status) = seen.message().await {
                break status;
            }
        }
    });
    let request = v1::DescribeSessionRequest { session_id: session_id.clone() };
    let asked = first.client.describe_session(request).await.unwrap_err();
    for status in [ended.await, asked] {
        let to = status.metadata().get(MOVED_TO).map(|to| to.to_str().unwrap().to_owned());
        assert_eq!((status.code(), to), (Code::NotFound, Some(url(&second))), "{status:?}");
    }
    assert_eq!((journals(folders[0].path()), journals(folders[1].path())), (0, 1));

    // It is the second server's now, which is killed.
    let step = second.until(&session_id, |_| true).await.step;
    tokio::time::sleep(Duration::from_millis(500)).await;
    second.server.kill().unwrap();
    second.server.wait().unwrap();
    let set = format!("journal_dir={}", folders[1].path().display());
    let command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    let mut second =
        Process::start_at(second.address, command, &["--set", &set, "--log-filter", "warn"], Stdio::inherit()).await;
    feels(&mut station).await;
    second.until(&session_id, |described| described.step > step).await;
    tokio::task::spawn_blocking(|| drop(station)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_goes_on_elsewhere_to_the_same_bits_with_its_checkpoints() {
    let mut first = Process::serve(&["--log-filter", "warn"], Stdio::inherit()).await;
    let mut second = Process::serve(&["--log-filter", "warn"], Stdio::inherit()).await;
    let down: Vec<_> = (0..60).map(|i| at(0.012 - 1e-4 * f64::from(i))).collect();
    let (begin, rest) = down.split_at(35);
    let [stays, moves] = [first.stand().await, first.stand().await];
    for session_id in [&stays, &moves] {
        first.step(session_id, begin).await;
        let request = v1::SaveCheckpointRequest { session_id: session_id.clone(), name: "half way".into() };
        first.client.save_checkpoint(request).await.unwrap();
    }
    let moved = move_session(&first, &moves, url(&second)).await;
    assert!(moved.status.success(), "{moved:?}");
    let ends = [first.step(&stays, rest).await.state_hash, second.step(&moves, rest).await.state_hash];
    assert_eq!(ends[0], ends[1]);
    assert_eq!(second.until(&moves, |_| true).await.state(), v1::SessionState::Paused);
    let back = v1::RestoreCheckpointRequest { session_id: moves, name: "half way".into() };
    assert_eq!(second.client.restore_checkpoint(back).await.unwrap().into_inner().step, begin.len() as u64);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_that_is_not_taken_goes_on_where_it_is_and_the_reason_is_told() {
    let mut first = Process::serve(&["--log-filter", "warn"], Stdio::inherit()).await;
    let slow = Process::serve(&["--set", "session.max_rate_hz=100", "--log-filter", "warn"], Stdio::inherit()).await;
    let session_id = first.create().await.session.unwrap().session_id;
    let nobody = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap();
    for (to, why) in [
        (url(&slow), "max_rate_hz"),
        (url(&first), "it is this server"),
        (format!("http://{nobody}"), "refused"),
        (nobody.to_string(), "is not an address as https://NAME:PORT"),
    ] {
        let moved = move_session(&first, &session_id, to.clone()).await;
        let said = String::from_utf8_lossy(&moved.stderr).into_owned();
        assert!(moved.status.code() == Some(1) && said.contains(why), "{to}: {said}");
        let step = first.until(&session_id, |_| true).await.step;
        first.until(&session_id, |described| described.step > step).await;
    }
    let parts = [v1::TakeSessionRequest { session_id: "session-0000002a-7".into(), data: b"no session".into() }];
    let refused = first.client.take_session(futures_util::stream::iter(parts)).await.unwrap_err();
    assert_eq!(refused.code(), Code::FailedPrecondition, "{refused:?}");
    assert!(refused.message().contains("this is no MCAP file"), "{refused:?}");
}
