//! The files that a run leaves.

use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::metrics::ContactSample;
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
    // The plot (from the samples) and `surface.glb` (`write_surface`, from `finished.surfaces`) join here.
    Ok(vec![report, force])
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
