//! The monotonic clock that sessions are paced by.

use kerf_physics::StageClock;
use rustix::io::Errno;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

const NS_PER_S: u64 = 1_000_000_000;

/// `CLOCK_MONOTONIC`. The kernel's own timer is used for sleeping because timers of an async
/// runtime have a resolution of one millisecond, a whole step.
#[derive(Clone, Copy, Debug, Default)]
pub struct MonotonicClock;

impl MonotonicClock {
    /// Nanoseconds since an arbitrary origin.
    #[must_use]
    pub fn now_ns() -> u64 {
        #[cfg(feature = "virtual-time")]
        if let Some(now_ns) = crate::virtual_time::now_ns() {
            return now_ns;
        }
        let now = clock_gettime(ClockId::Monotonic);
        // The monotonic clock counts up from boot, so neither field is ever negative.
        now.tv_sec.unsigned_abs() * NS_PER_S + u64::from(now.tv_nsec.unsigned_abs() as u32)
    }

    /// Returns at `deadline_ns` or, if that has passed, at once.
    pub fn sleep_until(deadline_ns: u64) {
        // The kernel would give the core away even so, and have it back after others.
        if Self::now_ns() >= deadline_ns {
            return;
        }
        let until = Timespec {
            tv_sec: i64::try_from(deadline_ns / NS_PER_S).unwrap_or(i64::MAX),
            tv_nsec: i64::try_from(deadline_ns % NS_PER_S).unwrap_or(0),
        };
        // An absolute deadline makes a retry after a signal exact.
        while clock_nanosleep_absolute(ClockId::Monotonic, &until) == Err(Errno::INTR) {}
    }
}

impl StageClock for MonotonicClock {
    fn now_ns(&self) -> u64 {
        Self::now_ns()
    }
}

#[cfg(test)]
mod tests {
    use super::MonotonicClock;

    #[test]
    fn sleeping_ends_at_or_after_the_deadline() {
        let deadline = MonotonicClock::now_ns() + 3_000_000;
        MonotonicClock::sleep_until(deadline);
        assert!(MonotonicClock::now_ns() >= deadline);
    }

    #[test]
    fn a_deadline_that_has_passed_does_not_sleep() {
        let before = MonotonicClock::now_ns();
        MonotonicClock::sleep_until(before.saturating_sub(1_000_000_000));
        assert!(MonotonicClock::now_ns() - before < 500_000_000);
    }
}
