//! What bounded work saves and costs: the tail of a step, against the force.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;

use super::run::{Run, Stroke, builtin, cell, mean, quantile};

/// Steps of 1 kHz from one model to the next, as a station asks for them.
const STEPS_PER_MODEL: usize = 4;
/// Budgets over the median work of a step that touches.
const SHARES: [f64; 5] = [4.0, 2.0, 1.5, 1.0, 0.75];
/// Error over the greatest force from which on it is counted how long it lasts.
const LARGE: f64 = 0.05;

pub fn section(_plots: &Path) -> Result<String> {
    let mut text = String::from(
        "\n## A step with a budget of work\n\nThe liver at 1 kHz, one thread, with a contact model every 4 ms. A session bounds the work \
         of a step by the time it has ([solver](solver.md)); here the budget is stated, over the median work of a step in \
         which the blade touches. The error is that of the force on the blade against unbounded work, over the greatest force.\n\n\
         | budget | step, p50, ms | p99, ms | greatest, ms | work, p99 over p50 | force, rms | greatest | longest above 5 %, ms |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    let scene = builtin("liver")?;
    let stroke = Stroke { steps_per_model: STEPS_PER_MODEL, ..Stroke::ALONE };
    let whole = stroke.run(&scene)?;
    row(&mut text, "none", &whole, &whole)?;
    let median = quantile(touching(&whole).map(|sample| sample.work_units as f64), 0.5);
    for share in SHARES {
        let bounded = Stroke { work_units: Some((share * median) as u64), ..stroke }.run(&scene)?;
        row(&mut text, &share.to_string(), &bounded, &whole)?;
    }
    Ok(text)
}

fn touching(run: &Run) -> impl Iterator<Item = &super::run::Sample> + Clone {
    run.samples.iter().filter(|sample| sample.force_n.norm() > 0.0)
}

fn row(text: &mut String, name: &str, run: &Run, whole: &Run) -> Result<()> {
    let ms = |share| cell(quantile(touching(run).map(|sample| sample.total_ms), share));
    let units = |share| quantile(touching(run).map(|sample| sample.work_units as f64), share);
    let most_n = whole.samples.iter().map(|sample| sample.force_n.norm()).fold(0.0, f64::max);
    let errors = || run.samples.iter().zip(&whole.samples).map(|(a, b)| (a.force_n - b.force_n).norm() / most_n);
    let rms = mean(errors().map(|error| error * error)).sqrt();
    let (mut longest, mut lasts) = (0, 0);
    for error in errors() {
        lasts = if error > LARGE { lasts + 1 } else { 0 };
        longest = longest.max(lasts);
    }
    let [p50, p99, most] = [0.5, 0.99, 1.0].map(ms);
    let tail = cell(units(0.99) / units(0.5));
    let greatest = errors().fold(0.0, f64::max);
    writeln!(text, "| {name} | {p50} | {p99} | {most} | {tail} | {rms:.1e} | {greatest:.1e} | {longest} |")?;
    Ok(())
}
