//! Cuts models by thousands of random strokes and writes what came of it, as Markdown.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Parser;
use kerf_system_tests::strokes::campaign::{Tally, run};
use kerf_system_tests::strokes::memory::resident_bytes;
use kerf_system_tests::strokes::model::Model;
use kerf_system_tests::strokes::report::{Report, row};

/// How long a run that is cut off may have gone on since it last left its figures.
const REPORT_EVERY: Duration = Duration::from_secs(60);

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

/// The figures of a run as it goes on.
struct Run<'a> {
    options: &'a Options,
    command: String,
    began: Instant,
    resident: Resident,
    /// By model, and when they were last written.
    tallies: Mutex<(Vec<Tally>, Instant)>,
}

impl<'a> Run<'a> {
    fn new(options: &'a Options, models: &[Model]) -> Self {
        let names: Vec<&str> = models.iter().map(|model| model.name.as_str()).collect();
        let Options { strokes, resolution, .. } = options;
        let command = format!("strokes {} --strokes {strokes} --resolution {resolution}", names.join(" "));
        let began = Instant::now();
        let tallies = names.iter().map(|name| Tally { name: (*name).to_owned(), ..Tally::default() });
        let tallies = Mutex::new((tallies.collect(), began));
        Self { options, command, began, resident: Resident::default(), tallies }
    }

    /// Takes a model's figures after a stroke; each minute writes those of all.
    fn take(&self, model: usize, tally: &Tally) -> Result<()> {
        let mut guard = self.tallies.lock().expect("no thread panics that holds it");
        let (tallies, written) = &mut *guard;
        self.resident.look(self.options.strokes * tallies.len() as u32);
        tallies[model].clone_from(tally);
        if written.elapsed() > REPORT_EVERY {
            *written = Instant::now();
            self.write(tallies)?;
        }
        Ok(())
    }

    /// Writes the report and says how far the run is.
    fn write(&self, tallies: &[Tally]) -> Result<()> {
        let Options { out, strokes, seed, .. } = self.options;
        let resident_mb = self.resident.mb();
        let report = Report { command: &self.command, seed: *seed, strokes: *strokes, tallies, resident_mb };
        replace(out, &report.markdown()).with_context(|| out.display().to_string())?;
        let made = tallies.iter().map(|tally| format!("{} {}", tally.name, tally.strokes)).collect::<Vec<_>>();
        let failures: u32 = tallies.iter().map(|tally| tally.failures).sum();
        let minutes = self.began.elapsed().as_secs_f64() / 60.0;
        println!("{minutes:.1} min, strokes {} of {strokes} each: {failures} failures", made.join(", "));
        Ok(())
    }
}

/// Writes a file so that whoever reads it finds the old text or the new one.
fn replace(path: &Path, text: &str) -> std::io::Result<()> {
    let beside = path.with_extension("part");
    std::fs::write(&beside, text)?;
    std::fs::rename(beside, path)
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
    let run_of_all = Run::new(&options, &models);
    let cut = &|index: usize, model: &Model| -> Result<Tally> {
        let tally = run(model, options.strokes, options.seed, |tally| {
            if let Err(error) = run_of_all.take(index, tally) {
                println!("{error:#}");
            }
        })?;
        println!("{}", row(&tally));
        Ok(tally)
    };
    // A thread to each, whatever the machine has: a run that is cut off has cut them all.
    let tallies = std::thread::scope(|scope| {
        let threads: Vec<_> = models.iter().enumerate().map(|(i, model)| scope.spawn(move || cut(i, model))).collect();
        threads.into_iter().map(|thread| thread.join().expect("strokes' panics are caught")).collect::<Result<Vec<_>>>()
    })?;
    run_of_all.write(&tallies)?;
    println!("see {}", options.out.display());
    Ok(())
}
