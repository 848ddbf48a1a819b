//! Which threads get the machine first: those that step, then the network's, then those that work for the eye.
//!
//! What is done for viewers and for the record is below the rest, which asks for no permission. Threads that step are above
//! it, where they may be: a session that a hand drives steps with real-time priority while a core is left to all else, the
//! others are favoured among ordinary threads.
//!
//! Real-time threads keep off the first core, and are fewer than the cores: what arrives from the network waits for no step.
//! Where sixteen sessions, four of them cut, stepped on both of two cores with real-time priority, one pose in a hundred
//! waited for 60 to 90 ms.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Once, OnceLock};

use rustix::process::{getpriority_process, setpriority_process};
use rustix::thread::{CpuSet, gettid, sched_getaffinity, sched_setaffinity};
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
/// Niceness of a thread that steps without real-time priority: it gets ten times as much of a core as an ordinary thread
/// that wants the same one, which still gets what little it wants within milliseconds.
const NICENESS_OF_FAVOURED: i32 = -10;
/// What the library takes for the niceness 0 of an ordinary thread, of 0 to 99.
const NICENESS_ZERO: u8 = 47;
/// Share of a core that a thread with real-time priority may keep busy: from one that leaves next to nothing the kernel takes
/// the core for 50 ms of a second at once, for the sake of the others that wait.
const MOST_LOAD: f64 = 0.8;

/// Threads that have a claim to real-time priority.
static REAL_TIME: AtomicUsize = AtomicUsize::new(0);

/// A claim to real-time priority for so many threads, for as long as this lives.
pub(crate) struct RealTime {
    threads: usize,
}

impl RealTime {
    /// Claims it; `None` where no core would be left to the others.
    pub fn claim(threads: usize) -> Option<Self> {
        let cores = Cores::of_process().count;
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
        let asked = schedule(ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo), REAL_TIME_PRIORITY);
        match asked {
            Ok(()) => run_on(&Cores::of_process().real_time),
            Err(_) => favour(),
        }
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

/// To an ordinary priority of this niceness, where it may be had, and any core.
fn end(niceness: i32) {
    let ended = schedule(ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other), NICENESS_ZERO);
    let niced = setpriority_process(Some(gettid()), niceness);
    run_on(&Cores::of_process().all);
    tracing::debug!(?ended, ?niced, "a session steps without real-time priority");
}

/// Puts the calling thread above ordinary ones, where it may be and is not yet.
pub(crate) fn favour() {
    let niceness = getpriority_process(Some(gettid())).unwrap_or_default();
    if let Err(error) = setpriority_process(Some(gettid()), NICENESS_OF_FAVOURED.min(niceness)) {
        tracing::debug!(%error, "a thread that steps is not favoured");
    }
}

/// Cores that this process may run on, of those that the machine has.
struct Cores {
    /// How many it may keep busy: a quota may allow fewer than it may run on. Asked once: files tell of the quota.
    count: usize,
    all: CpuSet,
    /// All but the first.
    real_time: CpuSet,
}

impl Cores {
    /// As they were when a thread first had a claim to real-time priority, before any was kept off the first.
    fn of_process() -> &'static Self {
        static OF_PROCESS: OnceLock<Cores> = OnceLock::new();
        OF_PROCESS.get_or_init(|| {
            let all = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
            let mut real_time = all;
            (0..CpuSet::MAX_CPU).find(|core| all.is_set(*core)).into_iter().for_each(|first| real_time.unset(first));
            Self { count: std::thread::available_parallelism().map_or(1, usize::from), all, real_time }
        })
    }
}

/// Keeps the calling thread on these cores. It may run on all of them where that cannot be had.
fn run_on(cores: &CpuSet) {
    if let Err(error) = sched_setaffinity(None, cores) {
        tracing::debug!(%error, "a thread could not be kept on its cores");
    }
}

fn schedule(policy: ThreadSchedulePolicy, priority: u8) -> Result<(), Error> {
    let priority = ThreadPriority::Crossplatform(priority.try_into().expect("between 0 and 99"));
    set_thread_priority_and_policy(thread_native_id(), priority, policy)
}

/// What a session asks of the machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// Share of a core that its steps keep busy.
    pub load: f64,
    /// Whether somebody drives a tool in it, who feels what is late.
    pub is_driven: bool,
}

/// What the calling thread has of the machine before others.
enum Rank {
    /// As much as others: no deadline waits for it.
    Ordinary,
    /// More than others, where both want a core.
    Favoured,
    /// A core whenever it wants one.
    RealTime(RealTime),
}

/// Gives the calling thread the rank that its session's demand asks for and the other sessions leave.
pub(crate) struct Following {
    rank: Rank,
    /// Niceness of the thread when it began.
    niceness: i32,
}

impl Following {
    /// Of the calling thread, which has no deadline yet.
    pub fn begin() -> Self {
        Self { rank: Rank::Ordinary, niceness: getpriority_process(Some(gettid())).unwrap_or_default() }
    }

    /// `None`: the session's steps have no deadline.
    pub fn follow(&mut self, demand: Option<Demand>) {
        let may_claim = demand.is_some_and(|demand| demand.is_driven && demand.load < MOST_LOAD);
        if may_claim && matches!(self.rank, Rank::RealTime(_)) {
            return;
        }
        let rank = match may_claim.then(|| RealTime::claim(1)).flatten() {
            Some(real_time) => Rank::RealTime(real_time),
            None if demand.is_some() => Rank::Favoured,
            None => Rank::Ordinary,
        };
        let before = std::mem::replace(&mut self.rank, rank);
        match (&before, &self.rank) {
            (Rank::Favoured, Rank::Favoured) | (Rank::Ordinary, Rank::Ordinary) => {}
            (_, Rank::RealTime(real_time)) => real_time.begin(),
            (_, Rank::Favoured) => {
                end(self.niceness);
                favour();
            }
            (_, Rank::Ordinary) => end(self.niceness),
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
    fn one_core_is_left_to_all_else() {
        let taken = AtomicUsize::new(0);
        let claim = |threads| RealTime::claim_of(&taken, threads, 4);
        assert_eq!([claim(1), claim(3), claim(2), claim(1)], [true, false, true, false]);
        assert!(!RealTime::claim_of(&AtomicUsize::new(0), 1, 1), "the only core is everybody's");
    }

    #[test]
    fn a_thread_has_real_time_priority_off_the_first_core_while_a_hand_waits_for_it() {
        let policy = || thread_schedule_policy_param(thread_native_id()).unwrap().0;
        let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let cores = |set: CpuSet| (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core)).collect::<Vec<_>>();
        let all = cores(sched_getaffinity(None).unwrap());
        let driven = |load| Some(Demand { load, is_driven: true });
        let watched = Some(Demand { load: 0.01, is_driven: false });
        let followed = std::thread::spawn(move || {
            let mut following = Following::begin();
            [driven(0.01), driven(MOST_LOAD), driven(0.02), watched, driven(0.02), None].map(|demand| {
                following.follow(demand);
                (policy() == fifo, cores(sched_getaffinity(None).unwrap()))
            })
        });
        let may_have_it = schedule_is_permitted();
        let (has, has_not) = ((may_have_it, all[usize::from(may_have_it)..].to_vec()), (false, all));
        let expected = [&has, &has_not, &has, &has_not, &has, &has_not].map(Clone::clone);
        assert_eq!(followed.join().unwrap(), expected);
    }

    #[test]
    fn a_thread_with_deadlines_is_favoured_among_ordinary_ones_where_it_may_be() {
        let niceness = || getpriority_process(Some(gettid())).unwrap();
        let (before, favoured, after, may_be) = std::thread::spawn(move || {
            let (mut following, before) = (Following::begin(), niceness());
            following.follow(Some(Demand { load: 0.1, is_driven: false }));
            let favoured = niceness();
            following.follow(None);
            let after = niceness();
            (before, favoured, after, setpriority_process(Some(gettid()), NICENESS_OF_FAVOURED).is_ok())
        })
        .join()
        .unwrap();
        assert_eq!(favoured, if may_be { NICENESS_OF_FAVOURED.min(before) } else { before });
        assert!(after == before || !may_be);
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
