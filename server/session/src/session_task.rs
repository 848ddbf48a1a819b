//! A session in virtual time: a task in the place of a thread.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use kerf_physics::{StageClock, Workers};

use crate::clock::MonotonicClock;
use crate::inbox::Inbox;
use crate::projector::Projector;
use crate::session_core::{SessionCore, Wake};
use crate::virtual_time::step_takes;

/// How often a session that stands looks for commands: a thread would be woken by them.
const LOOK: Duration = Duration::from_millis(1);

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

/// Runs a session until it is closed.
pub(crate) async fn run(mut core: SessionCore, mut projector: Projector, inbox: &Inbox) {
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
