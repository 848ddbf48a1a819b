//! Cuts models by thousands of random strokes, writes what came of it as tables, and from these the page and its figure.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Parser;
use kerf_system_tests::rows::{read, read_commit, write as write_rows, write_commit};
use kerf_system_tests::strokes::bodies::{BodyRow, figure};
use kerf_system_tests::strokes::campaign::{Tally, cut, seeds};
use kerf_system_tests::strokes::model::Model;
use kerf_system_tests::strokes::report::{Asked, Row, page};

/// How long a run that is cut off may have gone on since it last left its figures.
const REPORT_EVERY: Duration = Duration::from_secs(60);

/// Cuts each model by random strokes; the same seed gives the same strokes.
#[derive(Parser)]
struct Options {
    /// Folder of the project's documents.
    docs: PathBuf,
    /// Names of built-in scenes, or paths of meshes; one that is absent is passed over with a word.
    #[arg(default_value = "liver")]
    models: Vec<String>,
    /// Strokes through each model, at least: a body that was begun is cut to its end.
    #[arg(long, default_value_t = 100)]
    strokes: u32,
    /// Chooses the strokes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Strokes through one body, at most.
    #[arg(long, default_value_t = 8)]
    per_body: u32,
    /// Voxels along a model's longest edge.
    #[arg(long, default_value_t = 20)]
    resolution: u32,
    /// Folder of the bodies' figures; those that stand there are not taken again.
    #[arg(long)]
    bodies: PathBuf,
    /// Writes the page and its figure from the tables as they are, without a run.
    #[arg(long)]
    page_only: bool,
}

impl Options {
    fn folder(&self) -> PathBuf {
        self.docs.join("reference/strokes")
    }

    fn page(&self) -> PathBuf {
        self.docs.join("explanation/strokes.md")
    }

    /// The page and its figure, from the tables.
    fn write_page(&self) -> Result<()> {
        let folder = self.folder();
        let rows: Vec<Row> = read(&folder.join("strokes.csv"))?;
        let bodies: Vec<BodyRow> = read(&folder.join("bodies.csv"))?;
        figure(&bodies).draw(&folder)?;
        let path = self.page();
        replace(&path, &page(&rows, &read_commit(&folder)?)).with_context(|| path.display().to_string())
    }
}

/// The bodies of one model, in the order of their seeds.
struct Bodies<'a> {
    model: &'a Model,
    seeds: Box<dyn Iterator<Item = u64> + Send>,
    /// `None` while it is being cut.
    tallies: Vec<Option<Tally>>,
}

impl<'a> Bodies<'a> {
    fn new(model: &'a Model, seed: u64) -> Self {
        Self { model, seeds: Box::new(seeds(seed)), tallies: Vec::new() }
    }

    /// Strokes made, in whatever order.
    fn strokes(&self) -> u32 {
        self.tallies.iter().flatten().map(|tally| tally.strokes).sum()
    }

    /// Whether the bodies before the first that is being cut hold so many strokes: whatever threads do, the
    /// figures of a whole run are those of the same bodies.
    fn hold(&self, strokes: u32) -> bool {
        self.tallies.iter().map_while(|tally| tally.as_ref().map(|t| t.strokes)).sum::<u32>() >= strokes
    }

    fn sum(&self, strokes: u32) -> Tally {
        Tally::sum(self.tallies.iter().flatten().cloned(), strokes)
    }

    /// Rows of the bodies of which [`Self::sum`] is made; `seed` is the run's.
    fn rows(&self, seed: u64, strokes: u32) -> impl Iterator<Item = BodyRow> {
        let cut = seeds(seed).zip(&self.tallies).filter_map(|(seed, tally)| Some((seed, tally.as_ref()?)));
        let summed = cut.take(self.sum(strokes).bodies as usize);
        summed.map(|(seed, tally)| BodyRow::new(&self.model.name, seed, tally))
    }
}

/// A run as it goes on.
struct Run<'a> {
    options: &'a Options,
    began: Instant,
    /// One for each model, and when the report was last written.
    state: Mutex<(Vec<Bodies<'a>>, Instant)>,
}

impl<'a> Run<'a> {
    /// Cuts body after body, each of the model that has the fewest strokes, until all have enough.
    fn work(&self) -> Result<()> {
        while let Some((index, body, seed, model)) = self.next() {
            let tally = self.figures(model, seed)?;
            let mut guard = self.state.lock().expect("no thread panics that holds it");
            let (bodies, written) = &mut *guard;
            bodies[index].tallies[body] = Some(tally);
            if written.elapsed() > REPORT_EVERY {
                *written = Instant::now();
                self.write(bodies)?;
            }
        }
        Ok(())
    }

    /// A body's figures as they stand in the folder, else anew.
    fn figures(&self, model: &Model, seed: u64) -> Result<Tally> {
        let Options { per_body, resolution, bodies, .. } = self.options;
        let path = bodies.join(format!("{}-{resolution}-{per_body}-{seed:016x}.json", model.name));
        // A file that is cut short is none.
        let standing = std::fs::read_to_string(&path).ok().and_then(|text| serde_json::from_str(&text).ok());
        if let Some(tally) = standing {
            return Ok(tally);
        }
        let tally = cut(model, seed, *per_body)?;
        std::fs::write(&path, serde_json::to_string(&tally)?).with_context(|| path.display().to_string())?;
        Ok(tally)
    }

    fn next(&self) -> Option<(usize, usize, u64, &Model)> {
        let mut guard = self.state.lock().expect("no thread panics that holds it");
        let unfinished = guard.0.iter_mut().enumerate().filter(|(_, bodies)| !bodies.hold(self.options.strokes));
        let (index, bodies) = unfinished.min_by_key(|(_, bodies)| bodies.strokes())?;
        let seed = bodies.seeds.next()?;
        bodies.tallies.push(None);
        Some((index, bodies.tallies.len() - 1, seed, bodies.model))
    }

    /// Writes tables and page and says how far the run is.
    fn write(&self, bodies: &[Bodies<'a>]) -> Result<()> {
        let Options { strokes, seed, per_body, resolution, .. } = *self.options;
        let asked = Asked { seed, strokes, per_body, resolution };
        let row =
            |of: &Bodies<'a>| Row::new(&of.model.name, asked, of.sum(strokes), of.sum(strokes / 10).resident_bytes);
        let models: Vec<_> = bodies.iter().map(row).collect();
        let folder = self.options.folder();
        write_rows(&folder.join("strokes.csv"), &models)?;
        let cut: Vec<_> = bodies.iter().flat_map(|of| of.rows(seed, strokes)).collect();
        write_rows(&folder.join("bodies.csv"), &cut)?;
        write_commit(&folder)?;
        self.options.write_page()?;
        let made = models.iter().map(|model| format!("{} {}", model.model, model.strokes)).collect::<Vec<_>>();
        let failures: u32 = models.iter().map(|model| model.failures).sum();
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
    if options.page_only {
        return options.write_page();
    }
    std::fs::create_dir_all(&options.bodies).with_context(|| options.bodies.display().to_string())?;
    let mut models = Vec::new();
    for name in &options.models {
        if Path::new(name).extension().is_some() && !Path::new(name).is_file() {
            println!("{name} is absent: passed over");
            continue;
        }
        models.push(Model::new(name, options.resolution).with_context(|| name.clone())?);
    }
    // A stroke that panics is a line of the report, not of the terminal.
    std::panic::set_hook(Box::new(|_| ()));
    let began = Instant::now();
    let bodies = models.iter().map(|model| Bodies::new(model, options.seed)).collect();
    let run = Run { options: &options, began, state: Mutex::new((bodies, began)) };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(|| run.work())).collect();
        threads.into_iter().try_for_each(|thread| thread.join().expect("strokes' panics are caught"))
    })?;
    run.write(&run.state.lock().expect("no thread panics that holds it").0)?;
    println!("see {}", options.page().display());
    Ok(())
}
