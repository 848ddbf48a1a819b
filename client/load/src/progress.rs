//! What is shown while a run goes on: a live line on a terminal, a line a second otherwise.

use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::args::ProgressMode;
use crate::metrics::ContactMetrics;
use crate::report::OVERLOAD_LATE_SHARE;
use crate::viewer::ViewTotals;

/// How often progress is looked at: often enough to follow the force by eye.
pub const INTERVAL: Duration = Duration::from_millis(200);
/// Seconds between lines where there is no terminal.
const LINE_EVERY_S: f64 = 1.0;

/// Where progress goes.
pub enum Progress {
    /// A line that is drawn over.
    Live(ProgressBar),
    /// Lines; the time of the next one, s.
    Lines(f64, f64),
    /// Nowhere.
    Off,
}

impl Progress {
    /// Progress of a run of this duration.
    #[must_use]
    pub fn new(mode: ProgressMode, duration_s: f64) -> Self {
        match mode {
            ProgressMode::Off => Self::Off,
            ProgressMode::Auto if std::io::stderr().is_terminal() => {
                let bar = ProgressBar::new((duration_s * 1e3) as u64);
                let style =
                    ProgressStyle::with_template("{bar:24} {msg}").unwrap_or_else(|_| ProgressStyle::default_bar());
                Self::Live(bar.with_style(style))
            }
            ProgressMode::Auto => Self::Lines(0.0, duration_s),
        }
    }

    /// Shows how things stand at a time of the script.
    pub fn show(&mut self, time_s: f64, contacts: &ContactMetrics, view: &ViewTotals) {
        match self {
            Self::Live(bar) => {
                bar.set_position((time_s * 1e3) as u64);
                bar.set_message(line(time_s, contacts, view));
            }
            Self::Lines(next_s, duration_s) if time_s >= *next_s => {
                *next_s = (time_s / LINE_EVERY_S).floor() * LINE_EVERY_S + LINE_EVERY_S;
                eprintln!("{} of {duration_s:.1} s", line(time_s, contacts, view));
            }
            Self::Lines(..) | Self::Off => {}
        }
    }

    /// Takes the live line away.
    pub fn finish(&self) {
        if let Self::Live(bar) = self {
            bar.finish_and_clear();
        }
    }
}

fn line(time_s: f64, contacts: &ContactMetrics, view: &ViewTotals) -> String {
    let (depth_mm, resistance_n) =
        contacts.last().map_or((0.0, 0.0), |sample| (1e3 * sample.depth_m, sample.resistance_n));
    let p99_ms = contacts.round_trip_ns.value_at_quantile(0.99) as f64 * 1e-6;
    let steps = view.server.unwrap_or_default();
    let late_share = steps.late_steps() as f64 / steps.steps().max(1) as f64;
    let overload = if late_share > OVERLOAD_LATE_SHARE { "  OVERLOAD" } else { "" };
    format!(
        "{time_s:5.1} s  depth {depth_mm:6.1} mm  force {resistance_n:6.2} N  p99 {p99_ms:5.2} ms  {} patches  \
         {:.1} % of steps late{overload}",
        view.patches,
        100.0 * late_share,
    )
}
