//! The manifests for Kubernetes and for compose: the server knows what they set and what their probes call, and has the
//! little that it may do.

use std::path::{Path, PathBuf};
use std::process::Command;

fn kubernetes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/kubernetes")
}

/// The texts of all manifests.
fn texts() -> Vec<String> {
    let folders =
        std::fs::read_dir(kubernetes()).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir());
    let files = folders.flat_map(|folder| std::fs::read_dir(folder).unwrap()).map(|entry| entry.unwrap().path());
    let manifests = files.filter(|path| path.extension().is_some_and(|ending| ending == "yaml"));
    manifests.map(|path| std::fs::read_to_string(path).unwrap()).collect()
}

/// Their lines.
fn lines() -> Vec<String> {
    texts().iter().flat_map(|text| text.lines()).map(str::to_owned).collect()
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

/// Without journals a session that moves here is put into a temporary file.
#[test]
fn temporary_files_have_a_place_beside_a_root_that_cannot_be_written() {
    let mut containers = 0;
    for text in texts() {
        let count = |of: &str| text.matches(of).count();
        let cannot_be_written = count("readOnlyRootFilesystem: true");
        assert_eq!(count("{name: tmp, mountPath: /tmp}"), cannot_be_written, "{text}");
        assert_eq!(count("{name: tmp, emptyDir: {sizeLimit: "), cannot_be_written, "{text}");
        containers += cannot_be_written;
    }
    assert!(containers >= 2, "{containers} containers");
}

#[test]
fn a_server_may_call_another_one_to_move_a_session() {
    let manifest = |name: &str| std::fs::read_to_string(kubernetes().join("server").join(name)).unwrap();
    let set = manifest("statefulset.yaml");
    let (_, port) = set.split_once("{name: grpc, containerPort: ").unwrap();
    let port = format!("port: {}}}", port.split('}').next().unwrap());
    let policy = manifest("networkpolicy.yaml");
    let (ingress, egress) = policy.split_once("\n  egress:").unwrap();
    let rule = egress.split("\n    - ").find(|rule| rule.contains(&port)).expect("a rule for the server's port");
    assert!(rule.contains("podSelector: {matchLabels: {app.kubernetes.io/name: kerf}}"), "{rule}");
    assert!(ingress.contains("port: grpc}"), "{ingress}");
}

#[test]
fn containers_of_compose_may_do_little() {
    let text = std::fs::read_to_string(kubernetes().join("../../docker/compose.yaml")).unwrap();
    let (_, services) = text.split_once("\nservices:\n").unwrap();
    let (services, _) = services.split_once("\nvolumes:").unwrap();
    let is_name = |line: &&str| line.strip_prefix("  ").is_some_and(|rest| !rest.starts_with([' ', '#']));
    let names = services.lines().filter(is_name).count();
    assert!(names >= 3 && services.matches("\n    <<: *confined\n").count() == names, "{services}");
    let settings =
        ["read_only: true", "tmpfs: [/tmp]", "cap_drop: [ALL]", r#"security_opt: ["no-new-privileges:true"]"#];
    for setting in settings {
        assert!(text.contains(&format!("\n  {setting}\n")), "{setting}");
    }
}
