//! What sessions may take of the machine, all of them together: memory, and time of its cores.
//!
//! A session is admitted by what it is told to cost, and counts with what it was measured to cost where that is more.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, Weak};

use kerf_scenes::cost::Cost;

use crate::error::SessionError;
use crate::lock::lock;

/// Part of a session's memory that a checkpoint of it takes: the state without what follows from the scene.
const CHECKPOINT_SHARE: f64 = 0.5;
/// What a load counts that was measured a second ago: half is left after 23 s. A hand that lifts its tool puts it down
/// again; for whom it keeps its place longer is refused who could have come.
const KEPT_SHARE: f64 = 0.97;
const BYTES_PER_MIB: f64 = 1048576.0;

/// What sessions may take, and what they have taken.
#[derive(Debug)]
pub(crate) struct Admission {
    max_bytes: f64,
    max_load: f64,
    max_setup_s: f64,
    threads_per_session: f64,
    taken: Mutex<Taken>,
}

#[derive(Debug, Default)]
struct Taken {
    bytes: f64,
    loads: Vec<Weak<Load>>,
}

/// What one session takes; given back by its end.
#[derive(Debug)]
pub(crate) struct Admitted {
    /// Its memory.
    pub memory: Reservation,
    /// Its time.
    pub load: Arc<Load>,
}

impl Admission {
    pub fn new(max_memory_mib: f64, max_load: f64, max_setup_s: f64, threads_per_session: usize) -> Arc<Self> {
        Arc::new(Self {
            max_bytes: max_memory_mib * BYTES_PER_MIB,
            max_load,
            max_setup_s,
            threads_per_session: threads_per_session as f64,
            taken: Mutex::default(),
        })
    }

    /// Takes what a session of a scene needs, or nothing. One that waits for its client's steps is late for nobody: it
    /// takes memory, and time only once it is to run by itself (`Load::run`).
    pub fn admit(self: &Arc<Self>, cost: &Cost, rate_hz: f64, waits: bool) -> Result<Admitted, SessionError> {
        if cost.setup_s > self.max_setup_s {
            return Err(SessionError::SetupTime { needed_s: cost.setup_s, limit_s: self.max_setup_s });
        }
        // A session that cannot keep its rate takes no more than its threads.
        let load = (cost.step_s * rate_hz).min(self.threads_per_session);
        let memory = self.reserve(cost.bytes)?;
        let load = Arc::new(Load {
            told: load,
            most: self.threads_per_session,
            measured: AtomicU64::new(0),
            peak: AtomicU64::new(0),
            runs: AtomicBool::new(false),
            admission: Arc::clone(self),
        });
        if !waits {
            load.run()?;
        }
        let mut taken = lock(&self.taken);
        taken.loads.retain(|load| load.strong_count() > 0);
        taken.loads.push(Arc::downgrade(&load));
        Ok(Admitted { memory, load })
    }

    /// Memory that is taken, bytes.
    pub fn taken_bytes(&self) -> f64 {
        lock(&self.taken).bytes
    }

    fn reserve(self: &Arc<Self>, bytes: f64) -> Result<Reservation, SessionError> {
        let mut taken = lock(&self.taken);
        if taken.bytes + bytes > self.max_bytes {
            let mib = |bytes: f64| (bytes / BYTES_PER_MIB).ceil() as u64;
            let (needed_mib, taken_mib) = (mib(bytes), mib(taken.bytes));
            return Err(SessionError::Memory { needed_mib, taken_mib, limit_mib: mib(self.max_bytes) });
        }
        taken.bytes += bytes;
        Ok(Reservation { admission: Arc::clone(self), bytes })
    }
}

/// Memory that is taken while this lives.
#[derive(Debug)]
pub(crate) struct Reservation {
    admission: Arc<Admission>,
    bytes: f64,
}

impl Reservation {
    pub fn bytes(&self) -> f64 {
        self.bytes
    }

    /// As much once more, for a world that is built while the old one is there.
    pub fn another(&self) -> Result<Self, SessionError> {
        self.admission.reserve(self.bytes)
    }

    /// What a checkpoint needs.
    pub fn checkpoint(&self) -> Result<Self, SessionError> {
        self.admission.reserve(CHECKPOINT_SHARE * self.bytes)
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        lock(&self.admission.taken).bytes -= self.bytes;
    }
}

/// Cores that a session keeps busy.
#[derive(Debug)]
pub(crate) struct Load {
    told: f64,
    most: f64,
    /// Bits of what was last measured.
    measured: AtomicU64,
    /// Bits of the most that was measured, less what it has faded since.
    peak: AtomicU64,
    /// It steps by itself, or did: it is counted.
    runs: AtomicBool,
    admission: Arc<Admission>,
}

impl Load {
    /// Takes the time that the session needs to step by itself, for as long as it lives.
    ///
    /// # Errors
    /// The sessions that run leave too little.
    pub fn run(&self) -> Result<(), SessionError> {
        let taken = lock(&self.admission.taken);
        if self.is_counted() {
            return Ok(());
        }
        let loads = || taken.loads.iter().filter_map(Weak::upgrade);
        let others: f64 = loads().map(|load| load.counted()).sum();
        // One session is always admitted: whether it keeps its rate is its own affair.
        if others > 0.0 && others + self.told > self.admission.max_load {
            let measured = loads().map(|load| load.measured()).sum();
            return Err(SessionError::Load {
                needed: self.told,
                taken: others,
                measured,
                limit: self.admission.max_load,
            });
        }
        self.runs.store(true, Ordering::Relaxed);
        Ok(())
    }

    /// Share of a core that the session's steps may keep busy beside those of the others: what these leave of what sessions
    /// may take together, or as much as each of them that wants more (max-min fairness). No limit to a session that is alone.
    /// `None` while the others are counted elsewhere: a thread that steps waits for nobody, nor does it allocate.
    pub fn fair_share(&self) -> Option<f64> {
        let taken = self.admission.taken.try_lock().ok()?;
        let is_other = |load: &Arc<Self>| load.is_counted() && !std::ptr::eq(&**load, self);
        let loads = || taken.loads.iter().filter_map(Weak::upgrade).filter(is_other);
        if loads().next().is_none() {
            return Some(f64::INFINITY);
        }
        let mut share = 0.0;
        loop {
            // Those that take less than that leave the rest to the others.
            let (less, more) = loads()
                .map(|load| load.peak())
                .fold((0.0, 1), |(less, more), load| if load < share { (less + load, more) } else { (less, more + 1) });
            let next = (self.admission.max_load - less) / f64::from(more);
            if next <= share {
                return Some(share);
            }
            share = next;
        }
    }

    /// What was measured of late: the time of steps over the time they had.
    pub fn measured(&self) -> f64 {
        f64::from_bits(self.measured.load(Ordering::Relaxed))
    }

    /// The load of another second of simulated time.
    pub fn set_measured(&self, load: f64) {
        self.measured.store(load.to_bits(), Ordering::Relaxed);
        let faded = KEPT_SHARE * self.peak();
        self.peak.store(faded.max(load).to_bits(), Ordering::Relaxed);
    }

    /// Whether it takes time of the others: steps that calls ask for are late for nobody.
    fn is_counted(&self) -> bool {
        self.runs.load(Ordering::Relaxed)
    }

    fn peak(&self) -> f64 {
        f64::from_bits(self.peak.load(Ordering::Relaxed))
    }

    /// A session at rest costs nothing, until somebody touches its tissue: it counts with what it was told to cost.
    fn counted(&self) -> f64 {
        if !self.is_counted() {
            return 0.0;
        }
        self.told.max(self.peak()).min(self.most)
    }
}

/// Sums up steps, a second of simulated time at a time.
#[derive(Debug, Default)]
pub(crate) struct LoadMeter {
    steps: u32,
    busy_ns: u64,
}

impl LoadMeter {
    /// A step has ended; answers with the load at the end of each second.
    pub fn step_ended(&mut self, elapsed_ns: u64, rate_hz: f64) -> Option<f64> {
        self.steps += 1;
        self.busy_ns += elapsed_ns;
        let had_s = f64::from(self.steps) / rate_hz;
        (had_s >= 1.0).then(|| std::mem::take(self).busy_ns as f64 * 1e-9 / had_s)
    }

    /// Least load of the second that has begun: what it would be if no step took any more time.
    pub fn so_far(&self) -> f64 {
        self.busy_ns as f64 * 1e-9
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COST: Cost = Cost { bytes: 40.0 * BYTES_PER_MIB, setup_s: 1.0, step_s: 8e-4 };

    fn admission() -> Arc<Admission> {
        Admission::new(100.0, 2.0, 10.0, 1)
    }

    #[test]
    fn memory_is_given_back_when_it_is_not_needed_any_more() {
        let admission = Admission::new(100.0, f64::INFINITY, 10.0, 1);
        let [first, _second] = [(); 2].map(|()| admission.admit(&COST, 1000.0, false).unwrap());
        let refused = admission.admit(&COST, 1000.0, false).unwrap_err();
        assert_eq!(refused, SessionError::Memory { needed_mib: 40, taken_mib: 80, limit_mib: 100 });
        let checkpoint = first.memory.checkpoint().unwrap();
        assert!(first.memory.checkpoint().is_err() && first.memory.another().is_err());
        drop((first, checkpoint));
        assert!(admission.admit(&COST, 1000.0, false).is_ok());
    }

    #[test]
    fn sessions_are_admitted_by_what_they_are_told_or_measured_to_need() {
        let admission = Admission::new(1000.0, 2.0, 10.0, 1);
        let first = admission.admit(&COST, 1000.0, false).unwrap();
        let second = admission.admit(&COST, 1000.0, false).unwrap();
        assert!(matches!(admission.admit(&COST, 1000.0, false), Err(SessionError::Load { limit: 2.0, .. })));
        assert!(admission.admit(&COST, 100.0, false).is_ok(), "a slower one fits");
        drop(second);
        first.load.set_measured(0.1);
        assert!(admission.admit(&COST, 1000.0, false).is_ok(), "the first one rests");
        first.load.set_measured(40.0);
        assert!(admission.admit(&COST, 1000.0, false).is_ok(), "no more than its thread is busy");
    }

    #[test]
    fn a_session_that_worked_is_counted_a_while_longer_and_a_refusal_says_what_is_measured_now() {
        let admission = Admission::new(1000.0, 2.0, 10.0, 2);
        let first = admission.admit(&COST, 1000.0, false).unwrap();
        first.load.set_measured(1.6);
        first.load.set_measured(0.1);
        let refused = admission.admit(&COST, 1000.0, false).unwrap_err();
        let SessionError::Load { needed, taken, measured, limit } = refused else { panic!("{refused}") };
        assert_eq!((needed, measured, limit), (0.8, 0.1, 2.0));
        assert!((1.5..1.6).contains(&taken), "{taken}");
        (0..30).for_each(|_| first.load.set_measured(0.1));
        assert!(admission.admit(&COST, 1000.0, false).is_ok(), "it has rested for long");
    }

    #[test]
    fn a_session_may_take_what_the_others_leave_or_as_much_as_those_that_want_more() {
        let shares = |measured: &[f64]| {
            let (admission, cost) = (admission(), Cost { bytes: 0.0, step_s: 1e-5, ..COST });
            let admit = |_: &f64| admission.admit(&cost, 1000.0, false).unwrap();
            let sessions: Vec<_> = measured.iter().map(admit).collect();
            sessions.iter().zip(measured).for_each(|(session, load)| session.load.set_measured(*load));
            let share = |session: &Admitted| (session.load.fair_share().unwrap() * 100.0).round() / 100.0;
            sessions.iter().map(share).collect::<Vec<_>>()
        };
        assert_eq!(shares(&[0.9]), [f64::INFINITY], "it is alone");
        assert_eq!(shares(&[0.0; 4]), [2.0; 4]);
        assert_eq!(shares(&[0.9; 4]), [0.5; 4], "all want more");
        // Those that take less leave the rest to the others.
        assert_eq!(shares(&[0.1, 0.1, 0.9, 0.9]), [0.63, 0.63, 0.9, 0.9]);
        assert_eq!(shares(&[0.1, 0.1, 0.1, 0.9])[3], 1.7);
        let admission = admission();
        let [running, waiting] = [false, true].map(|waits| admission.admit(&COST, 1000.0, waits).unwrap());
        waiting.load.set_measured(40.0);
        assert_eq!(running.load.fair_share(), Some(f64::INFINITY), "steps that a client asks for leave it alone");
    }

    #[test]
    fn sessions_that_wait_for_their_clients_take_time_only_once_they_run() {
        let admission = admission();
        let waiting: Vec<_> = (0..2).map(|_| admission.admit(&COST, 1000.0, true).unwrap()).collect();
        let running: Vec<_> = (0..2).map(|_| admission.admit(&Cost { bytes: 0.0, ..COST }, 1000.0, false)).collect();
        assert!(running.iter().all(Result::is_ok), "two take 1.6 of 2 cores");
        assert!(matches!(waiting[0].load.run(), Err(SessionError::Load { limit: 2.0, .. })));
        drop(running);
        assert_eq!((waiting[0].load.run(), waiting[0].load.run()), (Ok(()), Ok(())), "it is counted once");
    }

    #[test]
    fn one_session_is_admitted_though_it_does_not_keep_its_rate_but_not_if_it_takes_for_ever_to_build() {
        let slow = Cost { step_s: 1.0, ..COST };
        assert!(Admission::new(100.0, 0.5, 10.0, 1).admit(&slow, 1000.0, false).is_ok());
        let large = Cost { setup_s: 11.0, ..COST };
        assert!(matches!(admission().admit(&large, 1000.0, false), Err(SessionError::SetupTime { .. })));
    }
}
