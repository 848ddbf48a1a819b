//! The limits that steps are built to, and where they stand.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use kerf_physics::SoundScene;

use super::run::{FEM, Run, Viewer, builtin, cell, liver, quantile, stage_sum, stroke};

/// Steps of a 60 Hz stroke until well into the cut.
const FRAME_STEPS: usize = 72;
/// Runs of which the median is taken.
const ROUNDS: usize = 3;

pub fn section(_plots: &Path) -> Result<String> {
    let mut text = String::from(
        "\n## Limits\n\nMedians, ms; but for the last row of three runs.\n\n| step | limit | measured |\n|---|---|---|\n",
    );
    let mut line = |what: &str, limit_ms: f64, ms: f64| {
        let missed = if ms <= limit_ms { "" } else { " (missed)" };
        writeln!(text, "| {what} | {limit_ms} | {}{missed} |", cell(ms))
    };
    let haptic = runs(&builtin("liver")?, 1, Viewer::Watching, usize::MAX)?;
    let without = |run: &Run| run.median_ms(false);
    line("liver, k = 4, 1 kHz, residual 1e-3, one thread, without fracture", 0.8, middle(&haptic, without))?;
    let with = middle(&haptic, |run| run.median_ms(true));
    line("the same with fracture: topology, surface, solver data", 2.5, with)?;
    let two = runs(&builtin("liver")?, 2, Viewer::Watching, usize::MAX)?;
    line("the same without fracture, two threads", 0.8, middle(&two, without))?;
    let converged = builtin("liver")?.with(|desc| {
        desc.rate_hz = 100.0;
        desc.solver.relative_tolerance = Some(1e-5);
    })?;
    let converged = runs(&converged, 1, Viewer::Absent, usize::MAX)?;
    line(
        "liver, k = 4, 100 Hz, residual 1e-5, one thread, mechanics only, without fracture",
        1.0,
        middle(&converged, mechanics_ms),
    )?;
    let exact = runs(&liver(0.0035, 0, 60.0)?, 2, Viewer::Watching, FRAME_STEPS)?;
    line("liver, k = 1, 60 Hz, residual 1e-3, two threads", 16.0, middle(&exact, whole_ms))?;
    let large = stroke(&liver(0.000_88, 2, 60.0)?, 2, Viewer::Absent, FRAME_STEPS)?;
    let what = format!("liver, {} voxels, k = 4, 60 Hz, residual 1e-3, two threads", large.counts.voxels);
    line(&what, 33.0, whole_ms(&large))?;
    Ok(text)
}

fn runs(scene: &SoundScene, threads: usize, viewer: Viewer, max_steps: usize) -> Result<Vec<Run>> {
    (0..ROUNDS).map(|_| stroke(scene, threads, viewer, max_steps)).collect()
}

/// The median over runs of a figure.
fn middle(runs: &[Run], of: impl Fn(&Run) -> f64) -> f64 {
    quantile(runs.iter().map(of), 0.5)
}

fn whole_ms(run: &Run) -> f64 {
    quantile(run.samples.iter().map(|sample| sample.total_ms), 0.5)
}

fn mechanics_ms(run: &Run) -> f64 {
    quantile(run.of_kind(false).map(|sample| stage_sum(sample, &FEM)), 0.5)
}
