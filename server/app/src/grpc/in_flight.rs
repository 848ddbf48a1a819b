//! How much may be on its way to a client at a time.
//!
//! A stream's flow control lets megabytes of old messages wait in front of a slow reader. So clients acknowledge what
//! they have read, and the number of messages on their way follows from how long that takes: it grows while they take
//! little longer than the first ones did, and falls to one where they wait behind each other. The least time ever seen
//! stands for the path itself; a path that becomes longer for good costs rate, never age. A reader that is slow cannot
//! be told from a path that is long without trying, so each try that fails makes the wait for the next one four times as long.
//!
//! It is told the time and never asks for it.

use std::collections::VecDeque;

/// Messages that may be on their way before any was acknowledged: a keyframe and its state.
const FIRST_WINDOW: usize = 2;
/// Most acknowledgements to wait for before the window grows again: a second of contacts.
const LONGEST_PATIENCE: u32 = 256;
/// Most messages on their way, whatever the path: a second at the fastest rate.
const LARGEST_WINDOW: usize = 1000;

/// The messages of one stream that are on their way.
#[derive(Debug)]
pub struct InFlight {
    max_age_ns: u64,
    window: usize,
    /// `(number, when it was sent, ns)`, numbers ascending.
    sent: VecDeque<(u64, u64)>,
    last_number: u64,
    /// Shortest time from sending to acknowledgement.
    least_ns: u64,
    /// The newest message when the window was last full and something was to be sent.
    full_at: u64,
    /// Acknowledgements in good time since the window last changed, and how many it takes for it to grow.
    in_time: u32,
    patience: u32,
    last_change: Change,
    /// The newest message when the window was last made smaller: older ones tell of the larger one.
    shrunk_at: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Change {
    Grown,
    Shrunk,
}

impl InFlight {
    /// For messages that should not be much older than this when they are read.
    pub fn new(max_age_ns: u64) -> Self {
        Self {
            max_age_ns,
            window: FIRST_WINDOW,
            sent: VecDeque::new(),
            last_number: 0,
            least_ns: u64::MAX,
            full_at: 0,
            in_time: 0,
            patience: 1,
            last_change: Change::Shrunk,
            shrunk_at: 0,
        }
    }

    /// Whether another message may be sent now.
    pub fn has_room(&mut self) -> bool {
        let has_room = self.sent.len() < self.window;
        if !has_room {
            self.full_at = self.last_number;
        }
        has_room
    }

    /// A message is sent; answers with its number.
    pub fn send(&mut self, now_ns: u64) -> u64 {
        self.last_number += 1;
        self.sent.push_back((self.last_number, now_ns));
        self.last_number
    }

    /// The client has read the message of this number and all before it. Numbers that are none of those on their way
    /// change nothing.
    pub fn acknowledge(&mut self, number: u64, now_ns: u64) {
        let Ok(index) = self.sent.binary_search_by_key(&number, |(sent, _)| *sent) else { return };
        let took_ns = now_ns.saturating_sub(self.sent[index].1);
        self.sent.drain(..=index);
        if self.least_ns == u64::MAX {
            // There is nothing yet to compare it with.
            self.least_ns = took_ns;
            return;
        }
        self.least_ns = self.least_ns.min(took_ns);
        let waited_ns = took_ns - self.least_ns;
        if waited_ns > self.max_age_ns / 2 {
            if number > self.shrunk_at {
                self.shrink();
            }
        } else if waited_ns < self.max_age_ns / 4 {
            self.in_time += 1;
            if number <= self.full_at && self.in_time >= self.patience {
                self.grow();
            }
        }
    }

    fn grow(&mut self) {
        if self.last_change == Change::Grown {
            // The last one was right.
            self.patience = (self.patience / 2).max(1);
        }
        self.window = (self.window + 1).min(LARGEST_WINDOW);
        (self.in_time, self.last_change) = (0, Change::Grown);
    }

    fn shrink(&mut self) {
        self.patience = (self.patience * 4).min(LONGEST_PATIENCE);
        self.window = (self.window / 2).max(1);
        self.shrunk_at = self.last_number;
        (self.in_time, self.last_change) = (0, Change::Shrunk);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Plays `duration_ms` of a source of a message per `every_ms`, latest wins, to a reader that takes each message
    /// `path_ms` after it was sent at the earliest and needs `read_ms` for it. Returns `(ms read, age in ms)`.
    fn read(every_ms: u64, path_ms: u64, read_ms: u64, duration_ms: u64) -> Vec<(u64, u64)> {
        let mut in_flight = InFlight::new(100 * MS);
        let (mut made, mut path, mut acks) = (None, VecDeque::new(), VecDeque::new());
        let (mut free_ms, mut ages) = (0, Vec::new());
        for now_ms in 0..duration_ms {
            while acks.front().is_some_and(|(at_ms, _)| *at_ms <= now_ms) {
                let (_, number) = acks.pop_front().unwrap();
                in_flight.acknowledge(number, now_ms * MS);
            }
            if now_ms % every_ms == 0 {
                made = Some(now_ms);
            }
            if made.is_some() && in_flight.has_room() {
                path.push_back((now_ms + path_ms / 2, in_flight.send(now_ms * MS), made.take().unwrap()));
            }
            if now_ms >= free_ms
                && let Some((_, number, made_ms)) = path.pop_front_if(|(there_ms, ..)| *there_ms <= now_ms)
            {
                ages.push((now_ms, now_ms - made_ms));
                free_ms = now_ms + read_ms;
                // Ready for another when this one is done with.
                acks.push_back((free_ms + path_ms / 2, number));
            }
        }
        ages
    }

    #[test]
    fn a_brisk_reader_gets_every_message_on_a_path_of_any_length() {
        for path_ms in [0, 20, 200] {
            let late: Vec<_> = read(4, path_ms, 0, 10_000).into_iter().filter(|(at_ms, _)| *at_ms > 5000).collect();
            assert!(late.len() > 1240, "{} of 1250 over {path_ms} ms", late.len());
            assert!(late.iter().all(|(_, age_ms)| *age_ms <= path_ms / 2 + 4), "{path_ms} ms");
        }
    }

    #[test]
    fn a_slow_reader_never_reads_what_is_much_older_than_it_takes_itself() {
        for (read_ms, most_ms) in [(10, 130), (40, 130), (400, 500)] {
            let ages = read(4, 2, read_ms, 60_000);
            assert!(ages.len() > 60_000 / read_ms as usize * 9 / 10, "it is kept busy");
            let oldest_ms = ages.iter().skip(2).map(|(_, age_ms)| *age_ms).max().unwrap();
            assert!(oldest_ms <= most_ms, "{oldest_ms} ms at {read_ms} ms a message");
            let old = ages.iter().filter(|(_, age_ms)| *age_ms > 130).count();
            assert!(old < 10, "{old} of {} messages at {read_ms} ms a message", ages.len());
        }
    }

    #[test]
    fn one_who_acknowledges_nothing_gets_what_begins_a_stream() {
        let mut in_flight = InFlight::new(100 * MS);
        for _ in 0..FIRST_WINDOW {
            assert!(in_flight.has_room());
            in_flight.send(0);
        }
        in_flight.acknowledge(0, MS);
        in_flight.acknowledge(77, MS);
        assert!(!in_flight.has_room());
    }
}
