//! Dices models at random and writes what came of it, as Markdown.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Parser;
use kerf_physics::SoundScene;
use kerf_system_tests::dicing::campaign::{Tally, dice, model};
use kerf_system_tests::dicing::report::Report;
use kerf_system_tests::strokes::campaign::seeds;
use serde::{Deserialize, Serialize};

/// How long a run that is cut off may have gone on since it last left its figures.
const REPORT_EVERY: Duration = Duration::from_secs(60);

/// Dices each model at random; the same seed gives the same dicings.
#[derive(Parser)]
struct Options {
    /// Where the report goes.
    out: PathBuf,
    /// Built-in scenes.
    #[arg(default_values = ["liver", "liver-tissue", "gummy-bear", "cuboid", "jelly"])]
    models: Vec<String>,
    /// Dicings of each model.
    #[arg(long, default_value_t = 200)]
    dicings: usize,
    /// Plunges of a dicing.
    #[arg(long, default_value_t = 20)]
    plunges: u32,
    /// Chooses the dicings.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Voxels along a model's longest edge; absent: as many as it has.
    #[arg(long)]
    resolution: Option<u32>,
    /// Dicings that are made, one a line: a run goes on from those that it finds here. They are of one physics: remove
    /// the file when that changes.
    #[arg(long)]
    made: Option<PathBuf>,
    /// Threads, each with a dicing of its own.
    #[arg(long, default_value_t = 2)]
    threads: usize,
}

/// Each model's name, and its dicings.
type Dicings = Vec<(String, Vec<Tally>)>;

/// A line of the file of dicings made.
#[derive(Serialize, Deserialize)]
struct Made {
    model: String,
    tally: Tally,
}

/// A run as it goes on: which dicing is next, what came of those before, and when that was last written.
struct Run<'a> {
    options: &'a Options,
    scenes: &'a [SoundScene],
    next: Mutex<std::vec::IntoIter<(usize, u64)>>,
    done: Mutex<(Dicings, Instant)>,
}

impl Run<'_> {
    fn work(&self) -> Result<()> {
        while let Some((index, seed)) = self.take() {
            let tally = dice(&self.scenes[index], seed, self.options.plunges)?;
            let mut done = self.done.lock().expect("no thread panics that holds it");
            if let Some(made) = &self.options.made {
                let mut file = OpenOptions::new().create(true).append(true).open(made)?;
                let line = Made { model: self.options.models[index].clone(), tally: tally.clone() };
                // At once: a run that is killed leaves whole lines.
                file.write_all((serde_json::to_string(&line)? + "\n").as_bytes())?;
            }
            done.0[index].1.push(tally);
            if done.1.elapsed() > REPORT_EVERY {
                done.1 = Instant::now();
                self.write(&mut done.0)?;
            }
        }
        Ok(())
    }

    fn take(&self) -> Option<(usize, u64)> {
        self.next.lock().expect("no thread panics that holds it").next()
    }

    /// Writes the report of the dicings made, whichever came first in the order of their seeds.
    fn write(&self, models: &mut [(String, Vec<Tally>)]) -> Result<()> {
        let Options { out, dicings, plunges, seed, resolution, .. } = self.options;
        let resolution = resolution.map_or(String::new(), |resolution| format!(" --resolution {resolution}"));
        let names = models.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(" ");
        let command = format!("dice {names} --dicings {dicings} --plunges {plunges} --seed {seed}{resolution}");
        models.iter_mut().for_each(|(_, tallies)| tallies.sort_by_key(|tally| tally.seed));
        let text = Report { command, models }.markdown();
        let part = out.with_extension("part");
        std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, out))?;
        let made: Vec<String> = models.iter().map(|(name, tallies)| format!("{name} {}", tallies.len())).collect();
        println!("{} of {dicings} each; see {}", made.join(", "), out.display());
        Ok(())
    }
}

/// The dicings of `models` that a run before this one made.
fn made_before(options: &Options) -> Result<Dicings> {
    let mut dicings: Dicings = options.models.iter().map(|name| (name.clone(), Vec::new())).collect();
    let Some(made) = options.made.as_ref().filter(|made| made.exists()) else { return Ok(dicings) };
    for line in std::fs::read_to_string(made)?.lines() {
        let Made { model, tally } = serde_json::from_str(line).with_context(|| made.display().to_string())?;
        if let Some((_, tallies)) = dicings.iter_mut().find(|(name, _)| *name == model) {
            tallies.push(tally);
        }
    }
    Ok(dicings)
}

fn main() -> Result<()> {
    let options = Options::parse();
    let scene = |name: &String| model(name, options.resolution).with_context(|| name.clone());
    let scenes = options.models.iter().map(scene).collect::<Result<Vec<SoundScene>>>()?;
    // Model after model: a run that is cut off has diced all of them about as often.
    let made = made_before(&options)?;
    let all: Vec<(usize, u64)> = seeds(options.seed)
        .take(options.dicings)
        .flat_map(|seed| (0..scenes.len()).map(move |of| (of, seed)))
        .filter(|&(of, seed)| made[of].1.iter().all(|tally| tally.seed != seed))
        .collect();
    let run = Run {
        options: &options,
        scenes: &scenes,
        next: Mutex::new(all.into_iter()),
        done: Mutex::new((made, Instant::now())),
    };
    // A dicing that panics is a line of the report, not of the terminal.
    std::panic::set_hook(Box::new(|_| ()));
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..options.threads).map(|_| scope.spawn(|| run.work())).collect();
        threads.into_iter().try_for_each(|thread| thread.join().expect("dicings' panics are caught"))
    })?;
    run.write(&mut run.done.lock().expect("no thread panics that holds it").0)
}
