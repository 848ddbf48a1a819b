//! `kerf-server top` beside a server that runs.

use std::process::{Command, Stdio};

use super::process::Process;

#[tokio::test(flavor = "multi_thread")]
async fn top_shows_a_servers_sessions_once_where_there_is_no_terminal() {
    let mut process = Process::serve(&["--log-filter", "warn"], Stdio::inherit()).await;
    let running = process.create().await.session.unwrap().session_id;
    let stands = process.stand().await;
    let top = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
        command.args(["top", "--server", &process.address.to_string(), "--interval", "0.5"]).args(arguments);
        let output = command.output().unwrap();
        (output.status.success(), String::from_utf8(output.stdout).unwrap())
    };
    for arguments in [&["--once"][..], &[]] {
        let (is_well, text) = top(arguments);
        let words = |id: &str| {
            let line = text.lines().find(|line| line.starts_with(id)).unwrap_or_else(|| panic!("{id} in {text}"));
            line.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
        };
        assert!(is_well && text.starts_with("kerf-server "), "{text}");
        let (running, stands) = (words(&running), words(&stands));
        assert_eq!((running[2].as_str(), stands[2].as_str()), ("running", "paused"), "{text}");
        let kept: f64 = running[4].parse().unwrap();
        assert!(kept > 10.0 && kept < 200.0, "{text}");
        assert_eq!(stands[3..7], ["-"; 4], "{text}");
    }
    assert!(process.stop().success());
}
