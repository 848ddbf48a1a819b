//! `kerf-server simulate`: a scene without a network, into files.

pub mod summary;
pub mod surface;
pub mod tables;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use indicatif::ProgressBar;
use kerf_physics::fault::Fault;
use kerf_physics::{Scene, SceneDesc, Workers, World};
use kerf_replica::glb;
use kerf_session::LoggedInputs;
use kerf_session::clock::MonotonicClock;

use crate::progress::{Progress, say};
use crate::scene_args::{Run, SceneArgs, WarningArgs};
use crate::script::Script;
use summary::{Summary, Tally};
use tables::Tables;

/// Simulated time after the script's end, s: what was cut comes to rest.
pub const AFTER_SCRIPT_S: f64 = 0.2;
/// Most steps of one run: their rows fill some gigabytes.
const MAX_STEPS: f64 = 1e7;

/// Options of a run.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// What is run.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Simulated time, s. Default: the script's length and 0.2 s.
    #[arg(long, value_name = "S", conflicts_with = "quasi_static")]
    pub duration: Option<f64>,
    /// Threads lent to the steps. Default: as many as the machine has. The result does not depend on it.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Takes the scene to rest under its loads, tools lifted, instead of stepping through time.
    #[arg(long, conflicts_with = "script")]
    pub quasi_static: bool,
    /// Folder for tool.csv, energy.csv, tracked_points.csv, profile.csv, surface.glb and summary.json. A run that
    /// stands there is replaced, unless it has more steps.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Runs a scene and writes its files.
///
/// # Errors
/// The scene or the script cannot be read or is not sound, or a file cannot be written.
pub fn run(options: &Options) -> Result<()> {
    let Run { scene, script, mut world, warnings } = options.scene.examine()?;
    WarningArgs::say(&warnings);
    options.scene.warnings.judge(warnings.len())?;
    let threads = options.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    ensure!((1..=256).contains(&threads), "--threads {threads} is not between 1 and 256");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let workers = Workers::of(&pool);

    let measured = if options.quasi_static {
        let tables = Tables::create(&options.out, &scene.desc, 1)?;
        relax(&mut world, &workers, tables)?
    } else {
        let mut script = script;
        let steps = steps(options, &scene, &script)?;
        // As a world counts time: a script of the times that a session told is met to the bit.
        let dt_s = 1.0 / scene.desc.rate_hz;
        let inputs = (1..=steps).map(|index| script.advance(index as f64 * dt_s).into());
        let tables = Tables::create(&options.out, &scene.desc, steps)?;
        step(&mut world, &workers, inputs, tables, steps)?
    };
    let summary = Summary {
        scene: scene.desc.name.clone(),
        rate_hz: scene.desc.rate_hz,
        levels: scene.desc.objects.iter().map(|object| object.level).collect(),
        threads,
        ..measured
    };
    write_results(&options.out, &scene.desc, &mut world, &summary)?;
    println!("{}", serde_json::to_string_pretty(&summary)?);
    ensure!(summary.converged != Some(false), "no rest was found; see relaxed_residual");
    let untouched = summary.tools_without_contact.iter();
    untouched.clone().for_each(|tool| say(&format!("warning: tool `{}` felt no force", scene.desc.tools[*tool].name)));
    options.scene.warnings.judge(untouched.len())
}

/// How many steps a script is run for.
fn steps(options: &Options, scene: &Scene, script: &Script) -> Result<u64> {
    let duration_s = options.duration.unwrap_or(script.end_s() + AFTER_SCRIPT_S);
    let steps = (duration_s * scene.desc.rate_hz).round();
    ensure!((1.0..=MAX_STEPS).contains(&steps), "{duration_s} s make {steps} steps, not 1 to {MAX_STEPS}");
    Ok(steps as u64)
}

fn step(
    world: &mut World,
    workers: &Workers<'_>,
    inputs: impl Iterator<Item = LoggedInputs>,
    mut tables: Tables,
    steps: u64,
) -> Result<Summary> {
    let clock = MonotonicClock;
    let mut progress = Progress::new(steps);
    let mut tally = Tally::default();
    for inputs in inputs {
        let output = world.step(workers, &clock, &inputs.as_inputs());
        if let Some(fault) = &output.fault {
            let Fault { step, object, what } = fault;
            progress.say(&format!("step {step}: {what} in `{object}` is not as it can be; the step was taken back"));
        }
        tally.push(output);
        tables.push(output)?;
        progress.advance();
    }
    progress.finish();
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

fn write_results(folder: &Path, scene: &SceneDesc, world: &mut World, summary: &Summary) -> Result<()> {
    let surface = folder.join("surface.glb");
    let objects = surface::of(scene, world);
    // That of a fine body takes as much memory as the file that is made of it.
    world.forget_surface();
    glb::write(&surface, &objects).with_context(|| surface.display().to_string())?;
    let path = folder.join("summary.json");
    std::fs::write(&path, serde_json::to_string_pretty(summary)? + "\n").with_context(|| path.display().to_string())
}
