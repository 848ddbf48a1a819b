//! Releases: workflows call what there is, and a version is stated once.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().expect("the project's folder")
}

/// The commands of a workflow's steps.
fn commands(workflow: &str) -> impl Iterator<Item = &str> {
    workflow.lines().filter_map(|line| line.trim_start().trim_start_matches("- ").strip_prefix("run: "))
}

/// The targets of `make A B VARIABLE=c`; what `${{ }}` stands for may have spaces in it.
fn targets(command: &str) -> Option<Vec<String>> {
    let pieces =
        command.strip_prefix("make ")?.split("${{").map(|piece| piece.split_once("}}").map_or(piece, |(_, rest)| rest));
    let words: String = pieces.collect();
    let words = words.split_whitespace().take_while(|word| *word != ">");
    Some(words.filter(|word| !word.starts_with('-') && !word.contains('=')).map(str::to_owned).collect())
}

#[test]
fn workflows_call_programs_and_targets_that_are_there() {
    let makefile = fs::read_to_string(root().join("Makefile")).expect("a Makefile");
    let rules = |line: &str| Some(line.split_once(':')?.0.split_whitespace().map(str::to_owned).collect::<Vec<_>>());
    let there: BTreeSet<String> =
        makefile.lines().filter(|line| !line.starts_with(['\t', '#', '.'])).filter_map(rules).flatten().collect();
    let mut called = BTreeSet::new();
    for entry in fs::read_dir(root().join(".github/workflows")).expect("workflows") {
        let path = entry.expect("an entry").path();
        let text = fs::read_to_string(&path).expect("a workflow");
        assert!(!text.contains("run: |"), "{}: a block of commands is not checked here", path.display());
        for command in commands(&text) {
            let program = command.split_whitespace().next().unwrap_or_default();
            match targets(command) {
                Some(targets) => called.extend(targets),
                None if program.contains('/') => {
                    assert!(root().join(program).exists(), "{}: {program}", path.display())
                }
                None => assert!(["docker", "gh"].contains(&program), "{}: {command}", path.display()),
            }
        }
    }
    assert!(called.contains("release-notes") && called.contains("deb"), "{called:?}");
    let missing: Vec<_> = called.difference(&there).collect();
    assert!(missing.is_empty(), "no such targets in the Makefile: {missing:?}");
}

/// Runs the script on a copy of the files that it reads, with this changelog.
fn notes(version: &str, changelog: &str, change: impl FnOnce(&Path)) -> Result<String, String> {
    let folder = tempfile::tempdir().expect("a folder");
    for file in [
        "Cargo.toml",
        "CITATION.cff",
        "client/python/pyproject.toml",
        "client/web/package.json",
        "client/unity/package.json",
        "deploy/kubernetes/server/kustomization.yaml",
    ] {
        let to = folder.path().join(file);
        fs::create_dir_all(to.parent().expect("a folder")).expect("a folder");
        fs::copy(root().join(file), to).unwrap_or_else(|error| panic!("{file}: {error}"));
    }
    fs::write(folder.path().join("CHANGELOG.md"), changelog).expect("a changelog");
    change(folder.path());
    let script = root().join("deploy/release/notes.py");
    let output = Command::new("python3").arg(script).arg(version).current_dir(folder.path()).output().expect("python3");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
    if output.status.success() { Ok(text(output.stdout)) } else { Err(text(output.stderr)) }
}

#[test]
fn a_release_has_the_notes_of_its_version_and_all_files_state_it() {
    if Command::new("python3").arg("--version").output().is_err() {
        println!("skipped: there is no python3 here");
        return;
    }
    let version = env!("CARGO_PKG_VERSION");
    let changelog = format!(
        "# Changelog\n\n## Unreleased\n\n- Later.\n\n## {version} (2026-12-01)\n\n- A blade.\n\n## 0.0.9\n\n- Old.\n"
    );
    assert_eq!(notes(&format!("v{version}"), &changelog, |_| ()).expect("notes"), "- A blade.\n");
    let other = notes("v9.9.9", &changelog, |_| ()).expect_err("a refusal");
    assert!(other.contains(&format!("Cargo.toml states {version}, not 9.9.9")), "{other}");
    let none = notes(version, "# Changelog\n\n## Unreleased\n\n- Later.\n", |_| ()).expect_err("a refusal");
    assert!(none.contains(&format!("no section `## {version}`")), "{none}");
    let apart = |folder: &Path| {
        let file = folder.join("client/unity/package.json");
        let text = fs::read_to_string(&file).expect("a package").replace(version, "0.0.9");
        fs::write(&file, text).expect("a package");
    };
    let apart = notes(version, &changelog, apart).expect_err("a refusal");
    assert_eq!(apart.trim(), format!("client/unity/package.json states 0.0.9, not {version}"));
    let image = |folder: &Path| {
        let file = folder.join("deploy/kubernetes/server/kustomization.yaml");
        let text = fs::read_to_string(&file).expect("a kustomization").replace(version, "0.0.9");
        fs::write(&file, text).expect("a kustomization");
    };
    let image = notes(version, &changelog, image).expect_err("a refusal");
    assert!(image.contains("server/kustomization.yaml states 0.0.9"), "{image}");
}
