//! Measures every section of `docs/explanation/performance.md` anew and writes it with its plots.

use std::path::Path;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use kerf_system_tests::performance::{SECTIONS, header};

fn main() -> Result<()> {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/explanation");
    let bar = ProgressBar::new(SECTIONS.len() as u64);
    bar.set_style(ProgressStyle::with_template("{bar:24} {pos}/{len} {msg} {elapsed}")?);
    let mut text = header();
    for (name, section) in SECTIONS {
        bar.set_message(name);
        text += &section(&docs).with_context(|| format!("section {name}"))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let path = docs.join("performance.md");
    std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    Ok(())
}
