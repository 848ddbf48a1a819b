//! What the settings are measured against: the finest run that can be afforded.

use anyhow::{Context, Result, ensure};
use indicatif::ProgressBar;
use kerf_physics::{Scene, SceneError};
use kerf_scenes::dial::{FinerRegions, Setting};

use super::job::Job;
use super::measure::touching_windows;
use super::options::Options;
use super::process::Run;
use super::runs::Runs;
use super::sweep;
use crate::progress::say;

/// Relative tolerance of the reference's solves. The velocity change of a step is kept in single
/// precision; state, forces and residuals in double.
const RELATIVE_TOLERANCE: f64 = 1e-8;
/// Iterations of a solve: a hundred times what level 0 takes.
const MAX_ITERATIONS: u32 = 2000;
/// Time of computing of a pilot, s.
const PILOT_S: f64 = 10.0;
/// Steps with a tool in contact, and the noise of the machine, over those of a pilot from rest.
const PILOT_MARGIN: f64 = 2.0;
/// File of the reference.
const KEY: &str = "reference";

/// The reference, and what is to be said of it.
///
/// # Errors
/// Not even the coarsest candidate fits, or its run failed.
pub fn find(
    options: &Options,
    scene: &Scene,
    base: &Job,
    settings: &[Setting],
    runs: &Runs,
    bar: &ProgressBar,
) -> Result<(Run, Vec<String>)> {
    let mut remarks = Vec::new();
    let candidates = candidates(scene, base, settings);
    let standing = candidates.iter().find_map(|job| runs.find(KEY, job));
    if let Some(run) = standing {
        return Ok((run, remarks));
    }
    ensure!(options.retime.is_none(), "--retime: no reference stands in {}", options.out.display());
    for job in &candidates {
        let name = name(job);
        if let Some(refusal) = super::refusal(job)? {
            remarks.push(format!("reference {name}: {refusal}"));
            continue;
        }
        let estimate_s = estimate_s(job, runs, bar).with_context(|| format!("reference {name}"))?;
        if estimate_s > options.reference_budget_s {
            let remark = format!(
                "reference {name}: would take some {estimate_s:.0} s, more than --reference-budget-s {}",
                options.reference_budget_s
            );
            bar.suspend(|| say(&remark));
            remarks.push(remark);
            continue;
        }
        bar.suspend(|| say(&format!("reference {name}: some {estimate_s:.0} s")));
        let run = runs.take(KEY, job, bar).with_context(|| format!("reference {name}"))?;
        ensure!(run.faults == 0, "reference {name}: {} steps were rolled back", run.faults);
        return Ok((run, remarks));
    }
    anyhow::bail!("no reference fits: raise --reference-budget-s; {}", remarks.join("; "))
}

/// From the finest: single voxels before composite elements, where they would fold with the finest that do
/// not around the stroke; and at half the smallest step of the sweep before that step before the scene's.
fn candidates(scene: &Scene, base: &Job, settings: &[Setting]) -> Vec<Job> {
    let own = sweep::own_setting(&scene.desc);
    let fastest_hz = settings.iter().map(|setting| setting.rate_hz).fold(own.rate_hz, f64::max);
    let mut rates_hz = vec![2.0 * fastest_hz, fastest_hz, own.rate_hz];
    rates_hz.dedup();
    let mut jobs = Vec::new();
    for level in 0..=own.level {
        // What is on level 0 throughout has no finer regions.
        let finer = if level == 0 { FinerRegions::LeftOut } else { own.finer };
        let mut job = Job {
            setting: Setting { level, relative_tolerance: RELATIVE_TOLERANCE, finer, ..own },
            max_iterations: Some(MAX_ITERATIONS),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            ..base.clone()
        };
        if base.stroke.is_some() {
            let mut levels = (level..=own.level).map(|around| (around > level).then_some(around));
            job.level_around_stroke = levels
                .find(|&level_around_stroke| {
                    super::refusal(&Job { level_around_stroke, ..job.clone() }).is_ok_and(|refusal| refusal.is_none())
                })
                .flatten();
        }
        let at_rate = |&rate_hz: &f64| Job { setting: Setting { rate_hz, ..job.setting }, ..job.clone() };
        jobs.extend(rates_hz.iter().map(at_rate));
    }
    jobs
}

/// A candidate's name.
#[must_use]
pub fn name(job: &Job) -> String {
    let around = job.level_around_stroke.map_or(String::new(), |level| format!(", level {level} around the stroke"));
    format!("level {}{around}, {} Hz", job.setting.level, job.setting.rate_hz)
}

fn estimate_s(job: &Job, runs: &Runs, bar: &ProgressBar) -> Result<f64> {
    let pilot = runs.pilot("pilot", &Job { limit_s: Some(PILOT_S), ..job.clone() }, bar)?;
    let steps = job.duration_s * job.setting.rate_hz;
    Ok(PILOT_MARGIN * steps * pilot.cost.run_s / pilot.steps as f64)
}

/// What makes the errors against a reference say little.
pub fn warnings(scene: &Scene, reference: &Run, swept: &[Run]) -> Vec<SceneError> {
    let warning = |field: &str, message: String| SceneError::Field { field: field.into(), message };
    let mut warnings = Vec::new();
    let is_felt = reference.samples.force_n.iter().flatten().flatten().any(|force_n| *force_n != 0.0);
    if !scene.desc.tools.is_empty() && !is_felt {
        let message = "no tool touched anything in the reference, so forces and cuts are not compared; a script that \
                       reaches the tissue is given by --script";
        warnings.push(warning("reference", message.into()));
    }
    let is_finer = |a: &Setting, b: &Setting| {
        let [a, b] = [a, b].map(|s| [f64::from(s.level), s.voxel_scale, 1.0 / s.rate_hz]);
        a.iter().zip(b).all(|(a, b)| *a <= b) && a != b
    };
    let own = &reference.job.setting;
    let unjudged: Vec<String> =
        swept.iter().map(|run| &run.job.setting).filter(|setting| !is_finer(own, setting)).map(sweep::key).collect();
    if !unjudged.is_empty() {
        let message = format!(
            "{} is no finer than {}, whose errors are then the reference's as much as their own; raise \
             --reference-budget-s, or leave them out",
            name(&reference.job),
            unjudged.join(", ")
        );
        warnings.push(warning("reference", message));
    }
    warnings
}

/// Script's time just before the tool first touches in the reference, s.
#[must_use]
pub fn touches_from_s(reference: &Run) -> f64 {
    let windows = touching_windows(&reference.samples);
    let window_s = reference.job.duration_s / reference.samples.force_n.len() as f64;
    windows.start.saturating_sub(1) as f64 * window_s
}
