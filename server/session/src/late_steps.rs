//! Late steps one by one, for whoever traces them: the first few since somebody last asked. The session's thread puts
//! them into a ring, which neither allocates nor waits; where the ring is full, or nobody asks, they are left out.

use std::sync::Mutex;

use rtrb::{Consumer, Producer, RingBuffer};

use crate::lock::lock;

/// Late steps that wait to be asked for. A session that is late is so hundreds of times a second, and a few tell why; how
/// many there were the vitals count.
pub const MAX_LATE_STEPS: usize = 8;

/// A step that ended after its deadline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LateStep {
    /// Steps taken, it among them.
    pub step: u64,
    /// When it ended, ns on the server's monotonic clock.
    pub ended_ns: u64,
    /// How long it took, ns.
    pub elapsed_ns: u64,
    /// How long after its deadline it ended, ns.
    pub lag_ns: u64,
}

/// Those that wait.
#[derive(Debug)]
pub(crate) struct LateSteps(Mutex<Consumer<LateStep>>);

impl LateSteps {
    /// None yet, and where the session's thread puts them.
    pub(crate) fn new() -> (Self, Producer<LateStep>) {
        let (producer, consumer) = RingBuffer::new(MAX_LATE_STEPS);
        (Self(Mutex::new(consumer)), producer)
    }

    /// Those that wait, which then do so no longer.
    pub(crate) fn take(&self) -> Vec<LateStep> {
        let mut waiting = lock(&self.0);
        std::iter::from_fn(|| waiting.pop().ok()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_that_come_are_kept_and_make_room_when_they_are_taken() {
        let (late, mut put) = LateSteps::new();
        let step = |step| LateStep { step, ended_ns: 0, elapsed_ns: 0, lag_ns: 1 };
        let kept = (1..=100).filter(|number| put.push(step(*number)).is_ok()).count();
        assert_eq!(kept, MAX_LATE_STEPS);
        assert_eq!(late.take().iter().map(|late| late.step).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert!(late.take().is_empty() && put.push(step(101)).is_ok());
        assert_eq!(late.take(), [step(101)]);
    }
}
