//! Limits that a run is held to, for tests and CI.

use clap::Args;

use crate::report::Report;

/// Limits; what is not given is not checked, except that replicas have to match.
#[derive(Clone, Debug, Default, Args)]
pub struct LimitArgs {
    /// Greatest 99th percentile of the round trip, ms
    #[arg(long, value_name = "MS")]
    pub max_p99_ms: Option<f64>,
    /// Greatest fraction of the server's steps that may be late, 0 to 1
    #[arg(long, value_name = "SHARE")]
    pub max_late_step_share: Option<f64>,
    /// Greatest fraction of the poses that may be sent late or be left out, 0 to 1
    #[arg(long, value_name = "SHARE")]
    pub max_late_send_share: Option<f64>,
    /// Least contacts a second, Hz
    #[arg(long, value_name = "HZ")]
    pub min_contact_rate: Option<f64>,
    /// Most messages that may not fit a replica
    #[arg(long, value_name = "COUNT", default_value_t = 0)]
    pub max_mismatches: u64,
}

impl LimitArgs {
    /// Says which limits a run has exceeded, with both numbers.
    #[must_use]
    pub fn exceeded(&self, report: &Report) -> Vec<String> {
        let mut exceeded = Vec::new();
        let mut at_most = |name: &str, value: f64, limit: Option<f64>| {
            if let Some(limit) = limit
                && value > limit
            {
                exceeded.push(format!("{name} is {value:.4}, at most {limit} was asked for"));
            }
        };
        let p99_ms = report.round_trip_ms.map_or(f64::INFINITY, |round_trip| round_trip.p99);
        at_most("round trip p99 in ms", p99_ms, self.max_p99_ms);
        at_most("share of late steps", report.server.steps.late_step_share, self.max_late_step_share);
        at_most("share of late sends", report.poses.late_share, self.max_late_send_share);
        at_most("number of mismatches", report.view.mismatches as f64, Some(self.max_mismatches as f64));
        if let Some(limit) = self.min_contact_rate
            && report.contacts.rate_hz < limit
        {
            let rate_hz = report.contacts.rate_hz;
            exceeded.push(format!("contacts a second are {rate_hz:.1}, at least {limit} were asked for"));
        }
        exceeded
    }
}
