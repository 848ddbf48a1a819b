//! Rows as CSV files, below `docs/reference`, and the commit that they were measured at.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Writes a file of rows with a line of names above them.
///
/// # Errors
/// It cannot be written.
pub fn write<T: Serialize>(path: &Path, rows: &[T]) -> Result<()> {
    let mut writer = csv::Writer::from_path(path).with_context(|| path.display().to_string())?;
    rows.iter().try_for_each(|row| writer.serialize(row))?;
    Ok(writer.flush()?)
}

/// Reads a file of rows.
///
/// # Errors
/// It is absent or no such file.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>> {
    let text = fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let rows = csv::Reader::from_reader(text.as_bytes()).into_deserialize().collect::<Result<_, _>>();
    rows.with_context(|| path.display().to_string())
}

const COMMIT_FILE: &str = "commit.txt";

/// Leaves the commit that the tables of `folder` are measured at: later arithmetic may move them.
///
/// # Errors
/// There is no git, or the file cannot be written.
pub fn write_commit(folder: &Path) -> Result<()> {
    let ran = Command::new("git").args(["rev-parse", "--short=7", "HEAD"]).output().context("git rev-parse")?;
    let path = folder.join(COMMIT_FILE);
    fs::write(&path, ran.stdout).with_context(|| path.display().to_string())
}

/// The commit that the tables of `folder` were measured at.
///
/// # Errors
/// It is not there.
pub fn read_commit(folder: &Path) -> Result<String> {
    let path = folder.join(COMMIT_FILE);
    let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    Ok(text.trim().to_owned())
}
