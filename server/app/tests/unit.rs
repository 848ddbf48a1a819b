//! The unit for systemd: what it may do, and that the server understands what it is told there.

use std::path::PathBuf;
use std::process::Command;

/// The most that `systemd-analyze security` may find: from 2.5 on it calls a service exposed to some degree.
const MAX_EXPOSURE: f64 = 2.0;

fn unit() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../deploy/systemd/kerf-server.service")
}

#[test]
fn the_unit_leaves_the_server_little_to_do_harm_with() {
    let analyzed = Command::new("systemd-analyze").args(["security", "--offline=true"]).arg(unit()).output();
    let Ok(analyzed) = analyzed else {
        println!("skipped: there is no systemd-analyze here");
        return;
    };
    let text = String::from_utf8_lossy(&analyzed.stdout);
    let level = text
        .lines()
        .find_map(|line| line.split_once("Overall exposure level for kerf-server.service: ")?.1.split(' ').next());
    let exposure: f64 = level.unwrap_or_else(|| panic!("{analyzed:?}")).parse().unwrap();
    assert!(exposure <= MAX_EXPOSURE, "{text}");
}

#[test]
fn the_server_understands_what_the_unit_tells_it() {
    let unit = std::fs::read_to_string(unit()).unwrap();
    let line = |start: &str| unit.lines().find_map(|line| line.strip_prefix(start)).unwrap();
    let settings = tempfile::NamedTempFile::new().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    let told =
        line("ExecStart=/usr/bin/kerf-server ").replace("/etc/kerf/server.toml", settings.path().to_str().unwrap());
    command.args(told.split(' ')).arg("--print-config");
    command.envs(line("Environment=").split(' ').map(|variable| variable.split_once('=').unwrap()));
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{output:?}");
    for setting in ["dir = \"/var/lib/kerf/security\"", "journal_dir = \"/var/lib/kerf/journals\""] {
        assert!(text.contains(setting), "{setting} in {text}");
    }
}
