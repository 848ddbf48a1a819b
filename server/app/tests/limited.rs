//! A server that its system allows little: it does less, and lives.

use std::fs::File;
use std::path::Path;
use std::process::{Command, Stdio};

use kerf_physics::Workers;
use kerf_proto::v1::{self, create_session_request};
use kerf_server::recording::reader::Recording;
use kerf_server::recording::verify::verify;
use tonic::Code;

use super::process::{BLOCK, Process, soon};

/// A server under a limit of the shell's `ulimit`.
async fn limited(limit: &str, arguments: &[&str], stderr: impl Into<Stdio>) -> Process {
    let mut shell = Command::new("sh");
    let script = format!("ulimit {limit} && exec \"$0\" \"$@\"");
    shell.args(["-c", &script, env!("CARGO_BIN_EXE_kerf-server")]);
    Process::start(shell, arguments, stderr).await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_limit_on_the_size_of_files_ends_the_recording_and_neither_session_nor_server() {
    let folder = tempfile::tempdir().unwrap();
    let set = format!("record_dir={}", folder.path().display());
    let mut process = limited("-f 128", &["--set", &set], Stdio::null()).await;
    let session_id = process.create().await.session.unwrap().session_id;
    let recording = |described: &v1::SessionDescription| described.recording.clone().unwrap_or_default();
    let described = process.until(&session_id, |described| recording(described).is_cut_off).await;
    let told = recording(&described);
    assert!(told.error.contains("file too large") && told.steps > 0, "{told:?}");
    process.until(&session_id, |now| now.step > described.step + 100).await;
    assert!(process.stop().success());

    let mut recording = Recording::open(&folder.path().join(told.file)).unwrap();
    let verified = verify(&mut recording, &Workers::serial(), |_| ()).unwrap();
    assert_eq!(verified.steps, told.steps);
}

/// Waits until a session's journal has ended, and looks at who says so.
async fn a_journal_ends_before_its_session(mut process: Process, folder: &Path, expected: &str) {
    let session_id = process.create().await.session.unwrap().session_id;
    let error = |described: &v1::SessionDescription| described.journal.clone().unwrap_or_default().error;
    let described = process.until(&session_id, |described| !error(described).is_empty()).await;
    assert!(error(&described).contains(expected), "{described:?}");
    process.until(&session_id, |now| now.step > described.step + 100).await;
    let mut top = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    let top = top.args(["top", "--once", "--server", &process.address.to_string()]).output().unwrap();
    assert!(String::from_utf8_lossy(&top.stdout).contains("ENDED"), "{top:?}");
    let log = std::fs::read_to_string(folder.join("log")).unwrap();
    assert!(log.contains("the journal has ended before its session") && log.contains(expected), "{log}");
    assert!(process.stop().success());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_limit_on_the_size_of_files_ends_the_journal_and_not_the_session() {
    let folder = tempfile::tempdir().unwrap();
    let set = format!("journal_dir={}", folder.path().join("journals").display());
    let log = File::create(folder.path().join("log")).unwrap();
    let process = limited("-f 16", &["--set", &set], log).await;
    a_journal_ends_before_its_session(process, folder.path(), "file too large").await;
}

/// On a file system of its own in memory, where the kernel lets users have one.
#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk_ends_the_journal_and_not_the_session() {
    let folder = tempfile::tempdir().unwrap();
    let journals = folder.path().join("journals");
    std::fs::create_dir(&journals).unwrap();
    let mount = format!("mount -t tmpfs -o size=24k none {}", journals.display());
    let within = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--user", "--map-root-user", "--mount", "sh", "-c", script]);
        command
    };
    if !within(&mount).status().is_ok_and(|status| status.success()) {
        println!("skipped: users may not mount anything here");
        return;
    }
    let mut shell = within(&format!("{mount} && exec \"$0\" \"$@\""));
    shell.arg(env!("CARGO_BIN_EXE_kerf-server"));
    let set = format!("journal_dir={}", journals.display());
    let process = Process::start(shell, &["--set", &set], File::create(folder.path().join("log")).unwrap()).await;
    a_journal_ends_before_its_session(process, folder.path(), "no space left").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_limit_on_the_address_space_refuses_sessions_and_ends_nothing() {
    // Of 1.4 GiB; a session's estimate is 80 MiB.
    let settings = ["--set", "session.max_sessions=64", "--set", "session.max_load=1000"];
    let mut process = limited("-v 1500000", &settings, Stdio::null()).await;
    let scene_toml = BLOCK.replace("resolution = 6", "resolution = 20").replace("level = 1", "level = 0");
    let scene = Some(create_session_request::Scene::SceneToml(scene_toml));
    let request = v1::CreateSessionRequest { scene, start_paused: true, ..Default::default() };
    let mut sessions = Vec::new();
    let refused = loop {
        match soon("a session", process.client.create_session(request.clone())).await {
            Ok(created) => sessions.push(created.into_inner().session.unwrap().session_id),
            Err(refused) => break refused,
        }
    };
    assert_eq!(refused.code(), Code::ResourceExhausted, "{refused}");
    assert!(refused.message().contains("max_memory_mib") && !sessions.is_empty(), "{refused}");
    for session_id in sessions {
        let request = v1::StepSessionRequest { session_id, steps: 1, inputs: Vec::new() };
        soon("a step", process.client.step_session(request)).await.unwrap();
    }
    assert!(process.stop().success());
}
