//! Which of the limits that were asked for a run has exceeded.

use super::Report;
use crate::limits::LimitArgs;

impl Report {
    /// Says which limits the run has exceeded, with both numbers.
    #[must_use]
    pub fn exceeded(&self, limits: &LimitArgs) -> Vec<String> {
        let mut exceeded = Vec::new();
        let mut at_most = |name: &str, value: f64, limit: Option<f64>| {
            if let Some(limit) = limit
                && value > limit
            {
                exceeded.push(format!("{name} is {value:.4}, at most {limit} was asked for"));
            }
        };
        let p99_ms = self.round_trip_ms.map_or(f64::INFINITY, |round_trip| round_trip.p99);
        at_most("round trip p99 in ms", p99_ms, limits.max_p99_ms);
        at_most("share of late steps", self.server.steps.late_step_share, limits.max_late_step_share);
        at_most("share of late sends", self.poses.late_share, limits.max_late_send_share);
        at_most("number of mismatches", self.view.mismatches as f64, Some(limits.max_mismatches as f64));
        if let Some(limit) = limits.min_contact_rate
            && self.contacts.rate_hz < limit
        {
            let rate_hz = self.contacts.rate_hz;
            exceeded.push(format!("contacts a second are {rate_hz:.1}, at least {limit} were asked for"));
        }
        exceeded
    }
}
