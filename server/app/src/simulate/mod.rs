//! `kerf-server simulate`: a scene without a network, into files.

pub mod script;
pub mod stroke;
pub mod summary;
pub mod surface;
pub mod tables;

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use kerf_physics::scene::DialDesc;
use kerf_physics::{Scene, Workers, World};
use kerf_replica::glb;
use kerf_scenes::catalog;
use kerf_scenes::dial::ParetoFronts;
use kerf_session::LoggedInputs;
use kerf_session::clock::MonotonicClock;

use crate::recording::Recording;
use script::Script;
use summary::{Summary, Tally};
use tables::Tables;

/// Simulated time after the script's end, s: what was cut comes to rest.
pub const AFTER_SCRIPT_S: f64 = 0.2;
/// Most steps of one run: their rows fill some gigabytes.
const MAX_STEPS: f64 = 1e7;

/// Options of a run.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// Name of a built-in scene, or path of a scene's TOML file.
    pub scene: String,
    /// Poses over time, header `time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw`; `lift` for x_m lifts the tool. With
    /// `,opening` for tools with jaws, 0 (closed) to 1.
    /// Default: one stroke straight down through the middle of the first object that can be cut.
    #[arg(long, value_name = "FILE.csv", conflicts_with = "quasi_static")]
    pub script: Option<PathBuf>,
    /// Inputs of a session that a server with `record_dir` has recorded: the same steps once more, on the
    /// scene the session was of.
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["script", "duration", "DialOptions", "rate", "quasi_static"])]
    pub replay: Option<PathBuf>,
    /// Simulated time, s. Default: the script's length and 0.2 s.
    #[arg(long, value_name = "S", conflicts_with = "quasi_static")]
    pub duration: Option<f64>,
    /// What the dial is set to, instead of what the scene asks.
    #[command(flatten)]
    pub dial: DialOptions,
    /// Folder of measured Pareto fronts that go before those that come with the program.
    #[arg(long, value_name = "DIR")]
    pub pareto_fronts: Option<PathBuf>,
    /// Steps per simulated second instead of the scene's.
    #[arg(long, value_name = "HZ")]
    pub rate: Option<f64>,
    /// Threads lent to the steps. Default: as many as the machine has. The result does not depend on it.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Takes the scene to rest under its loads, tools lifted, instead of stepping through time.
    #[arg(long)]
    pub quasi_static: bool,
    /// Folder for tool.csv, energy.csv, tracked_points.csv, profile.csv, surface.glb and summary.json.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// What a run asks of the dial from fast to exact.
#[derive(Args, Clone, Debug, Default)]
#[group(multiple = false)]
pub struct DialOptions {
    /// Level of every object instead of the scene's: elements of 2^LEVEL voxels a side.
    #[arg(long)]
    pub level: Option<u8>,
    /// The most exact measured setting whose steps take at most this long in the median, ms.
    #[arg(long, value_name = "MS")]
    pub budget_ms: Option<f64>,
    /// The cheapest measured setting that errs by at most this, relative to the reference solution.
    #[arg(long, value_name = "ERROR")]
    pub max_error: Option<f64>,
}

impl DialOptions {
    fn asked(&self) -> Option<DialDesc> {
        let level = self.level.map(DialDesc::Level);
        level.or(self.budget_ms.map(DialDesc::BudgetMs)).or(self.max_error.map(DialDesc::MaxError))
    }
}

/// Runs a scene and writes its files.
///
/// # Errors
/// The scene or the script cannot be read or is not sound, or a file cannot be written.
pub fn run(options: &Options) -> Result<()> {
    let scene = load(options)?;
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let threads = options.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    ensure!((1..=256).contains(&threads), "--threads {threads} is not between 1 and 256");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let workers = Workers::of(&pool);

    let mut world = World::new(&scene)?;
    let tables = Tables::create(&options.out, &scene.desc)?;
    let mut recorded_hash = None;
    let measured = if options.quasi_static {
        relax(&mut world, &workers, tables)?
    } else if let Some(path) = &options.replay {
        let recording = Recording::read(path, scene.desc.tools.len())?;
        recorded_hash = recording.state_hash;
        step(&mut world, &workers, recording.log.inputs(), tables, recording.log.steps())?
    } else {
        let mut script = read_script(options.script.as_deref(), &scene)?;
        let duration_s = options.duration.unwrap_or(script.end_s() + AFTER_SCRIPT_S);
        let (rate_hz, steps) = (scene.desc.rate_hz, (duration_s * scene.desc.rate_hz).round());
        ensure!((1.0..=MAX_STEPS).contains(&steps), "{duration_s} s make {steps} steps, not 1 to {MAX_STEPS}");
        let steps = steps as u64;
        let inputs = (1..=steps).map(|index| script.advance(index as f64 / rate_hz).into());
        step(&mut world, &workers, inputs, tables, steps)?
    };
    let summary = Summary {
        scene: scene.desc.name.clone(),
        rate_hz: scene.desc.rate_hz,
        levels: scene.desc.objects.iter().map(|object| object.level).collect(),
        threads,
        ..measured
    };
    write_results(&options.out, &mut world, &summary)?;
    println!("{}", serde_json::to_string_pretty(&summary)?);
    ensure!(summary.converged != Some(false), "no rest was found; see relaxed_residual");
    ensure!(
        recorded_hash.is_none_or(|hash| hash == world.state_hash()),
        "the replay ends in another state than the session did: another scene, or another build"
    );
    Ok(())
}

/// The scene with what the options change in it.
fn load(options: &Options) -> Result<Scene> {
    let mut scene = catalog::load(&options.scene)?;
    scene.desc.rate_hz = options.rate.unwrap_or(scene.desc.rate_hz);
    let pareto_fronts = match &options.pareto_fronts {
        Some(folder) => ParetoFronts::builtin().with_folder(folder).context("--pareto-fronts")?,
        None => ParetoFronts::builtin(),
    };
    if let Some(choice) = pareto_fronts.settle(&mut scene, options.dial.asked())? {
        eprintln!("{choice}");
    }
    match scene.problems().into_iter().next() {
        Some(problem) => Err(problem).context("with --rate applied"),
        None => Ok(scene),
    }
}

/// The script in a file; without one the scene's default stroke.
///
/// # Errors
/// The file cannot be read or is not a script for the scene's tools, or the scene cannot be voxelized.
pub fn read_script(path: Option<&Path>, scene: &Scene) -> Result<Script> {
    let Some(path) = path else { return stroke::default_stroke(scene) };
    let file = File::open(path).with_context(|| path.display().to_string())?;
    let tools: Vec<_> = scene.desc.tools.iter().map(|tool| tool.name.clone()).collect();
    Ok(kerf_script::read(file, &tools).with_context(|| path.display().to_string())?.into())
}

fn step(
    world: &mut World,
    workers: &Workers<'_>,
    inputs: impl Iterator<Item = LoggedInputs>,
    mut tables: Tables,
    steps: u64,
) -> Result<Summary> {
    let clock = MonotonicClock;
    let progress = ProgressBar::new(steps).with_style(
        ProgressStyle::with_template("{bar:40} {pos}/{len} steps, {per_sec}, {eta} left {msg}")
            .expect("the template is sound"),
    );
    let mut tally = Tally::default();
    for inputs in inputs {
        let output = world.step(workers, &clock, &inputs.as_inputs());
        if let Some(fault) = &output.fault {
            // Not `println` of the bar: that says nothing where there is no terminal.
            progress.suspend(|| eprintln!("step {}: {:?} in {}, rolled back", fault.step, fault.what, fault.object));
        }
        tally.push(output);
        tables.push(output)?;
        progress.inc(1);
    }
    progress.finish_and_clear();
    tables.finish()?;
    Ok(tally.summary(world))
}

fn relax(world: &mut World, workers: &Workers<'_>, mut tables: Tables) -> Result<Summary> {
    let progress = ProgressBar::new_spinner();
    let relaxation = world.relax(workers, &mut |residual| {
        progress.set_message(format!("relative residual {residual:.2e}"));
        progress.inc(1);
    });
    progress.finish_and_clear();
    tables.push(world.output())?;
    tables.finish()?;
    Ok(Summary {
        relaxed_residual: Some(relaxation.relative_residual),
        converged: Some(relaxation.converged),
        ..Tally::default().summary(world)
    })
}

fn write_results(folder: &Path, world: &mut World, summary: &Summary) -> Result<()> {
    let surface = folder.join("surface.glb");
    glb::write(&surface, &surface::of(world)).with_context(|| surface.display().to_string())?;
    let path = folder.join("summary.json");
    std::fs::write(&path, serde_json::to_string_pretty(summary)? + "\n").with_context(|| path.display().to_string())
}
