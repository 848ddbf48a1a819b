//! Sessions in virtual time: tasks of one thread in the place of threads, and a clock that goes on only while all wait.
//!
//! For simulations by seed, on a runtime of one thread whose clock is paused: the same seed gives the same run.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use kerf_physics::{StageClock, Workers};
use tokio::sync::oneshot;
use tokio::time::Instant;

use crate::clock::MonotonicClock;
use crate::error::SessionError;
use crate::inbox::Inbox;
use crate::prepare::Permits;
use crate::projector::Projector;
use crate::session_core::{SessionCore, Wake};
use crate::session_thread::{Built, begun};

/// How often a session that stands looks for commands: a thread would be woken by them.
const LOOK: Duration = Duration::from_millis(1);
/// What the clock shows as virtual time begins, so that there is something before it.
const ORIGIN: Duration = Duration::from_secs(3600);

thread_local! {
    static VIRTUAL: RefCell<Option<Virtual>> = const { RefCell::new(None) };
}

struct Virtual {
    began: Instant,
    step_takes: Box<dyn FnMut() -> Duration>,
}

/// As long as it lives, sessions of this thread are tasks of its runtime, and the monotonic clock is the runtime's.
pub struct VirtualTime(());

impl VirtualTime {
    /// Begins; `step_takes` says how long each step takes. To be called within the runtime.
    pub fn begin(step_takes: impl FnMut() -> Duration + 'static) -> Self {
        let begun = Virtual { began: Instant::now(), step_takes: Box::new(step_takes) };
        VIRTUAL.with_borrow_mut(|time| *time = Some(begun));
        Self(())
    }
}

impl Drop for VirtualTime {
    fn drop(&mut self) {
        VIRTUAL.with_borrow_mut(|time| *time = None);
    }
}

/// Virtual nanoseconds; `None` where time is real.
pub(crate) fn now_ns() -> Option<u64> {
    let passed = VIRTUAL.with_borrow(|time| time.as_ref().map(|time| time.began.elapsed()))?;
    Some((ORIGIN + passed).as_nanos() as u64)
}

fn step_takes() -> Duration {
    VIRTUAL.with_borrow_mut(|time| time.as_mut().map_or(Duration::ZERO, |time| (time.step_takes)()))
}

/// What a step sees of the clock: it takes its time as it first looks.
struct StepClock {
    ns: AtomicU64,
    takes_ns: AtomicU64,
}

impl StepClock {
    fn new(takes: Duration) -> Self {
        Self { ns: MonotonicClock::now_ns().into(), takes_ns: (takes.as_nanos() as u64).into() }
    }
}

impl StageClock for StepClock {
    fn now_ns(&self) -> u64 {
        let takes_ns = self.takes_ns.swap(0, Ordering::Relaxed);
        self.ns.fetch_add(takes_ns, Ordering::Relaxed) + takes_ns
    }
}

/// Starts a task that builds a session's core, says so and runs it, where time is virtual; else hands back what is to be
/// built.
pub(crate) fn start<B>(inbox: &Arc<Inbox>, permits: Permits, build: B) -> Result<oneshot::Receiver<Built>, (Permits, B)>
where
    B: FnOnce() -> Result<(SessionCore, Projector), SessionError> + Send + 'static,
{
    if now_ns().is_none() {
        return Err((permits, build));
    }
    let (say, built) = oneshot::channel();
    let inbox = Arc::clone(inbox);
    tokio::spawn(async move {
        if let Some((core, projector, _slot)) = begun(permits, say, build) {
            run(core, projector, &inbox).await;
        }
    });
    Ok(built)
}

/// Runs a session until it is closed.
async fn run(mut core: SessionCore, mut projector: Projector, inbox: &Inbox) {
    // Who waited for it may ask for its state before its first step.
    tokio::time::sleep(LOOK).await;
    core.obey_commands();
    core.warm_up(&Workers::serial(), &MonotonicClock);
    let mut wake = Wake::At(MonotonicClock::now_ns());
    loop {
        let mut takes = Duration::ZERO;
        match wake {
            Wake::At(due_ns) => {
                tokio::time::sleep(until(due_ns)).await;
                takes = step_takes();
            }
            Wake::OnCommand { or_at_ns } if inbox.waiting_commands() == 0 => {
                tokio::time::sleep(until(or_at_ns).min(LOOK)).await;
            }
            Wake::OnCommand { .. } => {}
            Wake::Never => return,
        }
        core.obey_commands();
        let clock = StepClock::new(takes);
        let begins_ns = MonotonicClock::now_ns();
        // Nothing is told before the step has taken its time.
        tokio::time::sleep(takes).await;
        wake = core.tick(begins_ns, &Workers::serial(), &clock);
        projector.show_waiting(&clock);
    }
}

fn until(due_ns: u64) -> Duration {
    Duration::from_nanos(due_ns.saturating_sub(MonotonicClock::now_ns()))
}
