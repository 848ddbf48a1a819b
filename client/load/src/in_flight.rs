//! The poses that wait for an answer.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use hdrhistogram::Histogram;

use crate::durations::durations_ns;

/// Most poses that are remembered until a contact reflects them: seconds at the fastest rate. The oldest is given up
/// for the next.
const MAX_IN_FLIGHT: usize = 10_000;

/// A pose whose motion was due.
#[derive(Clone, Copy, Debug)]
struct Due {
    tool_id: u32,
    seq: u64,
    due_ns: u64,
}

/// The poses that no contact has reflected yet, oldest first, whether they were sent or left out because the sender or
/// the transport was late; shared by the thread that sends and the one that receives.
#[derive(Debug)]
pub struct InFlight(Mutex<Waiting>);

#[derive(Debug)]
struct Waiting {
    poses: VecDeque<Due>,
    /// How long those had waited that were given up, ns: their answer would have taken longer (censored).
    unanswered_ns: Histogram<u64>,
}

impl Default for InFlight {
    fn default() -> Self {
        Self(Mutex::new(Waiting { poses: VecDeque::new(), unanswered_ns: durations_ns() }))
    }
}

impl InFlight {
    /// The motion of a pose was due at `due_ns`.
    pub fn push(&self, tool_id: u32, seq: u64, due_ns: u64) {
        let mut waiting = self.lock();
        if waiting.poses.len() == MAX_IN_FLIGHT
            && let Some(oldest) = waiting.poses.pop_front()
        {
            waiting.unanswered_ns.saturating_record(due_ns.saturating_sub(oldest.due_ns));
        }
        waiting.poses.push_back(Due { tool_id, seq, due_ns });
    }

    /// A pose that the server has refused: that is its answer.
    pub fn forget(&self, tool_id: u32, seq: u64) {
        self.lock().poses.retain(|pose| (pose.tool_id, pose.seq) != (tool_id, seq));
    }

    /// A tool is lifted at `now_ns`: no step will use the poses that wait.
    pub fn give_up(&self, tool_id: u32, now_ns: u64) {
        let mut waiting = self.lock();
        let Waiting { poses, unanswered_ns } = &mut *waiting;
        take(
            poses,
            |pose| pose.tool_id == tool_id,
            |pose| {
                unanswered_ns.saturating_record(now_ns.saturating_sub(pose.due_ns));
            },
        );
    }

    /// Takes the poses of a tool up to the newest that a step has used, and calls `reflected` with the
    /// number of each and when it was due, ns. Those before the newest one were used by earlier steps,
    /// or overtaken on their way to one: this is the first contact to tell of them either way.
    pub fn take_reflected(&self, tool_id: u32, newest_seq: u64, mut reflected: impl FnMut(u64, u64)) {
        let is_reflected = |pose: &Due| pose.tool_id == tool_id && pose.seq <= newest_seq;
        take(&mut self.lock().poses, is_reflected, |pose| reflected(pose.seq, pose.due_ns));
    }

    /// How long those poses had waited that were given up, ns: least values of their round trips.
    #[must_use]
    pub fn unanswered_ns(&self) -> Histogram<u64> {
        self.lock().unanswered_ns.clone()
    }

    /// Adds how long poses had waited in other hands that nothing answered.
    pub fn add_unanswered(&self, waited_ns: &Histogram<u64>) {
        self.lock().unanswered_ns += waited_ns;
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Takes those poses out that are `wanted`.
fn take(poses: &mut VecDeque<Due>, wanted: impl Fn(&Due) -> bool, mut taken: impl FnMut(&Due)) {
    poses.retain(|pose| {
        let is_wanted = wanted(pose);
        if is_wanted {
            taken(pose);
        }
        !is_wanted
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contact_reflects_the_poses_up_to_its_own_once_and_those_of_no_other_tool() {
        let in_flight = InFlight::default();
        let taken = |tool_id, newest_seq| {
            let mut taken = Vec::new();
            in_flight.take_reflected(tool_id, newest_seq, |seq, due_ns| taken.push((seq, due_ns)));
            taken
        };
        for (tool_id, seq) in [(0, 1), (1, 1), (0, 2), (0, 3), (0, 4)] {
            in_flight.push(tool_id, seq, 100 * seq);
        }
        in_flight.forget(0, 2);
        assert_eq!(taken(0, 3), [(1, 100), (3, 300)]);
        assert_eq!(taken(0, 3), []);
        assert_eq!((taken(1, 9), taken(0, 4)), (vec![(1, 100)], vec![(4, 400)]));
    }

    #[test]
    fn poses_that_nothing_reflects_are_given_up_and_counted_with_how_long_they_have_waited() {
        let in_flight = InFlight::default();
        (1..=MAX_IN_FLIGHT as u64 + 5).for_each(|seq| in_flight.push(0, seq, 1000 * seq));
        let mut first = None;
        in_flight.take_reflected(0, 100, |seq, _| first = first.or(Some(seq)));
        assert_eq!((first, in_flight.unanswered_ns().len()), (Some(6), 5), "the oldest made room");
        assert!(in_flight.unanswered_ns().min() >= 9_990_000, "{}", in_flight.unanswered_ns().min());
        in_flight.push(1, 1, 0);
        in_flight.give_up(0, 20_000_000);
        assert_eq!(in_flight.unanswered_ns().len(), 5 + MAX_IN_FLIGHT as u64 - 95, "all of one tool");
        assert!(in_flight.unanswered_ns().max().abs_diff(20_000_000 - 101_000) < 20_000);
    }
}
