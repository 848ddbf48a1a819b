//! Servers that are killed in mid-cut, and what the next one brings back.

use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use kerf_physics::Workers;
use kerf_proto::v1;
use kerf_proto::v1::view_response::Message;
use kerf_server::journal::past;
use kerf_server::recording::reader::{Ending, Recording};
use kerf_server::recording::verify::verify;

use super::process::{Process, at, soon};

/// More than the 60 ms that a kill may lose: the machine has other things to do.
const LOST_S: f64 = 1.0;

async fn serve(folder: &Path) -> Process {
    let set = format!("journal_dir={}", folder.display());
    Process::serve(&["--set", &set, "--log-filter", "warn"], Stdio::inherit()).await
}

/// Down through the block.
fn stroke() -> Vec<v1::StepInput> {
    (0..90).map(|step| at(0.012 - 2e-4 * f64::from(step))).collect()
}

async fn sessions(process: &mut Process) -> Vec<String> {
    let listed = process.client.list_sessions(v1::ListSessionsRequest::default()).await.unwrap().into_inner();
    listed.sessions.into_iter().map(|session| session.session_id).collect()
}

fn files(folder: &Path) -> Vec<std::path::PathBuf> {
    let found = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    found.filter(|path| path.extension().is_some_and(|extension| extension == "mcap")).collect()
}

/// Waits until the journal in a folder leads to a step.
async fn until_written(folder: &Path, until: u64) {
    let is_written = || past::read(&files(folder)).is_ok_and(|(_, past)| past.last_step() == Some(until));
    soon("the step in the journal", async {
        while !is_written() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
}

fn kill(process: &mut Process) {
    process.server.kill().unwrap();
    process.server.wait().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_killed_servers_session_is_back_under_its_id_with_its_state_and_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let stroke = stroke();
    let (first, rest) = stroke.split_at(60);
    let mut unharmed = serve(&folder.path().join("unharmed")).await;
    let session = unharmed.stand().await;
    unharmed.step(&session, first).await;
    let expected = unharmed.step(&session, rest).await;

    let killed = folder.path().join("killed");
    let mut process = serve(&killed).await;
    let session = process.stand().await;
    let before = process.step(&session, first).await;
    until_written(&killed, first.len() as u64).await;
    for _ in 0..3 {
        kill(&mut process);
        let left = files(&killed);
        let began = Instant::now();
        process = serve(&killed).await;
        let back = process.until(&session, |_| true).await;
        println!("the session is back after {:.2} s", began.elapsed().as_secs_f64());
        assert_eq!(sessions(&mut process).await, std::slice::from_ref(&session));
        assert_eq!((back.step, back.state_hash), (first.len() as u64, before.state_hash));
        assert_eq!(back.state, i32::from(v1::SessionState::Paused));
        soon("a file of its own in the place of the one that was left", async {
            while files(&killed).len() != 1 || files(&killed) == left {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        })
        .await;
    }
    let after = process.step(&session, rest).await;
    assert_eq!((after.state_hash, after.topology_version), (expected.state_hash, expected.topology_version));
    assert!(after.state_hash != before.state_hash);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_that_runs_loses_a_moment_to_a_kill_and_its_journal_verifies() {
    let folder = tempfile::tempdir().unwrap();
    let mut process = serve(folder.path()).await;
    let session = process.create().await.session.unwrap().session_id;
    let step = process.until(&session, |described| described.step > 1500).await.step;
    kill(&mut process);
    let newest = files(folder.path()).into_iter().max().unwrap();
    let mut recording = Recording::open(&newest).unwrap();
    assert_eq!(recording.ending(), Ending::CutOff);
    verify(&mut recording, &Workers::serial(), |_| ()).unwrap();

    let mut process = serve(folder.path()).await;
    let back = process.until(&session, |described| described.step > 0).await;
    assert!(back.step as f64 > step as f64 - LOST_S * 500.0, "{} of {step} steps", back.step);
    // It runs on by itself, and goes with its journal when it is closed.
    process.until(&session, |described| described.step > step + 100).await;
    let request = v1::CloseSessionRequest { session_id: session };
    process.client.close_session(request).await.unwrap();
    assert!(files(folder.path()).is_empty(), "{:?}", files(folder.path()));
    kill(&mut process);
    assert!(sessions(&mut serve(folder.path()).await).await.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_is_stopped_leaves_its_sessions_to_the_next_and_no_other_takes_them_meanwhile() {
    let folder = tempfile::tempdir().unwrap();
    let mut process = serve(folder.path()).await;
    let session = process.stand().await;
    let before = process.step(&session, &stroke()).await;
    let set = format!("journal_dir={}", folder.path().display());
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    let second = command.args(["serve", "--listen", "127.0.0.1:0", "--set", &set]).output().unwrap();
    let said = String::from_utf8_lossy(&second.stderr).into_owned();
    assert!(!second.status.success() && said.contains("the folder of another server"), "{said}");
    let request = v1::ViewRequest {
        protocol_version: kerf_proto::PROTOCOL_VERSION,
        session_id: session.clone(),
        ..Default::default()
    };
    let address = format!("http://{}", process.address);
    let mut viewer = v1::view_service_client::ViewServiceClient::connect(address).await.unwrap();
    let mut seen = viewer.view(request).await.unwrap().into_inner();
    while !matches!(soon("a keyframe", seen.message()).await.unwrap().unwrap().message, Some(Message::Keyframe(_))) {}
    assert!(process.stop().success());
    // The stream breaks, and does not tell that the session ends: the viewer looks for it.
    let end = soon("the end", async {
        loop {
            match seen.message().await {
                Ok(Some(v1::ViewResponse { message: Some(Message::Event(event)), .. })) => panic!("{event:?}"),
                Ok(Some(_)) => {}
                end => break end,
            }
        }
    });
    assert!(end.await.is_err());
    let mut process = serve(folder.path()).await;
    assert_eq!(process.until(&session, |_| true).await.state_hash, before.state_hash);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_damaged_journal_is_refused_by_name_and_harms_no_other_session() {
    let folder = tempfile::tempdir().unwrap();
    let mut process = serve(folder.path()).await;
    let (damaged, whole) = (process.stand().await, process.stand().await);
    for session in [&damaged, &whole] {
        process.step(session, &stroke()).await;
    }
    tokio::time::sleep(Duration::from_millis(500)).await;
    kill(&mut process);
    let path = files(folder.path()).into_iter().find(|path| path.to_string_lossy().contains(&damaged)).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(&path, bytes).unwrap();
    let log = tempfile::NamedTempFile::new().unwrap();
    let set = format!("journal_dir={}", folder.path().display());
    let mut process = Process::serve(&["--set", &set], log.reopen().unwrap()).await;
    process.until(&whole, |_| true).await;
    let aside = folder.path().join("refused").join(path.file_name().unwrap());
    let is_aside = async {
        while !aside.exists() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    soon("the file where it can be looked at", is_aside).await;
    assert_eq!(sessions(&mut process).await, [whole]);
    let said = std::fs::read_to_string(log.path()).unwrap();
    assert!(said.contains("does not come back") && said.contains(&damaged), "{said}");
    assert!(!path.exists(), "it takes nothing of the quota");
}

#[tokio::test(flavor = "multi_thread")]
async fn many_cut_sessions_come_back_each_as_soon_as_it_can() {
    let folder = tempfile::tempdir().unwrap();
    let mut process = serve(folder.path()).await;
    let mut before = Vec::new();
    for _ in 0..8 {
        let session = process.stand().await;
        let state_hash = process.step(&session, &stroke()).await.state_hash;
        before.push((session, state_hash));
    }
    tokio::time::sleep(Duration::from_millis(300)).await;
    kill(&mut process);
    let began = Instant::now();
    let mut process = serve(folder.path()).await;
    println!("the next server answers after {:.2} s", began.elapsed().as_secs_f64());
    for (session, state_hash) in &before {
        assert_eq!(process.until(session, |_| true).await.state_hash, *state_hash, "{session}");
        println!("{session} is back after {:.2} s", began.elapsed().as_secs_f64());
    }
    assert_eq!(sessions(&mut process).await.len(), before.len());
}
