//! When to send: absolute deadlines, so that one late wake-up does not move the ones after it.

/// Deadlines at `start + n * period`, and a count of how well they were kept. It reads no clock.
#[derive(Clone, Debug)]
pub struct Schedule {
    start_ns: u64,
    period_ns: f64,
    next: u64,
    kept: Punctuality,
}

/// How well deadlines were kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Punctuality {
    /// Ticks that were run.
    pub ticks: u64,
    /// Of these, run more than half a period after their deadline.
    pub late: u64,
    /// Ticks left out because the next one was due already: a burst would only be dropped.
    pub skipped: u64,
}

impl Schedule {
    /// The first deadline is `start_ns`.
    #[must_use]
    pub fn new(start_ns: u64, rate_hz: f64) -> Self {
        Self { start_ns, period_ns: 1e9 / rate_hz, next: 0, kept: Punctuality::default() }
    }

    /// When the next tick is due, ns.
    #[must_use]
    pub fn deadline_ns(&self) -> u64 {
        self.start_ns + (self.next as f64 * self.period_ns) as u64
    }

    /// Takes the next tick at the time `now_ns` and returns its index: the newest that is due.
    pub fn take(&mut self, now_ns: u64) -> u64 {
        let behind_ns = now_ns.saturating_sub(self.deadline_ns()) as f64;
        let passed = (behind_ns / self.period_ns) as u64;
        let index = self.next + passed;
        self.kept.ticks += 1;
        self.kept.skipped += passed;
        self.kept.late += u64::from(behind_ns > self.period_ns / 2.0);
        self.next = index + 1;
        index
    }

    /// How well deadlines were kept so far.
    #[must_use]
    pub fn kept(&self) -> Punctuality {
        self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START_NS: u64 = 5_000_000;
    const PERIOD_NS: u64 = 1_000_000;

    #[test]
    fn punctual_ticks_are_neither_late_nor_skipped() {
        let mut schedule = Schedule::new(START_NS, 1000.0);
        for n in 0..1000 {
            assert_eq!(schedule.deadline_ns(), START_NS + n * PERIOD_NS);
            assert_eq!(schedule.take(schedule.deadline_ns() + 50_000), n);
        }
        assert_eq!(schedule.kept(), Punctuality { ticks: 1000, late: 0, skipped: 0 });
    }

    #[test]
    fn late_wake_up_does_not_move_later_deadlines() {
        let mut schedule = Schedule::new(START_NS, 1000.0);
        assert_eq!(schedule.take(START_NS + 700_000), 0);
        assert_eq!(schedule.deadline_ns(), START_NS + PERIOD_NS);
        assert_eq!(schedule.kept(), Punctuality { ticks: 1, late: 1, skipped: 0 });
    }

    #[test]
    fn missed_ticks_are_skipped_not_sent_in_a_burst() {
        let mut schedule = Schedule::new(START_NS, 1000.0);
        assert_eq!(schedule.take(START_NS), 0);
        assert_eq!(schedule.take(START_NS + 5 * PERIOD_NS + 10), 5);
        assert_eq!(schedule.deadline_ns(), START_NS + 6 * PERIOD_NS);
        assert_eq!(schedule.kept(), Punctuality { ticks: 2, late: 1, skipped: 4 });
    }

    #[test]
    fn rates_that_do_not_divide_a_second_do_not_drift() {
        let mut schedule = Schedule::new(0, 300.0);
        for _ in 0..300 {
            schedule.take(schedule.deadline_ns());
        }
        assert_eq!(schedule.deadline_ns(), 1_000_000_000);
    }
}
