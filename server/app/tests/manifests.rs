//! The manifests for Kubernetes: the server knows what they set and what their probes call.

use std::path::{Path, PathBuf};
use std::process::Command;

fn kubernetes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/kubernetes")
}

/// The lines of all manifests.
fn lines() -> Vec<String> {
    let folders =
        std::fs::read_dir(kubernetes()).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir());
    let files = folders.flat_map(|folder| std::fs::read_dir(folder).unwrap()).map(|entry| entry.unwrap().path());
    let texts = files.filter(|path| path.extension().is_some_and(|ending| ending == "yaml"));
    texts
        .flat_map(|path| std::fs::read_to_string(path).unwrap().lines().map(str::to_owned).collect::<Vec<_>>())
        .collect()
}

/// Settings, as `{name: KERF_NAMES, value: ...}` has them.
fn setting(line: &str) -> Option<(String, String)> {
    let (name, value) = line.trim().strip_prefix("- {name: ")?.strip_suffix('}')?.split_once(", value: ")?;
    let value = value.trim_matches(['\'', '"']).replace("$(POD_NAMESPACE)", "kerf").replace("$(POD_NAME)", "kerf-0");
    name.starts_with("KERF_").then(|| (name.into(), value))
}

#[test]
fn the_server_takes_the_settings_that_manifests_have() {
    let settings: Vec<_> = lines().iter().filter_map(|line| setting(line)).collect();
    assert!(settings.len() >= 8, "{settings:?}");
    for (name, value) in &settings {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
        command.args(["serve", "--print-config"]).env(name, value);
        // Given together, or not at all.
        let pair = [("KERF_SECURITY__CERTIFICATE_FILE", "KERF_SECURITY__KEY_FILE")];
        for (one, other) in pair.into_iter().flat_map(|(one, other)| [(one, other), (other, one)]) {
            if name == one {
                command.env(other, "file");
            }
        }
        let output = command.output().unwrap();
        assert!(output.status.success(), "{name}={value}: {}", String::from_utf8_lossy(&output.stderr));
        let names = String::from_utf8(output.stdout).unwrap();
        let is_names = name != "KERF_NAMES" || names.contains(r#"names = ["localhost", "kerf-0"#);
        assert!(is_names, "{names}");
    }
}

#[test]
fn probes_call_what_there_is() {
    let mut probes = 0;
    for line in lines() {
        let Some((_, command)) = line.split_once("command: [") else { continue };
        let words: Vec<_> = command.split(']').next().unwrap().split(", ").collect();
        assert_eq!(words[0], "kerf-server", "{line}");
        let output = Command::new(env!("CARGO_BIN_EXE_kerf-server")).args(&words[1..]).arg("--help").output().unwrap();
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        probes += 1;
    }
    assert!(probes >= 3, "{probes} probes");
}
