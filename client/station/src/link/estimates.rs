//! What is estimated from contacts: the round trip and the difference of the two clocks.

use std::collections::VecDeque;

/// Round trip and its spread, smoothed as TCP does it (RFC 6298).
#[derive(Clone, Copy, Debug, Default)]
pub struct RoundTrip {
    smoothed: Option<(f64, f64)>,
}

impl RoundTrip {
    /// A round trip was measured, s.
    pub fn measured(&mut self, round_trip_s: f64) {
        self.smoothed = Some(match self.smoothed {
            None => (round_trip_s, round_trip_s / 2.0),
            Some((mean_s, spread_s)) => {
                (mean_s + (round_trip_s - mean_s) / 8.0, spread_s + ((round_trip_s - mean_s).abs() - spread_s) / 4.0)
            }
        });
    }

    /// What to reckon with, s: most round trips are shorter.
    #[must_use]
    pub fn bound_s(&self) -> Option<f64> {
        self.smoothed.map(|(mean_s, spread_s)| mean_s + spread_s)
    }

    /// The mean, s.
    #[must_use]
    pub fn mean_s(&self) -> Option<f64> {
        self.smoothed.map(|(mean_s, _)| mean_s)
    }
}

/// Bounds that are older than this are forgotten, ns: clocks drift apart.
const KEPT_NS: u64 = 10_000_000_000;
/// Bounds that are kept at most.
const KEPT: usize = 64;
/// Time that one of them stands for, ns.
const STRIDE_NS: u64 = KEPT_NS / KEPT as u64;

/// The server's clock less this machine's: between what the fastest message each way allows.
#[derive(Clone, Debug, Default)]
pub struct ClockOffset {
    /// `(when, greatest lower bound, least upper bound)`, ns, oldest first.
    bounds: VecDeque<(u64, i64, i64)>,
}

impl ClockOffset {
    /// A contact that ended at `server_ns` and reflects a pose of `echo_ns` that arrived at `echo_arrived_ns` was read.
    pub fn measured(&mut self, now_ns: u64, server_ns: u64, echo_ns: u64, echo_arrived_ns: u64) {
        let lower = server_ns as i64 - now_ns as i64;
        let upper = echo_arrived_ns as i64 - echo_ns as i64;
        match self.bounds.back_mut().filter(|(at_ns, ..)| now_ns.saturating_sub(*at_ns) < STRIDE_NS) {
            Some((_, greatest, least)) => (*greatest, *least) = (lower.max(*greatest), upper.min(*least)),
            None => self.bounds.push_back((now_ns, lower, upper)),
        }
        while self.bounds.front().is_some_and(|(at_ns, ..)| now_ns.saturating_sub(*at_ns) > KEPT_NS) {
            self.bounds.pop_front();
        }
    }

    /// The difference, s, and by how much it may be off.
    #[must_use]
    pub fn estimate_s(&self) -> Option<(f64, f64)> {
        let lower = self.bounds.iter().map(|(_, lower, _)| *lower).max()?;
        let upper = self.bounds.iter().map(|(_, _, upper)| *upper).min()?;
        let [lower, upper] = [lower, upper].map(|ns| ns as f64 * 1e-9);
        Some(((lower + upper) / 2.0, (upper - lower) / 2.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_round_trip_follows_what_is_measured_and_leaves_room_for_jitter() {
        let mut round_trip = RoundTrip::default();
        assert_eq!(round_trip.bound_s(), None);
        (0..200).for_each(|i| round_trip.measured(if i % 2 == 0 { 0.04 } else { 0.06 }));
        let (mean_s, bound_s) = (round_trip.mean_s().unwrap(), round_trip.bound_s().unwrap());
        assert!((mean_s - 0.05).abs() < 2e-3 && (bound_s - 0.06).abs() < 3e-3, "{mean_s} {bound_s}");
    }

    #[test]
    fn the_clocks_difference_is_found_through_delay_and_jitter() {
        const MS: u64 = 1_000_000;
        let (mut offset, difference) = (ClockOffset::default(), 7_000 * MS);
        for i in 0..500 {
            let (up, down) = (5 * MS + i % 7 * MS, 5 * MS + i % 5 * MS);
            let sent = (1000 + 4 * i) * MS;
            let arrived = sent + up + difference;
            let ended = arrived + MS;
            offset.measured(ended - difference + down, ended, sent, arrived);
        }
        let (estimate_s, off_s) = offset.estimate_s().unwrap();
        assert!((estimate_s - 7.0).abs() <= off_s && off_s < 0.0055, "{estimate_s} +- {off_s}");
    }
}
