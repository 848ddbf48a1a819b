//! The comparison as a Markdown document.

use std::fmt::Write;

use super::measured::{PUNCTURE, loading_depth_m, loading_n};
use super::run::Run;
use super::{DEPTH_M, Row};

/// Where the force has settled behind the puncture in every case, m.
const STEADY_FROM_M: f64 = 0.0125;
/// Depth at which the loading curves are compared, m: every case still loads.
const LOADING_M: f64 = 0.0025;

pub fn markdown(rows: &[Row]) -> String {
    let mut text = String::from(include_str!("header.md"));
    for row in rows {
        // Writing to a string does not fail.
        let _ = writeln!(text, "| {} | {} |", row.name, cells(row).join(" | "));
    }
    text + include_str!("discussion.md")
}

fn cells(row: &Row) -> [String; 6] {
    let Row { run, griffith_n, .. } = row;
    let puncture = run.puncture();
    let steady_n = run.mean_force_n(STEADY_FROM_M, DEPTH_M);
    let loading = loading_ratio(run);
    [
        format!("{:.2}", puncture.force_n),
        format!("{:.1} ({:.1})", 1e3 * puncture.depth_m, 1e3 * loading_depth_m(puncture.force_n.min(PUNCTURE.1))),
        format!("{loading:.1}"),
        format!("{steady_n:.2}"),
        format!("{:.2}", steady_n / griffith_n),
        format!("{:.2}", run.pull_n()),
    ]
}

/// Computed over measured force while the surface is dented.
fn loading_ratio(run: &Run) -> f64 {
    run.mean_force_n(0.9 * LOADING_M, 1.1 * LOADING_M) / loading_n(LOADING_M)
}
