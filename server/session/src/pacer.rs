//! When the next step is due: absolute deadlines `anchor + n * dt`.
//!
//! The pacer is told the time and never asks for it, so its behaviour is tested without sleeping.
//! The time step never changes and no step is dropped: a session that is late runs its steps back to
//! back until it has caught up, and one that is later than the limit gives the lost time up
//! (re-anchors), so that a long stall is not followed by a burst of steps faster than real time.

/// Deadlines of one session.
#[derive(Clone, Debug)]
pub struct Pacer {
    rate_hz: f64,
    max_lag_ns: u64,
    anchor_ns: u64,
    /// Steps since the anchor.
    steps: u64,
    counts: PaceCounts,
}

/// What the pacer has counted since the session began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PaceCounts {
    /// Steps that ended after the next one was due.
    pub late_steps: u64,
    /// Times that lost time was given up.
    pub reanchors: u64,
}

/// How a step ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// Before the next one was due.
    InTime,
    /// So long after the next one was due; the lag is caught up.
    Late {
        /// ns.
        lag_ns: u64,
    },
    /// So late that the lost time was given up.
    Reanchored {
        /// ns.
        lag_ns: u64,
    },
}

impl Pace {
    /// How long after the next step was due the step ended, ns; 0 in time.
    #[must_use]
    pub fn lag_ns(self) -> u64 {
        match self {
            Self::InTime => 0,
            Self::Late { lag_ns } | Self::Reanchored { lag_ns } => lag_ns,
        }
    }
}

impl Pacer {
    /// The first step is due at `now_ns`; lag beyond `max_lag_ns` is given up.
    #[must_use]
    pub fn new(rate_hz: f64, max_lag_ns: u64, now_ns: u64) -> Self {
        Self { rate_hz, max_lag_ns, anchor_ns: now_ns, steps: 0, counts: PaceCounts::default() }
    }

    /// When the next step is due.
    #[must_use]
    pub fn deadline_ns(&self) -> u64 {
        // From the step count, not summed up: rounding does not accumulate. Exact to the
        // nanosecond for 100 days.
        self.anchor_ns + (self.steps as f64 * 1e9 / self.rate_hz).round() as u64
    }

    /// A step has ended at `now_ns`; moves on to the next deadline.
    pub fn step_ended(&mut self, now_ns: u64) -> Pace {
        self.steps += 1;
        let lag_ns = now_ns.saturating_sub(self.deadline_ns());
        if lag_ns == 0 {
            return Pace::InTime;
        }
        self.counts.late_steps += 1;
        if lag_ns <= self.max_lag_ns {
            return Pace::Late { lag_ns };
        }
        self.counts.reanchors += 1;
        self.restart(now_ns);
        Pace::Reanchored { lag_ns }
    }

    /// The next step is due at `now_ns`, without this counting as lost time (after a pause).
    pub fn restart(&mut self, now_ns: u64) {
        self.anchor_ns = now_ns;
        self.steps = 0;
    }

    /// What has been counted so far.
    #[must_use]
    pub fn counts(&self) -> PaceCounts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Runs steps of the given durations against a clock that only they and sleeping move;
    /// returns when each step began.
    fn starts_ns(pacer: &mut Pacer, step_durations_ns: &[u64]) -> Vec<u64> {
        let mut now = pacer.deadline_ns();
        step_durations_ns
            .iter()
            .map(|duration| {
                now = now.max(pacer.deadline_ns());
                let start = now;
                now += duration;
                pacer.step_ended(now);
                start
            })
            .collect()
    }

    #[test]
    fn steps_in_time_begin_at_multiples_of_dt() {
        let mut pacer = Pacer::new(1000.0, 100 * MS, 5 * MS);
        assert_eq!(starts_ns(&mut pacer, &[MS / 2; 4]), [5 * MS, 6 * MS, 7 * MS, 8 * MS]);
        assert_eq!(pacer.counts(), PaceCounts::default());
    }

    #[test]
    fn a_late_step_is_counted_and_caught_up_without_dropping_any() {
        let mut pacer = Pacer::new(1000.0, 100 * MS, 0);
        let starts = starts_ns(&mut pacer, &[5 * MS / 2, MS / 4, MS / 4, MS / 4, MS / 4]);
        assert_eq!(starts, [0, 5 * MS / 2, 11 * MS / 4, 3 * MS, 4 * MS]);
        assert_eq!(pacer.counts(), PaceCounts { late_steps: 2, reanchors: 0 });
    }

    #[test]
    fn a_late_step_says_by_how_much_it_missed_its_deadline() {
        let mut pacer = Pacer::new(1000.0, 100 * MS, 0);
        let lags = [MS, 5 * MS / 2, 13 * MS / 4, 150 * MS].map(|ended_ns| pacer.step_ended(ended_ns).lag_ns());
        assert_eq!(lags, [0, MS / 2, MS / 4, 146 * MS]);
    }

    #[test]
    fn lag_past_the_limit_is_given_up_and_the_rate_is_kept() {
        let mut pacer = Pacer::new(1000.0, 100 * MS, 0);
        let starts = starts_ns(&mut pacer, &[150 * MS, MS / 2, MS / 2]);
        assert_eq!(starts, [0, 150 * MS, 151 * MS]);
        assert_eq!(pacer.counts(), PaceCounts { late_steps: 1, reanchors: 1 });
    }

    #[test]
    fn a_rate_that_does_not_divide_a_second_does_not_drift() {
        let mut pacer = Pacer::new(30.0, 100 * MS, 0);
        for _ in 0..30 * 3600 {
            pacer.step_ended(pacer.deadline_ns());
        }
        assert_eq!(pacer.deadline_ns(), 3600 * 1000 * MS);
    }

    #[test]
    fn a_pause_is_not_lost_time() {
        let mut pacer = Pacer::new(1000.0, 100 * MS, 0);
        pacer.step_ended(MS / 2);
        pacer.restart(9000 * MS);
        assert_eq!(pacer.deadline_ns(), 9000 * MS);
        assert_eq!(pacer.counts(), PaceCounts::default());
    }
}
