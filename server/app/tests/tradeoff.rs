//! `kerf-server tradeoff` as a user runs it, on a block that is swept in seconds.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use kerf_scenes::catalog;
use kerf_scenes::dial::{FinerRegions, ParetoFront, ParetoPoint};

const BLOCK: &str = "version = 1\nname = 'block'\nrate_hz = 200.0\n\
    [[objects]]\nname = 'block'\nvoxel_size_m = 0.005\nlevel = 1\n\
    shape = { box = { min_m = [-0.02, 0.0, -0.02], max_m = [0.02, 0.03, 0.02] } }\n\
    fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 0.005, 1.0] } }]\n\
    material = { young_modulus_pa = 2.0e5, poisson_ratio = 0.4, rayleigh_alpha_per_s = 5.0, rayleigh_beta_s = 1.0e-3, \
    fracture_energy_j_per_m2 = 100.0 }\n\
    [[tools]]\nname = 'blade'\nshape = { blade = { width_m = 0.03, height_m = 0.05 } }\n";
const AXES: [&str; 12] = [
    "--levels",
    "0,1,2",
    "--rates",
    "200",
    "--tolerances",
    "1e-8",
    "--voxel-scales",
    "1",
    "--elements",
    "incompatible_modes",
    "--finer",
    "left_out",
];

fn sweep(folder: &Path, scene: &str, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    command.args(["tradeoff", scene, "--out", "out", "--points", "40", "--samples", "20"]).args(more);
    command.current_dir(folder).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn swept(folder: &Path, more: &[&str]) -> (String, ParetoFront) {
    std::fs::write(folder.join("block.toml"), BLOCK).unwrap();
    let output = sweep(folder, "block.toml", more);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let pareto = std::fs::read_to_string(folder.join("out/pareto.csv")).unwrap();
    (text(&output.stdout), ParetoFront::parse("pareto.csv", &pareto).unwrap())
}

fn run_file(folder: &Path, level: u8) -> PathBuf {
    folder.join(format!("out/runs/k{level}-x1-200hz-1e-8-incompatible_modes-left_out.json"))
}

fn at_level(pareto: &ParetoFront, level: u8) -> ParetoPoint {
    *pareto.points.iter().find(|point| point.level == level).unwrap()
}

#[test]
fn a_finer_level_errs_less_and_costs_more_and_the_plot_shows_them() {
    let folder = tempfile::tempdir().unwrap();
    let (_, pareto) = swept(folder.path(), &AXES);
    let [voxels, fine, coarse] = [0, 1, 2].map(|level| at_level(&pareto, level));
    assert_eq!(pareto.points.len(), 3);
    let scene = catalog::load(folder.path().join("block.toml").to_str().unwrap()).unwrap();
    assert_eq!(pareto.fingerprint(), ParetoFront::of(&scene).fingerprint());
    assert!(voxels.error() < fine.error() && fine.error() < coarse.error(), "{:?}", pareto.points);
    assert!(voxels.elements > fine.elements && fine.elements > coarse.elements);
    for point in &pareto.points {
        assert!(point.median_ms > 0.0 && point.median_ms <= point.p99_ms, "{point:?}");
        // An empty process takes a MiB; this one must not be told the parent's.
        assert!((1.0..1024.0).contains(&point.memory_mib), "{point:?}");
        assert!(point.energy_residual < 1e-2, "{point:?}");
    }
    assert!(voxels.cut_area_error < 0.1 && voxels.cut_depth_error < 0.2, "{voxels:?}");
    assert_eq!(
        pareto.notes["command"].split(' ').take(3).collect::<Vec<_>>(),
        ["kerf-server", "tradeoff", "block.toml"]
    );
    let table = std::fs::read_to_string(folder.path().join("out/pareto.md")).unwrap();
    for point in &pareto.points {
        let bold = !pareto.points.iter().any(|other| point.is_dominated_by(other));
        let row = table.lines().find(|line| line.contains(&format!("level {}, 200 Hz", point.level))).unwrap();
        assert_eq!(row.starts_with("| **"), bold, "{row}");
    }
    for name in ["pareto.svg", "pareto.png"] {
        assert!(folder.path().join("out").join(name).metadata().unwrap().len() > 1000, "{name}");
    }
}

#[test]
fn the_references_own_setting_has_no_error() {
    let folder = tempfile::tempdir().unwrap();
    // The reference is at twice the fastest rate; once it stands it is kept, so that its setting can be swept.
    let axes = |rate| {
        let last = ["--elements", "by_content", "--finer", "left_out"];
        [&AXES[..1], &["0", "--rates", rate], &AXES[4..8], &last].concat()
    };
    swept(folder.path(), &axes("200"));
    let (said, pareto) = swept(folder.path(), &axes("400"));
    assert!(said.contains("1 runs taken"), "{said}");
    let warned = text(&sweep(folder.path(), "block.toml", &[&axes("400")[..], &["--deny-warnings"]].concat()).stderr);
    assert!(warned.contains("is no finer than k0-x1-400hz") && warned.contains("denied by"), "{warned}");
    let reference = &pareto.notes["reference"];
    assert!(reference.starts_with("level 0,") && reference.contains(" 400 Hz"), "{reference}");
    let same = at_level(&pareto, 0);
    assert!(same.error() < 1e-9 && same.displacement_max_error < 1e-9, "{same:?}");
    assert_eq!([same.cut_depth_error, same.cut_area_error], [0.0, 0.0]);
}

#[test]
fn what_stands_is_not_run_again_and_what_is_cut_short_is() {
    let folder = tempfile::tempdir().unwrap();
    let axes = [&AXES[..1], &["1,2"], &AXES[2..]].concat();
    let (said, first) = swept(folder.path(), &axes);
    assert!(said.contains("2 settings measured, 3 runs taken"), "{said}");
    let (said, second) = swept(folder.path(), &axes);
    assert!(said.contains("2 settings measured, 0 runs taken"), "{said}");
    assert_eq!(first, second);
    let whole = std::fs::read(run_file(folder.path(), 2)).unwrap();
    std::fs::write(run_file(folder.path(), 2), &whole[..whole.len() / 2]).unwrap();
    let (said, third) = swept(folder.path(), &axes);
    assert!(said.contains("2 settings measured, 1 runs taken"), "{said}");
    let errors = |pareto: &ParetoFront| pareto.points.iter().map(ParetoPoint::error).collect::<Vec<_>>();
    assert_eq!(errors(&first), errors(&third));
    // Another scene of the same name.
    std::fs::write(folder.path().join("block.toml"), BLOCK.replace("2.0e5", "2.1e5")).unwrap();
    let said = text(&sweep(folder.path(), "block.toml", &axes).stdout);
    assert!(said.contains("3 runs taken"), "{said}");
}

#[test]
fn costs_are_taken_again_and_errors_kept() {
    let folder = tempfile::tempdir().unwrap();
    let axes = [&AXES[..1], &["1,2"], &AXES[2..]].concat();
    let (_, before) = swept(folder.path(), &axes);
    let (said, after) = swept(folder.path(), &[&axes[..], &["--retime"]].concat());
    assert!(said.contains("2 runs taken"), "{said}");
    for (before, after) in before.points.iter().zip(&after.points) {
        assert_ne!(before.median_ms, after.median_ms);
        let costs =
            ParetoPoint { median_ms: after.median_ms, p99_ms: after.p99_ms, memory_mib: after.memory_mib, ..*before };
        assert_eq!(costs, *after);
    }
}

#[test]
fn the_stroke_is_an_axis_where_the_scene_states_no_regions() {
    let folder = tempfile::tempdir().unwrap();
    let axes = [&AXES[..1], &["2"], &AXES[2..10], &["--finer", "left_out,stated"]].concat();
    let (_, pareto) = swept(folder.path(), &axes);
    let of = |finer| *pareto.points.iter().find(|point| point.finer == finer).unwrap();
    assert!(of(FinerRegions::Stated).elements > of(FinerRegions::LeftOut).elements);
    assert!(pareto.notes["finer"].contains("states none"));
}

#[test]
fn a_scene_without_tools_is_swept_by_its_loads() {
    let folder = tempfile::tempdir().unwrap();
    let pressed = BLOCK.split("[[tools]]").next().unwrap().replace(
        "material =",
        "loads = [{ traction = { region = { box = { min_m = [-1.0, 0.02, -1.0], max_m = [0.0, 1.0, 1.0] } }, face = 'max_y', \
         traction_pa = [0.0, -2.0e4, 0.0] } }]\nmaterial =",
    );
    std::fs::write(folder.path().join("pressed.toml"), pressed).unwrap();
    let output = sweep(folder.path(), "pressed.toml", &[&AXES[..], &["--duration", "0.2"]].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let pareto = std::fs::read_to_string(folder.path().join("out/pareto.csv")).unwrap();
    let pareto = ParetoFront::parse("pareto.csv", &pareto).unwrap();
    assert!(pareto.points.iter().all(|point| point.force_rms_error == 0.0 && point.cut_area_error == 0.0));
    let [voxels, coarse] = [0, 2].map(|level| at_level(&pareto, level).displacement_rms_error);
    assert!(voxels < 0.5 * coarse, "{voxels} {coarse}");
    assert!(folder.path().join("out/profile.svg").is_file() && folder.path().join("out/profile.png").is_file());
}

#[test]
fn values_that_are_not_supported_are_named_with_their_limits() {
    let folder = tempfile::tempdir().unwrap();
    for (option, value, limit) in [
        ("--levels", "7", "0..=4"),
        ("--rates", "5", "5 is not between 10 and 10000"),
        ("--tolerances", "0.9", "0.9 is not between 0.000000000001 and 0.5"),
        ("--elements", "stiff", "`galerkin`"),
        ("--duration", "-1", "--duration"),
    ] {
        let output = sweep(folder.path(), "jelly", &[&format!("{option}={value}")]);
        let said = text(&output.stderr);
        assert!(!output.status.success() && said.contains(option) && said.contains(limit), "{said}");
    }
}
