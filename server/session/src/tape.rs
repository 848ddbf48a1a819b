//! What a session tells whoever records it: every step with its inputs, every event, in order.
//!
//! The session's thread writes to a bounded queue for each reader and never waits. When a queue is full its reader's record
//! ends there, as one with a gap could not be simulated again. Pictures take no part in this: whoever records sees them as
//! a viewer.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use kerf_physics::{StepInputs, ToolInput};

use crate::checkpoints::Checkpoint;
use crate::lock::lock;
use crate::outbox::Viewer;
use crate::step_report::StepReport;
use crate::view_message::ViewEvent;

/// Entries that wait at most: 16 s at 1 kHz, some 30 MB.
pub(crate) const CAPACITY: usize = 16_384;

/// The inputs of a step, kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoggedInputs {
    /// See [`StepInputs::tools`].
    pub tools: Vec<ToolInput>,
    /// See [`StepInputs::work_units`].
    pub work_units: Option<u64>,
}

impl LoggedInputs {
    /// As a step takes them.
    #[must_use]
    pub fn as_inputs(&self) -> StepInputs<'_> {
        StepInputs { tools: &self.tools, work_units: self.work_units, ..StepInputs::default() }
    }
}

impl From<Vec<ToolInput>> for LoggedInputs {
    fn from(tools: Vec<ToolInput>) -> Self {
        Self { tools, work_units: None }
    }
}

/// A step, with all that went into it.
#[derive(Clone, Debug, Default)]
pub struct TapedStep {
    /// What went into it.
    pub inputs: LoggedInputs,
    /// What it led to.
    pub report: StepReport,
    /// Hash of the state after it. A journal has it of some steps only: it takes time of each.
    pub state_hash: Option<u64>,
}

/// One thing that happened to a session.
#[derive(Clone, Debug)]
pub enum TapeEntry {
    /// A step was taken.
    Step(Arc<TapedStep>),
    /// Something happened between two steps, or in the last one.
    Event(ViewEvent),
    /// A checkpoint came as a file and is kept under this name.
    Checkpoint(Arc<str>, Checkpoint),
    /// All that a session goes on from: what came before is no longer needed for that.
    Base(Arc<Base>),
}

/// A state to go on from, and those to go back to.
#[derive(Clone, Debug)]
pub struct Base {
    /// The state.
    pub state: Checkpoint,
    /// Whether the session stood.
    pub is_paused: bool,
    /// Its checkpoints, by name.
    pub checkpoints: Vec<(Arc<str>, Checkpoint)>,
}

/// What a reader of a tape wants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wants {
    /// The hash of every step's state.
    Hashes,
    /// States to go on from.
    Bases,
}

/// Why no more will come, or that more may.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TapeState {
    /// More may come.
    Running,
    /// The session has ended.
    Ended,
    /// So many entries waited that the next one did not fit.
    Overrun {
        /// As many as may wait.
        capacity: usize,
    },
}

#[derive(Debug)]
struct Queue {
    entries: VecDeque<TapeEntry>,
    capacity: usize,
    state: TapeState,
}

/// The session's end, with a queue for each reader: none where nobody records.
#[derive(Debug, Default)]
pub(crate) struct Tape(Vec<(Wants, Arc<Mutex<Queue>>)>);

impl Tape {
    /// Another reader, for which so many entries may wait.
    pub fn reader(&mut self, wants: Wants, capacity: usize) -> TapeReader {
        let queue = Arc::new(Mutex::new(Queue { entries: VecDeque::new(), capacity, state: TapeState::Running }));
        self.0.push((wants, Arc::clone(&queue)));
        TapeReader(queue)
    }

    /// Those who still read.
    fn read(&self) -> impl Iterator<Item = &(Wants, Arc<Mutex<Queue>>)> {
        self.0.iter().filter(|(_, queue)| lock(queue).state == TapeState::Running && Arc::strong_count(queue) > 1)
    }

    /// Whether anybody records.
    pub fn is_on(&self) -> bool {
        self.read().next().is_some()
    }

    /// Whether any reader wants this.
    pub fn is_for(&self, wants: Wants) -> bool {
        self.read().any(|(wanted, _)| *wanted == wants)
    }

    /// Notes an entry; the first one that does not fit ends the record that it was for.
    pub fn push(&self, entry: &TapeEntry) {
        for (_, queue) in self.read() {
            let mut queue = lock(queue);
            match queue.entries.len() < queue.capacity {
                true => queue.entries.push_back(entry.clone()),
                false => queue.state = TapeState::Overrun { capacity: queue.capacity },
            }
        }
    }
}

impl Drop for Tape {
    fn drop(&mut self) {
        for (_, queue) in &self.0 {
            let mut queue = lock(queue);
            if queue.state == TapeState::Running {
                queue.state = TapeState::Ended;
            }
        }
    }
}

/// The end of whoever records.
#[derive(Debug)]
pub struct TapeReader(Arc<Mutex<Queue>>);

impl TapeReader {
    /// Takes what has come since the last call.
    pub fn take(&self) -> (VecDeque<TapeEntry>, TapeState) {
        let mut queue = lock(&self.0);
        (std::mem::take(&mut queue.entries), queue.state)
    }
}

/// All that there is to record of a session.
pub struct Reel {
    /// What it does.
    pub tape: TapeReader,
    /// What viewers see of it: the newest state each time it is asked, and none in between.
    pub pictures: Viewer,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view_message::SceneEvent;

    fn tape(capacity: usize) -> (Tape, TapeReader) {
        let mut tape = Tape::default();
        let reader = tape.reader(Wants::Hashes, capacity);
        (tape, reader)
    }

    fn entry(step: u64) -> TapeEntry {
        TapeEntry::Event(ViewEvent { step, event: SceneEvent::Paused })
    }

    #[test]
    fn an_overrun_ends_the_recording_with_the_last_entry_that_fitted() {
        let (tape, reader) = tape(3);
        (0..5).for_each(|step| tape.push(&entry(step)));
        assert!(!tape.is_on());
        let taken = |reader: &TapeReader| {
            let (entries, state) = reader.take();
            (entries.len(), state)
        };
        assert_eq!(taken(&reader), (3, TapeState::Overrun { capacity: 3 }));
        // Room that is made later changes nothing: there would be a gap.
        tape.push(&entry(5));
        drop(tape);
        assert_eq!(taken(&reader), (0, TapeState::Overrun { capacity: 3 }), "the end of the session is no reason");
    }

    #[test]
    fn a_session_that_ends_says_so_and_one_that_nobody_records_keeps_nothing() {
        let (recorded, reader) = tape(3);
        recorded.push(&entry(0));
        drop(recorded);
        let (entries, state) = reader.take();
        assert_eq!((entries.len(), state), (1, TapeState::Ended));
        let (left, reader) = tape(3);
        drop(reader);
        assert!(!left.is_on() && !Tape::default().is_on());
    }

    #[test]
    fn each_reader_has_a_queue_of_its_own() {
        let (mut tape, recorder) = tape(2);
        let journal = tape.reader(Wants::Bases, 4);
        (0..3).for_each(|step| tape.push(&entry(step)));
        assert!(tape.is_for(Wants::Bases) && !tape.is_for(Wants::Hashes), "the recorder has fallen behind");
        assert_eq!(recorder.take().1, TapeState::Overrun { capacity: 2 });
        let (entries, state) = journal.take();
        assert_eq!((entries.len(), state), (3, TapeState::Running));
    }
}
