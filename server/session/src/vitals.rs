//! What a session shows of itself without being asked: its thread writes, and whoever looks waits for nobody, also where
//! the thread hangs.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::counts::TimedStep;
use crate::status::Phase;

/// Signs of life of one session, and what it has done since it began, resets included.
#[derive(Debug)]
pub struct Vitals {
    /// When its thread last came by, ns on the server's monotonic clock; `UNBORN_NS` before it first does.
    came_by_ns: AtomicU64,
    /// How long it may stay away, ns: usually, and this time.
    usual_patience_ns: u64,
    patience_ns: AtomicU64,
    steps: AtomicU64,
    late_steps: AtomicU64,
    busy_ns: AtomicU64,
    /// Of the second that is going on, and of the one before.
    longest_now_ns: AtomicU64,
    longest_ns: AtomicU64,
    faults: AtomicU64,
    parted_links: AtomicU64,
    /// Bits of the energy that the ledger does not explain.
    residual_j: AtomicU64,
}

/// Later than any time.
const UNBORN_NS: u64 = u64::MAX;

/// What a session has done since it began.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Done {
    /// Steps taken.
    pub steps: u64,
    /// Of these, those that ended after their deadline.
    pub late_steps: u64,
    /// Time of all steps, ns.
    pub busy_ns: u64,
    /// The longest step of the last whole second of simulated time, ns.
    pub longest_step_ns: u64,
    /// State that was taken back, and steps that panicked.
    pub faults: u64,
    /// Links that parted.
    pub parted_links: u64,
    /// Energy since the scene was at rest that the ledger does not explain, J.
    pub residual_j: f64,
}

impl Vitals {
    /// Of a session whose thread hangs when it stays away for longer than this, ns.
    pub(crate) fn new(patience_ns: u64) -> Self {
        let zero = || AtomicU64::new(0);
        Self {
            came_by_ns: AtomicU64::new(UNBORN_NS),
            usual_patience_ns: patience_ns,
            patience_ns: AtomicU64::new(patience_ns),
            steps: zero(),
            late_steps: zero(),
            busy_ns: zero(),
            longest_now_ns: zero(),
            longest_ns: zero(),
            faults: zero(),
            parted_links: zero(),
            residual_j: zero(),
        }
    }

    /// The session's thread comes by: it does so to step, and now and then while it stands.
    pub(crate) fn come_by(&self, now_ns: u64) {
        self.patience_ns.store(self.usual_patience_ns, Ordering::Relaxed);
        self.came_by_ns.store(now_ns, Ordering::Relaxed);
    }

    /// It begins something that may take so much longer.
    pub(crate) fn ask_for_patience(&self, more_ns: u64) {
        self.patience_ns.store(self.usual_patience_ns.saturating_add(more_ns), Ordering::Relaxed);
    }

    /// Adds a step; `ends_second`, where it is the last of a second of simulated time.
    pub(crate) fn step_ended(&self, step: &TimedStep<'_>, residual_j: f64, ends_second: bool) {
        let add = |count: &AtomicU64, more| _ = count.fetch_add(more, Ordering::Relaxed);
        add(&self.steps, 1);
        add(&self.late_steps, u64::from(step.pace.is_some_and(|pace| pace.lag_ns() > 0)));
        add(&self.busy_ns, step.elapsed_ns);
        add(&self.faults, u64::from(step.output.fault.is_some()));
        add(&self.parted_links, u64::from(step.output.fracture.parted_links));
        self.residual_j.store(residual_j.to_bits(), Ordering::Relaxed);
        self.longest_now_ns.fetch_max(step.elapsed_ns, Ordering::Relaxed);
        if ends_second {
            self.longest_ns.store(self.longest_now_ns.swap(0, Ordering::Relaxed), Ordering::Relaxed);
        }
    }

    /// A step panicked.
    pub(crate) fn panicked(&self) {
        self.faults.fetch_add(1, Ordering::Relaxed);
    }

    /// How long its thread has stayed away, ns; 0 before it first came by.
    #[must_use]
    pub fn away_ns(&self, now_ns: u64) -> u64 {
        now_ns.saturating_sub(self.came_by_ns.load(Ordering::Relaxed))
    }

    /// Whether its thread has stayed away for longer than it may, though it should step, or look after who is there.
    #[must_use]
    pub fn hangs(&self, now_ns: u64) -> bool {
        self.away_ns(now_ns) > self.patience_ns.load(Ordering::Relaxed)
    }

    /// What it has done.
    #[must_use]
    pub fn done(&self) -> Done {
        let get = |count: &AtomicU64| count.load(Ordering::Relaxed);
        Done {
            steps: get(&self.steps),
            late_steps: get(&self.late_steps),
            busy_ns: get(&self.busy_ns),
            longest_step_ns: get(&self.longest_ns),
            faults: get(&self.faults),
            parted_links: get(&self.parted_links),
            residual_j: f64::from_bits(get(&self.residual_j)),
        }
    }
}

/// A session as whoever watches the server sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct Watched {
    /// What it is doing.
    pub phase: Phase,
    /// Its thread hangs.
    pub hangs: bool,
    /// How long its thread has stayed away, ns.
    pub away_ns: u64,
    /// What it has done.
    pub done: Done,
    /// Viewers, those who record not among them.
    pub viewers: usize,
    /// Control streams, and clients that send poses one call at a time.
    pub drivers: usize,
    /// Commands that wait for the next tick.
    pub waiting_commands: usize,
    /// Patches that are kept for viewers who are behind, and what they hold, bytes.
    pub kept_patches: usize,
    /// See `kept_patches`.
    pub kept_patch_bytes: usize,
    /// A viewer waits for a keyframe.
    pub awaits_keyframe: bool,
}
