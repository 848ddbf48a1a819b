//! Which threads get the machine first: those that step, then the network's, then those that work for the eye.
//!
//! A thread that steps asks for real-time priority. Where it may not have it, it stays as it is, and what is done for viewers
//! and for the record is below it either way: that asks for no permission.

use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

use rustix::process::{getpriority_process, setpriority_process};
use rustix::thread::gettid;
use thread_priority::unix::{set_thread_priority_and_policy, thread_native_id};
use thread_priority::{
    Error, NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
};

/// Real-time priority of a thread that steps, of 1 to 99: above all that is not real-time, below the kernel's own threads
/// and a haptic servo on the same machine, which have 50.
pub const REAL_TIME_PRIORITY: u8 = 10;
/// Niceness of what is done for the eye and the record: beside a thread that steps at 0 it gets a tenth of a core, enough
/// for 60 states a second of the liver, and all of what nobody else uses.
const NICENESS_OF_VIEWING: i32 = 10;

/// What the library takes for the niceness 0 of an ordinary thread, of 0 to 99.
const NICENESS_ZERO: u8 = 47;
/// Thousandths of a core in a core: what shares are counted in.
const SHARES_PER_CORE: f64 = 1000.0;

/// What threads with real-time priority may keep busy, in thousandths of a core.
static REAL_TIME: AtomicUsize = AtomicUsize::new(0);

/// Share of two cores that such threads may keep busy; of more, all but one. Sessions that do not keep their rates then keep
/// nobody from reaching them. With one core of two left, those of six that cut a liver at 60 Hz in its deepest had it in turns.
const SHARE_OF_TWO_CORES: f64 = 0.65;

/// Real-time priority for threads that keep so much of the cores busy, for as long as this lives.
pub(crate) struct RealTime {
    shares: usize,
}

impl RealTime {
    /// Claims it for threads that keep so many cores busy; `None` where others leave too little.
    pub fn claim(load: f64) -> Option<Self> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        // At least one share: a single core is everybody's.
        let shares = ((load * SHARES_PER_CORE).ceil() as usize).max(1);
        // Made only where it was claimed: what is dropped gives it back.
        Self::claim_of(&REAL_TIME, shares, cores).then(|| Self { shares })
    }

    fn claim_of(taken: &AtomicUsize, shares: usize, cores: usize) -> bool {
        let most = match cores {
            2 => SHARE_OF_TWO_CORES * 2.0 * SHARES_PER_CORE,
            cores => (cores - 1) as f64 * SHARES_PER_CORE,
        };
        let more = |taken: usize| Some(taken + shares).filter(|taken| *taken as f64 <= most);
        taken.fetch_update(Ordering::AcqRel, Ordering::Acquire, more).is_ok()
    }

    /// Asks for it, for the calling thread; whether it may have it is logged once.
    pub fn begin(&self) {
        static TOLD: Once = Once::new();
        let asked = schedule(ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo), REAL_TIME_PRIORITY);
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
        REAL_TIME.fetch_sub(self.shares, Ordering::AcqRel);
    }
}

/// Back to what threads begin with.
fn end() {
    // The library sets a niceness with the policy, and may not where the process has a greater one.
    let niceness = getpriority_process(Some(gettid())).unwrap_or_default();
    let ended = schedule(ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other), NICENESS_ZERO);
    let restored = setpriority_process(Some(gettid()), niceness);
    tracing::debug!(?ended, ?restored, "a session steps with ordinary priority: others need the machine too");
}

fn schedule(policy: ThreadSchedulePolicy, priority: u8) -> Result<(), Error> {
    let priority = ThreadPriority::Crossplatform(priority.try_into().expect("between 0 and 99"));
    set_thread_priority_and_policy(thread_native_id(), priority, policy)
}

/// Keeps the calling thread at real-time priority while all that have it leave a core to the rest. Many sessions that cost
/// little have it together; those that come to cost too much step as everybody else.
#[derive(Default)]
pub(crate) struct Following {
    load: Option<f64>,
    real_time: Option<RealTime>,
}

impl Following {
    /// The thread keeps so much of a core busy. `None`: its steps have no deadline.
    pub fn follow(&mut self, load: Option<f64>) {
        if self.real_time.is_some() && load == self.load {
            return;
        }
        self.load = load;
        let had = self.real_time.take().is_some();
        self.real_time = load.and_then(RealTime::claim);
        match &self.real_time {
            Some(real_time) if !had => real_time.begin(),
            None if had => end(),
            _ => {}
        }
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
    use thread_priority::unix::thread_schedule_policy_param;

    use super::*;

    #[test]
    fn one_core_is_left_to_all_else_and_a_third_of_two() {
        let two = AtomicUsize::new(0);
        assert_eq!([1300, 1].map(|shares| RealTime::claim_of(&two, shares, 2)), [true, false]);
        let taken = AtomicUsize::new(0);
        let claim = |shares| RealTime::claim_of(&taken, shares, 4);
        assert_eq!([claim(1000), claim(2500), claim(2000), claim(1)], [true, false, true, false]);
        assert!(!RealTime::claim_of(&AtomicUsize::new(0), 1, 1), "the only core is everybody's");
    }

    #[test]
    fn a_thread_has_real_time_priority_while_it_has_deadlines_and_its_load_leaves_a_core_to_all_else() {
        let policy = || thread_schedule_policy_param(thread_native_id()).unwrap().0;
        let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let cores = std::thread::available_parallelism().unwrap().get() as f64;
        let policies = std::thread::spawn(move || {
            let mut following = Following::default();
            [Some(0.01), Some(cores), Some(0.02), None].map(|load| {
                following.follow(load);
                policy()
            })
        });
        let policies = policies.join().unwrap();
        let may_have_it = schedule_is_permitted();
        assert_eq!(policies.map(|policy| policy == fifo), [may_have_it, false, may_have_it, false], "{policies:?}");
    }

    /// Whether this process may have real-time priority, and there is a core for it.
    fn schedule_is_permitted() -> bool {
        let may = || schedule(ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo), 10).is_ok();
        std::thread::available_parallelism().unwrap().get() > 1 && std::thread::spawn(may).join().unwrap()
    }

    #[test]
    fn a_thread_that_stands_back_is_below_the_others() {
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
