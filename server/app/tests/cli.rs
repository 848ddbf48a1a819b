//! The program as a user runs it.

use std::path::Path;
use std::process::{Command, Output};

fn kerf(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_kerf-server")).args(arguments).current_dir(folder).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn scenes_lists_every_builtin_scene() {
    let output = kerf(&["scenes"], Path::new("."));
    assert!(output.status.success(), "{}", text(&output.stderr));
    for name in kerf_scenes::catalog::builtin_names() {
        assert!(text(&output.stdout).lines().any(|line| line.starts_with(name)), "{name}");
    }
}

#[test]
fn check_tells_all_problems_and_fails() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "version = 1\nname = 'bad'\n[[objects]]\nname = 'b'\nvoxel_size_m = 0.01\n\
                 shape = { sphere = { center_m = [0.0, 0.0, 0.0], radius_m = 0.1 } }\n\
                 material = { young_modulus_pa = 1.0, poisson_ratio = 0.7 }\n";
    std::fs::write(folder.path().join("bad.toml"), scene).unwrap();
    let output = kerf(&["check", "bad.toml"], folder.path());
    assert_eq!(output.status.code(), Some(1));
    for field in ["objects[0].material.young_modulus_pa: 1 is not", "objects[0].material.poisson_ratio: 0.7 is not"] {
        assert!(text(&output.stdout).contains(field), "{}", text(&output.stdout));
    }
    assert!(
        text(&output.stdout).contains("problem: bad.toml:7:33: objects[0].material.young"),
        "{}",
        text(&output.stdout)
    );
    assert!(text(&output.stderr).contains("bad.toml: 2 problems"), "{}", text(&output.stderr));
    std::fs::write(folder.path().join("bad.toml"), scene.replace("poisson_ratio", "poisson")).unwrap();
    let output = kerf(&["check", "bad.toml"], folder.path());
    assert!(text(&output.stderr).contains("bad.toml:7:"), "{}", text(&output.stderr));
}

const BLOCK: &str = "version = 1\nname = 'block'\nrate_hz = 100.0\n[[objects]]\nname = 'block'\nvoxel_size_m = 0.01\n\
                     shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.04, 0.04, 0.04] } }\nlevel = 1\n\
                     material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }\n\
                     fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 0.01, 1.0] } }]\n\
                     [[tools]]\nname = 'blade'\nshape = { blade = { width_m = 0.05, height_m = 0.05 } }\n";
const HEADER: &str = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw\n";

#[test]
fn check_and_simulate_refuse_and_warn_alike_and_only_denied_warnings_fail() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("far.csv", &format!("{HEADER}0,blade,20,60,20,0,0,0,1\n0.1,blade,20,30,20,0,0,0,1\n"));
    let point = "[[tracked_points]]\nname = 'face'\nobject = 'block'\nposition_m = [0.02, 0.04, 0.02]\n";
    let warned = BLOCK.replace("fixed", "# fixed");
    for (scene, more, warning, problem) in [
        (BLOCK.to_owned(), &[][..], None, None),
        (warned.clone(), &[][..], Some("warning: block.toml:4:1: objects[0]: nothing holds `block`"), None),
        (BLOCK.to_owned(), &["--script", "far.csv"][..], Some("warning: far.csv: tool `blade` comes no nearer"), None),
        (
            BLOCK.to_owned() + point,
            &[],
            None,
            Some("block.toml:17:14: tracked_points[0].position_m: [0.02, 0.04, 0.02]"),
        ),
    ] {
        write("block.toml", &scene);
        let check = kerf(&[&["check", "block.toml"], more].concat(), folder.path());
        let simulate = [&["simulate", "block.toml", "--duration", "0.1", "--out", "out"], more].concat();
        let simulate = kerf(&simulate, folder.path());
        for output in [&check, &simulate] {
            let said = text(&output.stdout) + &text(&output.stderr);
            assert_eq!(output.status.success(), problem.is_none(), "{said}");
            assert_eq!(said.contains("warning: "), warning.is_some(), "{said}");
            assert!(said.contains(warning.or(problem).unwrap_or_default()), "{said}");
        }
        let denied = kerf(&[&["check", "block.toml", "--deny-warnings"], more].concat(), folder.path());
        assert_eq!(denied.status.success(), problem.is_none() && warning.is_none());
    }
}

#[test]
fn simulate_says_how_far_it_is_and_keeps_a_longer_run() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("block.toml"), BLOCK).unwrap();
    let run = |duration: &str| kerf(&["simulate", "block.toml", "--duration", duration, "--out", "out"], folder.path());
    let first = run("0.2");
    assert!(first.status.success() && text(&first.stderr).contains("1 of 20 steps, "), "{}", text(&first.stderr));
    let shorter = run("0.1");
    assert_eq!(shorter.status.code(), Some(1));
    assert!(text(&shorter.stderr).contains("a run of 20 steps stands in out"), "{}", text(&shorter.stderr));
    assert!(run("0.2").status.success());
}

#[test]
fn simulate_warns_of_a_tool_that_felt_nothing() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("block.toml"), BLOCK).unwrap();
    let near = format!("{HEADER}0,blade,0.02,0.06,0.02,0,0,0,1\n0.1,blade,0.02,0.039,0.02,0,0,0,1\n");
    std::fs::write(folder.path().join("near.csv"), near).unwrap();
    let arguments =
        ["simulate", "block.toml", "--script", "near.csv", "--duration", "0.05", "--out", "out", "--deny-warnings"];
    let output = kerf(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("warning: tool `blade` felt no force"), "{}", text(&output.stderr));
}

#[test]
fn a_file_that_cannot_be_read_is_told_once_and_without_numbers_of_the_system() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = "mesh = { file = 'organ.stl', scale_m_per_unit = 1e-3 }";
    let scene = BLOCK.replace("box = { min_m = [0.0, 0.0, 0.0], max_m = [0.04, 0.04, 0.04] }", mesh);
    std::fs::write(folder.path().join("block.toml"), scene).unwrap();
    let output = kerf(&["check", "block.toml"], folder.path());
    assert_eq!(text(&output.stderr), "error: organ.stl: no such file or directory\n");
}

#[test]
fn serve_prints_its_settings_as_a_file_that_it_reads() {
    let folder = tempfile::tempdir().unwrap();
    let output = kerf(&["serve", "--set", "session.lease_s=3.5", "--print-config"], folder.path());
    assert!(output.status.success() && text(&output.stdout).contains("\nlease_s = 3.5\n"), "{}", text(&output.stdout));
    std::fs::write(folder.path().join("kerf.toml"), &output.stdout).unwrap();
    let again = kerf(&["serve", "--config", "kerf.toml", "--print-config"], folder.path());
    assert_eq!(text(&again.stdout), text(&output.stdout), "{}", text(&again.stderr));
}

#[test]
fn simulate_writes_every_file_and_the_summarys_keys() {
    let folder = tempfile::tempdir().unwrap();
    let output = kerf(&["simulate", "jelly", "--duration", "0.01", "--out", "run"], folder.path());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let run = folder.path().join("run");
    for name in ["tool.csv", "energy.csv", "tracked_points.csv", "profile.csv", "surface.glb"] {
        assert!(run.join(name).metadata().unwrap().len() > 0, "{name}");
    }
    assert_eq!(text(&std::fs::read(run.join("profile.csv")).unwrap()).lines().count(), 11);
    let summary: serde_json::Value = serde_json::from_slice(&std::fs::read(run.join("summary.json")).unwrap()).unwrap();
    for key in [
        "voxels",
        "composite_elements",
        "nodes",
        "surface_vertices",
        "surface_triangles",
        "parts",
        "cut_area_m2",
        "steps",
        "fracture_steps",
        "step_ms_median_without_fracture",
        "step_ms_median_with_fracture",
        "step_ms_p99",
        "solver_iterations_mean",
        "state_hash",
        "surface_hash",
        "version",
    ] {
        assert!(summary.get(key).is_some(), "{key}");
    }
    assert_eq!(summary["steps"], 10);
}

#[test]
fn simulate_refuses_a_script_with_row_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let script = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw\n0,blade,0,0.1,0,0,0,0,1\n0.1,blade,0,up,0,0,0,0,1\n";
    std::fs::write(folder.path().join("s.csv"), script).unwrap();
    let output = kerf(&["simulate", "jelly", "--script", "s.csv", "--out", "run"], folder.path());
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("s.csv: row 3: column y_m: `up`"), "{}", text(&output.stderr));
}

#[test]
fn simulate_judges_the_scene_with_its_options_applied() {
    let folder = tempfile::tempdir().unwrap();
    let output = kerf(&["simulate", "liver", "--rate", "5", "--out", "run"], folder.path());
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("with --rate applied: rate_hz: 5 is not"), "{}", text(&output.stderr));
}
