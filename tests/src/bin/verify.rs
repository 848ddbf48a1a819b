//! Runs every verification case and writes `docs/verification.md` with its plots.

use std::path::Path;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use kerf_system_tests::verification::{Extent, FAMILIES, link_rule, report};

fn main() -> Result<()> {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
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
    rules.figure().draw(&docs)?;
    families.push(rules.family());
    bar.finish_and_clear();
    for study in families.iter().flat_map(|f| &f.studies) {
        study.figure().draw(&docs)?;
    }
    for figure in families.iter().flat_map(|f| &f.figures) {
        figure.draw(&docs)?;
    }
    let path = docs.join("verification.md");
    std::fs::write(&path, report::markdown(&families)).with_context(|| path.display().to_string())?;
    Ok(())
}
