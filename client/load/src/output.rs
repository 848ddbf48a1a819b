//! The files that a run leaves.

use std::path::{Path, PathBuf};

use anyhow::Context;

use kerf_replica::glb;

use crate::metrics::ContactSample;
use crate::plot;
use crate::report::Report;
use crate::run::Finished;

/// Writes a run's files to a directory, which is created, and returns their paths.
///
/// # Errors
/// The file that cannot be written.
pub fn write(dir: &Path, finished: &Finished) -> anyhow::Result<Vec<PathBuf>> {
    std::fs::create_dir_all(dir).with_context(|| format!("cannot create {}", dir.display()))?;
    let (report, force) = (dir.join("report.json"), dir.join("force.csv"));
    write_report(&report, &finished.report)?;
    write_forces(&force, &finished.contacts.samples)?;
    let samples: Vec<plot::Sample> = finished
        .contacts
        .samples
        .iter()
        .map(|s| plot::Sample { time_s: s.sim_time_s, force_n: s.resistance_n, depth_m: s.depth_m })
        .collect();
    let title = format!("{}: force on the tool and its depth, {}", finished.report.scene, finished.report.script);
    let figure = plot::force_over_time(&samples, finished.report.force.reference_n, &title);
    let [svg, png] = figure.draw(dir).context("cannot plot the force")?;
    let surface = dir.join("surface.glb");
    glb::write(&surface, &finished.objects).with_context(|| format!("cannot write {}", surface.display()))?;
    Ok(vec![report, force, svg, png, surface])
}

/// Writes a report as JSON.
///
/// # Errors
/// The file cannot be written.
pub fn write_report(path: &Path, report: &Report) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(report)?;
    std::fs::write(path, text + "\n").with_context(|| format!("cannot write {}", path.display()))
}

fn write_forces(path: &Path, samples: &[ContactSample]) -> anyhow::Result<()> {
    let write = || -> csv::Result<()> {
        let mut writer = csv::Writer::from_path(path)?;
        samples.iter().try_for_each(|sample| writer.serialize(sample))?;
        Ok(writer.flush()?)
    };
    write().with_context(|| format!("cannot write {}", path.display()))
}
