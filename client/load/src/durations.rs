//! Durations as histograms.

use hdrhistogram::Histogram;

/// Longest duration that is told apart; longer ones count as this.
const MAX_DURATION_NS: u64 = 60_000_000_000;
/// Three digits: quantiles are exact to 0.1 %, in a fixed 200 kB.
const DURATION_DIGITS: u8 = 3;

/// A histogram of durations, ns.
#[must_use]
pub fn durations_ns() -> Histogram<u64> {
    Histogram::new_with_bounds(1, MAX_DURATION_NS, DURATION_DIGITS)
        .expect("the bounds are constants that the histogram takes")
}
