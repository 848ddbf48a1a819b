//! A checkpoint goes as a file from one server to another, by the command line and over the wire.

use std::process::{Command, Stdio};

use kerf_physics::Workers;
use kerf_proto::v1;
use kerf_server::recording::reader::Recording;
use kerf_server::recording::verify::verify;

use super::process::{Process, at};

/// Steps after which the state is saved: the edge is in the block.
const BEFORE: usize = 60;
/// Steps in lock-step after it.
const AFTER: usize = 200;

/// Down into the block, up to its top and down again, all the time in the tissue once it is there.
fn stroke() -> Vec<v1::StepInput> {
    let height_m = |step: usize| match step {
        0..100 => 0.012 - 2e-4 * step as f64,
        100..180 => -0.008 + 2e-4 * (step - 100) as f64,
        _ => 0.008 - 2e-4 * (step - 180) as f64,
    };
    (0..BEFORE + AFTER).map(|step| at(height_m(step))).collect()
}

/// What `kerf-server session` prints, or else says on standard error.
fn ask(process: &Process, arguments: &[&str]) -> Result<String, String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    let output = command.arg("session").args(arguments).args(["--server", &process.address.to_string()]).output();
    let output = output.unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    if output.status.success() { Ok(text(output.stdout)) } else { Err(text(output.stderr)) }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_state_goes_on_in_a_fresh_server_to_the_same_bits_and_its_recording_verifies() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("half way.kerf");
    let (file, inputs) = (path.to_str().unwrap(), stroke());
    let mut first = Process::serve(&["--log-filter", "warn"], Stdio::inherit()).await;
    let id = first.stand().await;
    let before = first.step(&id, &inputs[..BEFORE]).await;
    assert!(before.topology_version > 0, "it has begun to cut");
    ask(&first, &["save", &id, "half way"]).unwrap();
    let said = ask(&first, &["download", &id, file, "--checkpoint", "half way"]).unwrap();
    assert_eq!(said, format!("{file}: {} bytes\n", std::fs::metadata(&path).unwrap().len()));
    let there = first.step(&id, &inputs[BEFORE..]).await;
    // The state as it is needs no name.
    let end = folder.path().join("end.kerf");
    ask(&first, &["download", &id, end.to_str().unwrap()]).unwrap();
    assert!(first.stop().success());

    let records = format!("record_dir={}", folder.path().join("records").display());
    let mut second = Process::serve(&["--set", &records, "--log-filter", "warn"], Stdio::inherit()).await;
    let id = second.stand().await;
    // Steps of its own, and a checkpoint that the file takes the place of: the recording has to tell them apart.
    second.step(&id, &inputs[..20]).await;
    ask(&second, &["save", &id, "half way"]).unwrap();
    let said = ask(&second, &["upload", &id, file, "--restore"]).unwrap();
    assert_eq!(said, format!("`half way` uploaded, of step {0}\nback to `half way` at step {0}\n", before.step));
    let here = second.step(&id, &inputs[BEFORE..]).await;
    assert_eq!((here.step, here.state_hash), ((BEFORE + AFTER) as u64, there.state_hash));
    // Forces, energies since the session began, tracked points: all of them.
    assert_eq!(here, there);
    assert!(here.topology_version > before.topology_version, "it went on cutting");
    ask(&second, &["upload", &id, end.to_str().unwrap(), "--checkpoint", "from elsewhere", "--restore"]).unwrap();
    let described = second.until(&id, |_| true).await;
    assert_eq!((described.step, described.state_hash), (there.step, there.state_hash));

    let said = ask(&second, &["upload", &id, "no such file"]).unwrap_err();
    assert!(said.contains("no such file: No such file"), "{said}");
    let said = ask(&second, &["upload", &id, file, "--checkpoint", ""]).unwrap_err();
    assert!(said.contains("name: \"\" is not a checkpoint's name of 1 to 64 bytes"), "{said}");
    let said = ask(&second, &["download", &id, file, "--checkpoint", "none"]).unwrap_err();
    assert!(said.contains("name: the session has no checkpoint \"none\""), "{said}");
    let closed = ask(&second, &["close", &id]).unwrap();
    let record = closed.trim().strip_prefix("recorded: ").and_then(|said| said.split_once(", ")).unwrap().0.to_owned();
    assert!(second.stop().success());
    let mut recording = Recording::open(&folder.path().join("records").join(record)).unwrap();
    let verified = verify(&mut recording, &Workers::serial(), |_| ()).unwrap();
    assert_eq!((verified.steps, verified.restores), ((20 + AFTER) as u64, 2));
    assert_eq!(verified.state_hash, there.state_hash);
}
