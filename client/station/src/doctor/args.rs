//! The doctor's command line.

use std::path::PathBuf;
use std::time::Duration;

use clap::Parser;

use super::Diagnosis;
use crate::config::StationConfig;

/// What the doctor is asked for.
#[derive(Clone, Debug, Parser)]
pub struct Args {
    /// Configuration (TOML); without one a simulated Omni at 127.0.0.1:50051
    #[arg(long)]
    config: Option<PathBuf>,
    /// Address of the server, in place of the configuration's
    #[arg(long, env = "KERF_SERVER")]
    server: Option<String>,
    /// Prints a JSON object, instead of lines for people
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Looks at everything and prints it; whether the station will do what it is configured for.
    ///
    /// # Errors
    /// The configuration cannot be used.
    pub fn execute(&self) -> anyhow::Result<bool> {
        let mut config = self.config.as_deref().map_or_else(|| Ok(StationConfig::default()), StationConfig::load)?;
        if let Some(server) = &self.server {
            config.server.url.clone_from(server);
        }
        let diagnosis = Diagnosis::make(&config, Duration::from_secs(1));
        if self.json {
            println!("{}", serde_json::json!({ "is_well": diagnosis.is_well(), "findings": diagnosis.findings }));
        } else {
            print!("{diagnosis}");
        }
        Ok(diagnosis.is_well())
    }
}
