//! Runs every verification case, writes their tables with an index and plots, and from the tables the page.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use kerf_system_tests::rows::write_commit;
use kerf_system_tests::verification::page::Tables;
use kerf_system_tests::verification::{Extent, FAMILIES, link_rule, report, tables};

/// Verifies the physics and writes what came of it.
#[derive(Parser)]
struct Options {
    /// Writes the page from the tables as they are, without a run.
    #[arg(long)]
    page_only: bool,
}

fn main() -> Result<()> {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    let folder = docs.join("reference/verification");
    if !Options::parse().page_only {
        run(&folder)?;
    }
    let tables = Tables::read(&folder)?;
    tables.margins().draw(&folder)?;
    write(docs.join("explanation/verification.md"), &tables.page())
}

fn run(folder: &Path) -> Result<()> {
    let bar = ProgressBar::new(FAMILIES.len() as u64 + 1);
    bar.set_style(ProgressStyle::with_template("{bar:24} {pos}/{len} {msg} {elapsed}")?);
    let mut families = Vec::new();
    for (name, family) in FAMILIES {
        bar.set_message(name);
        families.push(family(Extent::Full).with_context(|| format!("family {name}"))?);
        bar.inc(1);
    }
    bar.set_message("two fracture rules");
    let rules = link_rule::compare(Extent::Full).context("two fracture rules")?;
    rules.figure().draw(folder)?;
    families.push(rules.family());
    bar.finish_and_clear();
    for family in &families {
        tables::write(folder, family.title, &tables::figures(family))?;
        family.studies.iter().try_for_each(|study| study.figure().draw(folder).map(|_| ()))?;
        family.figures.iter().try_for_each(|figure| figure.draw(folder).map(|_| ()))?;
    }
    write_commit(folder)?;
    write(folder.join("README.md"), &report::index(&families))
}

fn write(path: PathBuf, text: &str) -> Result<()> {
    std::fs::write(&path, text).with_context(|| path.display().to_string())
}
