//! The files of numbers: `pareto.csv`, and `pareto.md` for people.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use kerf_scenes::dial::{FinerRegions, ParetoFront, ParetoPoint};

use super::job::Job;
use super::options::Options;
use super::process::Run;
use super::{reference, sweep};
use crate::machine::hardware;

/// What is told of the measurement besides the scene.
#[must_use]
pub fn notes(options: &Options, reference: &Run, base: &Job) -> Vec<(String, String)> {
    let setting = reference.job.setting;
    let mut notes = vec![
        ("hardware", hardware()),
        ("command", command(std::env::args())),
        ("version", crate::VERSION.to_owned()),
        (
            "reference",
            format!(
                "{}, the scene's voxels ({}), relative tolerance {:e} ({:.1e} at worst); {} steps in {:.0} s on {} threads",
                reference::name(&reference.job),
                reference.voxels,
                setting.relative_tolerance,
                reference.worst_residual,
                reference.steps,
                reference.cost.run_s,
                reference.job.threads,
            ),
        ),
        ("threads", options.threads.to_string()),
        (
            "samples",
            format!(
                "{} points of the surface at {} times in {:.3} s",
                base.points.len(),
                base.samples,
                base.duration_s
            ),
        ),
        (
            "errors",
            "relative to the reference, while it feels a tool where there is one; the largest displacement's are of \
             points beside the cut"
                .to_owned(),
        ),
        ("cost", "of the steps in which a tool touches, of all where there is none".to_owned()),
    ];
    if base.stroke.is_some() {
        let added = "the scene states none; `stated` is a box around the edge's stroke, a level finer";
        notes.push(("finer", added.to_owned()));
    }
    notes.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

/// Writes both files.
///
/// # Errors
/// A file cannot be written.
pub fn write(folder: &Path, pareto: &ParetoFront, remarks: &[String]) -> Result<()> {
    for (name, text) in [("pareto.csv", pareto.to_csv()), ("pareto.md", markdown(pareto, remarks))] {
        let path = folder.join(name);
        std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    }
    Ok(())
}

/// Whether no other point is better.
#[must_use]
pub fn is_on_pareto_front(point: &ParetoPoint, pareto: &ParetoFront) -> bool {
    !pareto.points.iter().any(|other| point.is_dominated_by(other))
}

/// A setting in words, what is as in most left away.
#[must_use]
pub fn label(point: &ParetoPoint) -> String {
    let mut label = format!("level {}, {:.0} Hz, {:e}", point.level, point.rate_hz, point.relative_tolerance);
    if point.voxel_scale != 1.0 {
        write!(label, " x{}", point.voxel_scale).expect("text grows");
    }
    if point.finer == FinerRegions::Stated && point.level > 0 {
        label.push_str(" finer");
    }
    let element = sweep::name_of(point.element);
    if element != "by_content" { label + " " + &element } else { label }
}

fn markdown(pareto: &ParetoFront, remarks: &[String]) -> String {
    let mut text = format!("# Speed and accuracy of `{}`\n\n", pareto.notes["scene"]);
    for (key, value) in pareto.notes.iter().filter(|(key, _)| *key != "scene") {
        writeln!(text, "- {key}: {value}").expect("text grows");
    }
    text += "\nBy load, which is the time of computing per simulated time; bold: no other setting is better in both \
             load and error, the larger of displacement's and force's root mean squares.\n\n\
             | setting | elements | load | ms, median | ms, p99 | MiB | displacement rms, % | max, % | force rms, % \
             | depth, % | area, % | energy residual |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n";
    let mut points: Vec<&ParetoPoint> = pareto.points.iter().collect();
    points.sort_by(|a, b| a.load().total_cmp(&b.load()));
    for point in points {
        let bold = if is_on_pareto_front(point, pareto) { "**" } else { "" };
        let percent = [
            point.displacement_rms_error,
            point.displacement_max_error,
            point.force_rms_error,
            point.cut_depth_error,
            point.cut_area_error,
        ]
        .map(|error| format!("{:.2}", 100.0 * error));
        writeln!(
            text,
            "| {bold}{}{bold} | {} | {:.3} | {:.3} | {:.3} | {:.0} | {} | {:.0e} |",
            label(point),
            point.elements,
            point.load(),
            point.median_ms,
            point.p99_ms,
            point.memory_mib,
            percent.join(" | "),
            point.energy_residual,
        )
        .expect("text grows");
    }
    if !remarks.is_empty() {
        text += "\nNot measured:\n\n";
        remarks.iter().for_each(|remark| writeln!(text, "- {remark}").expect("text grows"));
    }
    text
}

/// The command as it was given, of paths the last part alone.
fn command(arguments: impl Iterator<Item = String>) -> String {
    let last_part =
        |argument: String| Path::new(&argument).file_name().map_or(argument.clone(), |n| n.to_string_lossy().into());
    arguments.map(last_part).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_tells_no_paths_of_the_machine() {
        let given =
            ["/usr/local/bin/kerf-server", "tradeoff", "liver", "--rates", "60,250", "--out", "/home/me/out/liver"];
        let told = command(given.into_iter().map(str::to_owned));
        assert_eq!(told, "kerf-server tradeoff liver --rates 60,250 --out liver");
    }
}
