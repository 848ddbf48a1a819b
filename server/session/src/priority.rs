//! Which threads get the machine first: those that step, then the network's, then those that work for the eye.
//!
//! A thread that steps asks for real-time priority. Where it may not have it, it stays as it is, and what is done for viewers
//! and for the record is below it either way: that asks for no permission.

use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

use rustix::process::setpriority_process;
use rustix::thread::gettid;
use thread_priority::unix::{set_thread_priority_and_policy, thread_native_id};
use thread_priority::{RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy};

/// Real-time priority of a thread that steps, of 1 to 99: above all that is not real-time, below the kernel's own threads
/// and a haptic servo on the same machine, which have 50.
pub const REAL_TIME_PRIORITY: u8 = 10;
/// Niceness of what is done for the eye and the record: beside a thread that steps at 0 it gets a tenth of a core, enough
/// for 60 states a second of the liver, and all of what nobody else uses.
const NICENESS_OF_VIEWING: i32 = 10;

/// Threads with real-time priority.
static REAL_TIME: AtomicUsize = AtomicUsize::new(0);

/// Real-time priority for so many threads, for as long as this lives; one core is left to all else, so that sessions that
/// do not keep their rates keep nobody from reaching them.
pub(crate) struct RealTime {
    threads: usize,
}

impl RealTime {
    /// Claims it; `None` where sessions have all cores but one already.
    pub fn claim(threads: usize) -> Option<Self> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        // Made only where it was claimed: what is dropped gives it back.
        Self::claim_of(&REAL_TIME, threads, cores).then(|| Self { threads })
    }

    fn claim_of(taken: &AtomicUsize, threads: usize, cores: usize) -> bool {
        let more = |taken: usize| Some(taken + threads).filter(|taken| *taken < cores);
        taken.fetch_update(Ordering::AcqRel, Ordering::Acquire, more).is_ok()
    }

    /// Asks for it, for the calling thread; whether it may have it is logged once.
    pub fn begin(&self) {
        static TOLD: Once = Once::new();
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let priority = ThreadPriority::Crossplatform(REAL_TIME_PRIORITY.try_into().expect("between 0 and 99"));
        let asked = set_thread_priority_and_policy(thread_native_id(), priority, policy);
        TOLD.call_once(|| match asked {
            Ok(()) => tracing::info!(priority = REAL_TIME_PRIORITY, "sessions step with real-time priority"),
            Err(error) => tracing::info!(
                ?error,
                "sessions step without real-time priority: on a busy machine steps may come late; docs/reference/server.md says how to \
                 allow it"
            ),
        });
    }
}

impl Drop for RealTime {
    fn drop(&mut self) {
        REAL_TIME.fetch_sub(self.threads, Ordering::AcqRel);
    }
}

/// Puts the calling thread below those that step: it works for the eye or the record.
pub fn stand_back() {
    if let Err(error) = setpriority_process(Some(gettid()), NICENESS_OF_VIEWING) {
        tracing::warn!(%error, "a thread could not be put below those that step");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_core_is_left_to_all_else() {
        let taken = AtomicUsize::new(0);
        let claim = |threads| RealTime::claim_of(&taken, threads, 4);
        assert_eq!([claim(1), claim(3), claim(2), claim(1)], [true, false, true, false]);
        assert!(!RealTime::claim_of(&AtomicUsize::new(0), 1, 1), "the only core is everybody's");
    }

    #[test]
    fn a_thread_that_stands_back_is_below_the_others() {
        use rustix::process::getpriority_process;
        let niceness = || getpriority_process(Some(gettid())).unwrap();
        let before = niceness();
        let stood_back = std::thread::spawn(move || {
            stand_back();
            niceness()
        });
        assert_eq!(stood_back.join().unwrap(), NICENESS_OF_VIEWING.max(before));
        assert_eq!(niceness(), before, "the others stay");
    }
}
