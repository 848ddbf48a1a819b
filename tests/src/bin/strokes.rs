//! Cuts models by thousands of random strokes and writes what came of it, as Markdown.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use anyhow::{Context, Result};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use kerf_system_tests::strokes::campaign::{Tally, run};
use kerf_system_tests::strokes::memory::resident_bytes;
use kerf_system_tests::strokes::model::Model;
use kerf_system_tests::strokes::report::{Report, row};
use rayon::prelude::*;

/// Cuts each model by random strokes; the same seed gives the same strokes.
#[derive(Parser)]
struct Options {
    /// Where the report goes.
    out: PathBuf,
    /// `liver`, or the paths of meshes; one that is absent is passed over with a word.
    #[arg(default_value = "liver")]
    models: Vec<String>,
    /// Strokes through each model.
    #[arg(long, default_value_t = 100)]
    strokes: u32,
    /// Chooses the strokes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Voxels along a model's longest edge.
    #[arg(long, default_value_t = 40)]
    resolution: u32,
}

/// Highest resident set of the process, bytes: in the first tenth of the strokes, and of all.
#[derive(Default)]
struct Resident {
    strokes: AtomicU32,
    early: AtomicU64,
    most: AtomicU64,
}

impl Resident {
    fn look(&self, all_strokes: u32) {
        let Some(bytes) = resident_bytes() else { return };
        self.most.fetch_max(bytes, Ordering::Relaxed);
        if self.strokes.fetch_add(1, Ordering::Relaxed) < all_strokes / 10 {
            self.early.fetch_max(bytes, Ordering::Relaxed);
        }
    }

    fn mb(&self) -> Option<[f64; 2]> {
        let mb = [&self.early, &self.most].map(|bytes| bytes.load(Ordering::Relaxed) as f64 * 1e-6);
        (mb[1] > 0.0).then_some(mb)
    }
}

fn main() -> Result<()> {
    let options = Options::parse();
    let mut models = Vec::new();
    for name in &options.models {
        if name != "liver" && !PathBuf::from(name).is_file() {
            println!("{name} is absent: passed over");
            continue;
        }
        models.push(Model::new(name, options.resolution).with_context(|| name.clone())?);
    }
    // A stroke that panics is a line of the report, not of the terminal.
    std::panic::set_hook(Box::new(|_| ()));
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} {eta} left {msg}").context("a sound template")?;
    let all_strokes = options.strokes * models.len() as u32;
    let progress = ProgressBar::new(u64::from(all_strokes)).with_style(style);
    let resident = Resident::default();
    let done = |tally: &Tally| {
        resident.look(all_strokes);
        progress.inc(1);
        progress.set_message(format!("{} failures of {}", tally.failures, tally.name));
    };
    let cut = |model: &Model| -> Result<Tally> {
        let tally = run(model, options.strokes, options.seed, done)?;
        progress.suspend(|| println!("{}", row(&tally)));
        Ok(tally)
    };
    let tallies = models.par_iter().map(cut).collect::<Result<Vec<_>>>()?;
    progress.finish_and_clear();
    let names: Vec<String> = tallies.iter().map(|tally| tally.name.clone()).collect();
    let command =
        format!("strokes {} --strokes {} --resolution {}", names.join(" "), options.strokes, options.resolution);
    let report = Report { command: &command, seed: options.seed, tallies: &tallies, resident_mb: resident.mb() };
    std::fs::write(&options.out, report.markdown()).with_context(|| options.out.display().to_string())?;
    let failures: u32 = tallies.iter().map(|tally| tally.failures).sum();
    println!("{failures} failures; see {}", options.out.display());
    Ok(())
}
