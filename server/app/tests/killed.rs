//! A server that is killed leaves recordings that are whole but for the last moment.

use std::process::{Command, Stdio};

use kerf_physics::Workers;
use kerf_server::recording::reader::{Ending, Recording};
use kerf_server::recording::verify::verify;

use super::process::Process;

/// More than a chunk's half second: the machine has other things to do.
const LOST_S: f64 = 1.0;

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_ends_shortly_before_its_server_was_killed_and_verifies() {
    let folder = tempfile::tempdir().unwrap();
    let set = format!("record_dir={}", folder.path().display());
    let mut process = Process::serve(&["--set", &set, "--log-filter", "warn"], Stdio::inherit()).await;
    let created = process.create().await;
    assert!(created.warnings.iter().all(|warning| !warning.contains("record")), "{:?}", created.warnings);
    let session_id = created.session.unwrap().session_id;
    let step = process.until(&session_id, |described| described.step > 1000).await.step;
    process.server.kill().unwrap();
    process.server.wait().unwrap();

    let path = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    let mut recording = Recording::open(&path).unwrap();
    assert_eq!(recording.ending(), Ending::CutOff);
    let verified = verify(&mut recording, &Workers::serial(), |_| ()).unwrap();
    assert!(verified.steps as f64 > step as f64 - LOST_S * 500.0, "{verified:?} of {step} steps");

    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    let output = command.arg("replay").arg(&path).arg("--verify").output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && said.contains("every state is as recorded"), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("to its last whole chunk"), "{output:?}");

    // The length of the record after the file's own head: what follows is whole.
    let mut damaged = std::fs::read(&path).unwrap();
    let second = 8 + 9 + damaged[9] as usize;
    damaged[second + 4] ^= 0x40;
    std::fs::write(&path, damaged).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    let output = command.arg("replay").arg(&path).arg("--verify").output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("a whole chunk follows"), "{output:?}");
}
