//! One row of the table, for whoever looks into one: without the others, and tick by tick.

use std::fmt::Write as _;
use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::Context;

use super::{Played, Quality, Rendering, TISSUES, Tissue, Trial};

/// What is played.
#[derive(Clone, Debug, clap::Args)]
pub struct Row {
    /// Address of the server, which should have nothing else to do
    #[arg(long)]
    server: SocketAddr,
    /// The tissue
    #[arg(long, value_parser = ["soft", "stiff"])]
    tissue: String,
    /// What the station renders
    #[arg(long, value_enum, default_value_t = Rendering::Passive)]
    rendering: Rendering,
    /// Round trip of the network, ms
    #[arg(long, default_value_t = 0.0)]
    round_trip_ms: f64,
    /// Delay beside it, each way, from none to this, ms
    #[arg(long, default_value_t = 0.0)]
    jitter_ms: f64,
    /// Share of the time that the network stalls, %
    #[arg(long, default_value_t = 0.0)]
    stalls: f64,
    /// How often it is played
    #[arg(long, default_value_t = 1)]
    times: u32,
    /// File for the ticks of the last time (CSV), as the device feels them
    #[arg(long)]
    ticks: Option<PathBuf>,
}

impl Row {
    /// Plays it and prints the row each time.
    ///
    /// # Errors
    /// The server does not answer, the network asked for is none, or the file cannot be written.
    pub fn play(&self) -> anyhow::Result<()> {
        for (name, value, most) in [
            ("--round-trip-ms", self.round_trip_ms, 10_000.0),
            ("--jitter-ms", self.jitter_ms, 10_000.0),
            ("--stalls", self.stalls, 90.0),
        ] {
            anyhow::ensure!((0.0..=most).contains(&value), "{name} is {value}, not within 0 to {most}");
        }
        let tissue = TISSUES.into_iter().find(|tissue| tissue.name == self.tissue).context("--tissue: none of them")?;
        let quality = Quality {
            round_trip_s: 1e-3 * self.round_trip_ms,
            jitter_s: 1e-3 * self.jitter_ms,
            stalled_share: 1e-2 * self.stalls,
        };
        let trial = Trial { tissue, quality, rendering: self.rendering };
        for _ in 0..self.times {
            let played = trial.run(self.server)?;
            print!("{}", trial.row(&played.outcome));
            if let Some(path) = &self.ticks {
                let text = played.ticks(&tissue);
                std::fs::write(path, text).with_context(|| path.display().to_string())?;
            }
        }
        Ok(())
    }
}

impl Played {
    /// A line a tick; forces and stiffness as the device feels them.
    fn ticks(&self, tissue: &Tissue) -> String {
        let mut text = String::from(
            "time_s,hand_m,tool_m,force_n,contact_n,coupling_n_per_m,work_j,generated_j,contacts,motion_age_s,state\n",
        );
        for (moment, sample) in self.moments.iter().zip(&self.felt) {
            let rendered = &sample.rendered;
            let tool_m = rendered.tool.map_or(f64::NAN, |tool| tool.position_m.y - tissue.top_m[1]);
            let _ = writeln!(
                text,
                "{:.4},{:.6},{:.6},{:.4},{:.4},{:.1},{:.6},{:.6},{},{:.4},{:?}",
                moment.time_s,
                moment.height_m,
                tool_m,
                sample.force_n.y,
                rendered.contact_n.y * tissue.force_scale,
                rendered.coupling_n_per_m * tissue.force_scale,
                moment.work_j,
                rendered.generated_j * tissue.force_scale,
                sample.contacts,
                sample.motion_age_s.unwrap_or(f64::NAN),
                rendered.state,
            );
        }
        text
    }
}
