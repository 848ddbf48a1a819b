//! Runs the matrix of extremes and writes what came of it, as Markdown.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use kerf_system_tests::extremes::properties::{PROPERTIES, Property};
use kerf_system_tests::extremes::refusals::refusals;
use kerf_system_tests::extremes::report::Report;
use kerf_system_tests::extremes::{Budget, matrix, run_all};
use rayon::prelude::*;

/// Cases at places that the seed chooses.
const RANDOM_CASES: usize = 40;
/// Inputs that each property is tried on.
const PROPERTY_INPUTS: u32 = 200;
const BUDGET: Budget = Budget { most_steps: 2500 };

/// Runs the matrix of extremes; the report has no times in it, so the same seed gives the same bytes.
#[derive(Parser)]
struct Options {
    /// Where the report goes.
    out: PathBuf,
    /// Runs only the cases whose name holds this; with them the properties and refusals.
    #[arg(long)]
    only: Option<String>,
    /// Chooses the random cases and the inputs of the properties.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

fn main() -> Result<()> {
    let options = Options::parse();
    // A case that panics is a line of the report, not of the terminal.
    std::panic::set_hook(Box::new(|_| ()));
    let mut cases = matrix(options.seed, RANDOM_CASES);
    if let Some(only) = &options.only {
        cases.retain(|case| case.name.contains(only));
    }
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} {eta} left {msg}").context("a sound template")?;
    let progress = ProgressBar::new((cases.len() + PROPERTIES.len()) as u64).with_style(style);
    let rows = run_all(&cases, BUDGET, |row| {
        progress.inc(1);
        progress.set_message(row.name.clone());
    });
    let try_out = |(name, property): &Property| {
        let outcome = property(options.seed, PROPERTY_INPUTS);
        progress.inc(1);
        (*name, PROPERTY_INPUTS, outcome)
    };
    let properties: Vec<_> = PROPERTIES.par_iter().map(try_out).collect();
    progress.finish_and_clear();
    let refusals = refusals();
    let report = Report { seed: options.seed, rows: &rows, refusals: &refusals, properties: &properties };
    std::fs::write(&options.out, report.markdown()).with_context(|| options.out.display().to_string())?;
    let open = rows.iter().filter(|row| !row.findings.is_empty()).count();
    println!("{} of {} cases hold; see {}", rows.len() - open, rows.len(), options.out.display());
    Ok(())
}
