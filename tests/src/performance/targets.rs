//! The limits that steps are built to, and where they stand.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;

use super::run::{FEM, Run, Viewer, builtin, cell, liver, quantile, stage_sum, stroke};

/// Steps of a 60 Hz stroke until well into the cut.
const FRAME_STEPS: usize = 72;

pub fn section(_plots: &Path) -> Result<String> {
    let mut text = String::from("\n## Limits\n\nMedians, ms.\n\n| step | limit | measured |\n|---|---|---|\n");
    let mut line = |what: &str, limit_ms: f64, ms: f64| {
        let missed = if ms <= limit_ms { "" } else { " (missed)" };
        writeln!(text, "| {what} | {limit_ms} | {}{missed} |", cell(ms))
    };
    let haptic = stroke(&builtin("liver")?, 1, Viewer::Watching, usize::MAX)?;
    line("liver, k = 4, 1 kHz, residual 1e-3, one thread, without fracture", 0.8, haptic.median_ms(false))?;
    line("the same with fracture: topology, surface, solver data", 2.5, haptic.median_ms(true))?;
    let two = stroke(&builtin("liver")?, 2, Viewer::Watching, usize::MAX)?;
    line("the same without fracture, two threads", 0.8, two.median_ms(false))?;
    let mut converged = builtin("liver")?;
    converged.desc.rate_hz = 100.0;
    converged.desc.solver.relative_tolerance = 1e-5;
    let converged = stroke(&converged, 1, Viewer::Absent, usize::MAX)?;
    line(
        "liver, k = 4, 100 Hz, residual 1e-5, one thread, mechanics only, without fracture",
        1.0,
        mechanics_ms(&converged),
    )?;
    let exact = stroke(&liver(0.0035, 0, 60.0)?, 2, Viewer::Watching, FRAME_STEPS)?;
    line("liver, k = 1, 60 Hz, residual 1e-3, two threads", 16.0, whole_ms(&exact))?;
    let large = stroke(&liver(0.000_88, 2, 60.0)?, 2, Viewer::Absent, FRAME_STEPS)?;
    let what = format!("liver, {} voxels, k = 4, 60 Hz, residual 1e-3, two threads", large.counts.voxels);
    line(&what, 33.0, whole_ms(&large))?;
    Ok(text)
}

fn whole_ms(run: &Run) -> f64 {
    quantile(run.samples.iter().map(|sample| sample.total_ms), 0.5)
}

fn mechanics_ms(run: &Run) -> f64 {
    quantile(run.of_kind(false).map(|sample| stage_sum(sample, &FEM)), 0.5)
}
