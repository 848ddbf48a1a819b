//! `kerf-server tradeoff`: what settings of a scene cost and how far off they are, measured against the
//! finest reference that can be afforded.
//!
//! Every run is a process of its own ([`process`]); its samples stand in a file of `runs/` and are not taken
//! again while the file is whole and of the same job.

mod carried;
mod job;
mod measure;
mod options;
mod plot;
mod points;
pub mod process;
mod reference;
mod report;
mod runs;
mod samples;
mod sweep;

use anyhow::{Context, Result, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use kerf_physics::{Scene, voxel_size_m};
use kerf_scenes::dial::{FinerRegions, ParetoFront, Setting};

use crate::progress::say;
use crate::scene_args::{Run, SceneArgs, WarningArgs};
use crate::script::Script;
use crate::simulate::AFTER_SCRIPT_S;
use job::Job;
pub use options::Options;
use runs::Runs;

/// Simulated time of a scene whose tools do nothing, s: its loads have been taken up.
const DURATION_WITHOUT_TOOLS_S: f64 = 0.5;
/// Margin of the region around the stroke, in elements of the scene's level.
const STROKE_MARGIN_ELEMENTS: f64 = 1.0;

/// Sweeps a scene and writes its Pareto front.
///
/// # Errors
/// The scene or the script cannot be read or is not sound, the reference fails, or a file cannot be written.
pub fn run(options: &Options) -> Result<()> {
    let scene_args = SceneArgs { scene: options.scene.clone(), script: options.script.clone(), ..SceneArgs::default() };
    let Run { scene, script, mut warnings, .. } = scene_args.examine()?;
    let base = base_job(options, &scene, &script)?;
    let settings = sweep::settings(&scene.desc, &options.axes);
    let runs = Runs::create(&options.out)?;
    let bar = ProgressBar::new(settings.len() as u64 + 1).with_style(
        ProgressStyle::with_template("{bar:40} {pos}/{len} runs, {elapsed} {msg}").expect("the template is sound"),
    );
    let (reference, mut remarks) = reference::find(options, &scene, &base, &settings, &runs, &bar)?;
    bar.inc(1);
    let from_s = reference::touches_from_s(&reference);
    let mut points = Vec::new();
    let mut swept = Vec::new();
    for setting in settings {
        let key = sweep::key(&setting);
        let job = Job { setting, ..base.clone() };
        let outcome = match (refusal(&job)?, options.retime) {
            (Some(refusal), _) => Err(anyhow::anyhow!(refusal)),
            (None, None) => runs.take(&key, &job, &bar),
            (None, Some(limit_s)) => runs.retime(&key, &job, from_s, limit_s, &bar),
        };
        match outcome {
            Ok(run) if run.faults > 0 => {
                remarks.push(format!("{key}: left out, {} steps were rolled back", run.faults))
            }
            Ok(run) => {
                points.push(measure::point(&run, &reference));
                swept.push(run);
            }
            Err(error) => remarks.push(format!("{key}: left out, {error:#}")),
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    remarks.iter().for_each(|remark| say(remark));
    warnings.extend(reference::warnings(&scene, &reference, &swept));
    WarningArgs::say(&warnings);
    ensure!(!points.is_empty(), "no setting could be measured");
    let mut pareto = ParetoFront { points, ..ParetoFront::of(&scene) };
    pareto.notes.extend(report::notes(options, &reference, &base));
    report::write(&options.out, &pareto, &remarks)?;
    plot::pareto(&pareto).draw(&options.out)?;
    if scene.desc.tools.is_empty() {
        plot::profile(&scene.desc.name, &reference, &swept).draw(&options.out)?;
    }
    println!("{} settings measured, {} runs taken: {}", swept.len(), runs.taken(), options.out.display());
    options.warnings.judge(warnings.len())
}

/// Why a job's scene is not run; `None` where it is.
fn refusal(job: &Job) -> Result<Option<String>> {
    let mut scene = match job.scene()?.judge() {
        Ok(scene) => scene.into_scene(),
        Err(problems) => return Ok(problems.0.first().map(ToString::to_string)),
    };
    if job.level_around_stroke.is_some() {
        // Its smaller elements are where no edge comes.
        scene.desc.objects.iter_mut().for_each(|object| object.finer.clear());
    }
    carried::fold(&scene)
}

/// What all runs have in common.
fn base_job(options: &Options, scene: &Scene, script: &Script) -> Result<Job> {
    let text = match &options.script {
        Some(path) => std::fs::read_to_string(path).with_context(|| path.display().to_string())?,
        None => String::new(),
    };
    let end_s = script.end_s();
    let default_s = if end_s > 0.0 { end_s + AFTER_SCRIPT_S } else { DURATION_WITHOUT_TOOLS_S };
    let duration_s = options.duration.unwrap_or(default_s);
    ensure!(duration_s > 0.0 && duration_s <= 1e4, "--duration: {duration_s} is not between 0 and 10000");
    let setting: Setting = sweep::own_setting(&scene.desc);
    let voxel_m = voxel_size_m(&scene.desc.objects[0], &scene.meshes)?.context("the scene's mesh was not read")?;
    let margin_m = STROKE_MARGIN_ELEMENTS * voxel_m * f64::from(1u32 << setting.level);
    let has_own_regions = setting.finer == FinerRegions::Stated;
    Ok(Job {
        scene: options.scene.clone(),
        script: options.script.clone(),
        inputs: Job::inputs_of(scene, &text),
        setting,
        stroke: if has_own_regions { None } else { sweep::stroke_box(&scene.desc, script, margin_m) },
        level_around_stroke: None,
        max_iterations: None,
        duration_s,
        samples: options.samples,
        points: points::on_surface(scene, options.points as usize)?,
        profile: points::along_top(scene)?,
        threads: usize::from(options.threads),
        start_s: 0.0,
        limit_s: None,
    })
}
