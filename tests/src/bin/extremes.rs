//! Runs the matrix of extremes, writes what came of it as tables, and from these the page.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use kerf_system_tests::extremes::properties::{PROPERTIES, Property as Tried};
use kerf_system_tests::extremes::refusals::refusals;
use kerf_system_tests::extremes::tables::{Property, Tables};
use kerf_system_tests::extremes::{Budget, matrix, run_all};
use kerf_system_tests::rows::read_commit;
use rayon::prelude::*;

/// Cases at places that the seed chooses.
const RANDOM_CASES: usize = 40;
/// Inputs that each property is tried on.
const PROPERTY_INPUTS: u32 = 200;
const BUDGET: Budget = Budget { most_steps: 2500 };

/// Runs the matrix of extremes; the files have no times in them, so the same seed gives the same bytes.
#[derive(Parser)]
struct Options {
    /// Folder of the project's documents.
    docs: PathBuf,
    /// Runs only the cases whose name has this in it; with them the properties and refusals.
    #[arg(long)]
    only: Option<String>,
    /// Chooses the random cases and the inputs of the properties.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Writes the page from the tables as they are, without a run.
    #[arg(long)]
    page_only: bool,
}

fn main() -> Result<()> {
    let options = Options::parse();
    let folder = options.docs.join("reference/stability");
    if !options.page_only {
        run(&options)?.write(&folder)?;
    }
    let tables = Tables::read(&folder)?;
    tables.figure().draw(&folder)?;
    let page = options.docs.join("explanation/stability.md");
    std::fs::write(&page, tables.page(options.seed, &read_commit(&folder)?))
        .with_context(|| page.display().to_string())?;
    let holding = tables.cases.iter().filter(|case| case.holds()).count();
    println!("{holding} of {} cases hold; see {}", tables.cases.len(), page.display());
    Ok(())
}

fn run(options: &Options) -> Result<Tables> {
    // A case that panics is a line of the tables, not of the terminal.
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
    let try_out = |(name, property): &Tried| {
        let outcome = property(options.seed, PROPERTY_INPUTS);
        progress.inc(1);
        let verdict = outcome.map_or_else(|failure| failure.replace('\n', " "), |()| "holds".into());
        Property { property: (*name).to_owned(), inputs: PROPERTY_INPUTS, verdict }
    };
    let properties = PROPERTIES.par_iter().map(try_out).collect();
    progress.finish_and_clear();
    Ok(Tables {
        cases: rows.iter().map(Into::into).collect(),
        refusals: refusals().iter().map(Into::into).collect(),
        properties,
    })
}
