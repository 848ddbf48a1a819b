//! Virtual time: the clock goes on only while all tasks of a thread wait.
//!
//! For simulations by seed, on a runtime of one thread whose clock is paused: sessions are tasks of it, and the same seed
//! gives the same run.

use std::cell::RefCell;
use std::time::Duration;

use tokio::time::Instant;

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

/// How long the next step takes.
pub(crate) fn step_takes() -> Duration {
    VIRTUAL.with_borrow_mut(|time| time.as_mut().map_or(Duration::ZERO, |time| (time.step_takes)()))
}
