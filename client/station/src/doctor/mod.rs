//! What is well and what is not about this machine, its devices and the server, in plain words.

mod args;
mod devices;
mod server;
mod system;

use std::fmt;
use std::time::Duration;

use serde::Serialize;

pub use self::args::Args;

use crate::config::StationConfig;

/// How a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// As it should be.
    Good,
    /// Good to know; nothing that is configured needs it.
    Note,
    /// The station will not do what it is configured for.
    Bad,
}

/// Something that was looked at.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub subject: String,
    /// How it is.
    pub outcome: Outcome,
    /// What was found.
    pub text: String,
    /// What to do about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl Finding {
    fn good(subject: impl Into<String>, text: impl Into<String>) -> Self {
        Self { subject: subject.into(), outcome: Outcome::Good, text: text.into(), remedy: None }
    }

    fn other(outcome: Outcome, subject: impl Into<String>, text: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { subject: subject.into(), outcome, text: text.into(), remedy: Some(remedy.into()) }
    }
}

/// All that was looked at.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Diagnosis {
    /// In the order in which it was looked at.
    pub findings: Vec<Finding>,
}

impl Diagnosis {
    /// Looks at everything; each device is run for a time, without force.
    #[must_use]
    pub fn make(config: &StationConfig, run_for: Duration) -> Self {
        let mut findings = system::findings();
        findings.extend(devices::findings(&config.devices, run_for));
        findings.push(server::finding(&config.server));
        Self { findings }
    }

    /// Whether the station will do what it is configured for.
    #[must_use]
    pub fn is_well(&self) -> bool {
        self.findings.iter().all(|finding| finding.outcome != Outcome::Bad)
    }
}

impl fmt::Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Finding { subject, outcome, text, remedy } in &self.findings {
            let mark = match outcome {
                Outcome::Good => "ok  ",
                Outcome::Note => "note",
                Outcome::Bad => "BAD ",
            };
            writeln!(f, "{mark}  {subject}: {text}")?;
            if let Some(remedy) = remedy {
                writeln!(f, "      -> {remedy}")?;
            }
        }
        Ok(())
    }
}
