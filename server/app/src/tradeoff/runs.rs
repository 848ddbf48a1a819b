//! The runs of a sweep: a file each, a process each.

use std::cell::Cell;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use indicatif::ProgressBar;

use super::job::Job;
use super::process::{Run, write};

/// The folder of the runs.
pub struct Runs {
    folder: PathBuf,
    taken: Cell<u32>,
}

impl Runs {
    /// `runs/` in a folder.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn create(out: &Path) -> Result<Self> {
        let folder = out.join("runs");
        std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        Ok(Self { folder, taken: Cell::new(0) })
    }

    /// Runs that were taken, not found.
    #[must_use]
    pub fn taken(&self) -> u32 {
        self.taken.get()
    }

    /// A run that stands whole and is of this job.
    #[must_use]
    pub fn find(&self, key: &str, job: &Job) -> Option<Run> {
        let text = std::fs::read_to_string(self.path(key)).ok()?;
        // A file that is cut short is none.
        serde_json::from_str(&text).ok().filter(|run: &Run| run.job == *job)
    }

    /// The run of a job, taken if it does not stand yet.
    ///
    /// # Errors
    /// The process failed; what it said.
    pub fn take(&self, key: &str, job: &Job, bar: &ProgressBar) -> Result<Run> {
        if let Some(run) = self.find(key, job) {
            return Ok(run);
        }
        self.taken.set(self.taken.get() + 1);
        self.process(&self.path(key), key, job, bar)
    }

    /// A run that stands, its cost taken again from `start_s` on for at most `limit_s`.
    ///
    /// # Errors
    /// There is no such run, or the process failed.
    pub fn retime(&self, key: &str, job: &Job, start_s: f64, limit_s: f64, bar: &ProgressBar) -> Result<Run> {
        let run = self.find(key, job).context("it has not been run yet")?;
        let timing = Job { start_s, limit_s: Some(limit_s), ..job.clone() };
        self.taken.set(self.taken.get() + 1);
        let run = Run { cost: self.pilot(key, &timing, bar)?.cost, ..run };
        write(&self.path(key), &run)?;
        Ok(run)
    }

    /// A run that leaves no file.
    ///
    /// # Errors
    /// The process failed; what it said.
    pub fn pilot(&self, key: &str, job: &Job, bar: &ProgressBar) -> Result<Run> {
        let path = self.folder.join("pilot.tmp");
        let run = self.process(&path, key, job, bar)?;
        std::fs::remove_file(&path).with_context(|| path.display().to_string())?;
        Ok(run)
    }

    fn path(&self, key: &str) -> PathBuf {
        self.folder.join(format!("{key}.json"))
    }

    fn process(&self, path: &Path, key: &str, job: &Job, bar: &ProgressBar) -> Result<Run> {
        let program = std::env::current_exe().context("the program's own path")?;
        let mut command = Command::new(program);
        command.arg("tradeoff-run").arg("--out").arg(path);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn()?;
        // Taken, so that it is closed: the child reads to its end.
        child.stdin.take().context("the run's input")?.write_all(serde_json::to_string(job)?.as_bytes())?;
        for line in BufReader::new(child.stdout.take().context("the run's output")?).lines() {
            bar.set_message(format!("{key}: {} %", line?));
        }
        let mut said = String::new();
        child.stderr.take().context("the run's errors")?.read_to_string(&mut said)?;
        let status = child.wait()?;
        if !status.success() {
            let said = said.trim().trim_start_matches("error: ");
            bail!("{}", if said.is_empty() { status.to_string() } else { said.to_owned() });
        }
        let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
        serde_json::from_str(&text).with_context(|| path.display().to_string())
    }
}
