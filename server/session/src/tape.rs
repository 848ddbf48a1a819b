//! What a session tells whoever records it: every step with its inputs, every event, in order.
//!
//! The session's thread writes to a bounded queue and never waits. When the queue is full the recording ends there, as
//! one with a gap could not be simulated again. Pictures take no part in this: whoever records sees them as a viewer.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use kerf_physics::{StepInputs, ToolInput};

use crate::checkpoints::Checkpoint;
use crate::lock::lock;
use crate::outbox::{StepReport, ViewEvent, Viewer};

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
    /// Hash of the state after it.
    pub state_hash: u64,
}

/// One thing that happened to a session.
#[derive(Clone, Debug)]
pub enum TapeEntry {
    /// A step was taken.
    Step(Box<TapedStep>),
    /// Something happened between two steps, or in the last one.
    Event(ViewEvent),
    /// A checkpoint came as a file and is kept under this name.
    Checkpoint(Arc<str>, Checkpoint),
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

/// The session's end: nothing where nobody records.
#[derive(Debug, Default)]
pub(crate) struct Tape(Option<Arc<Mutex<Queue>>>);

impl Tape {
    /// Whether anybody records.
    pub fn is_on(&self) -> bool {
        self.0.as_ref().is_some_and(|queue| lock(queue).state == TapeState::Running && Arc::strong_count(queue) > 1)
    }

    /// Notes an entry; the first one that does not fit ends the recording.
    pub fn push(&self, entry: TapeEntry) {
        let Some(queue) = self.0.as_ref().filter(|_| self.is_on()) else { return };
        let mut queue = lock(queue);
        match queue.entries.len() < queue.capacity {
            true => queue.entries.push_back(entry),
            false => queue.state = TapeState::Overrun { capacity: queue.capacity },
        }
    }
}

impl Drop for Tape {
    fn drop(&mut self) {
        let Some(mut queue) = self.0.as_ref().map(|queue| lock(queue)) else { return };
        if queue.state == TapeState::Running {
            queue.state = TapeState::Ended;
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

/// Both ends of a tape on which so many entries may wait.
pub(crate) fn tape(capacity: usize) -> (Tape, TapeReader) {
    let queue = Queue { entries: VecDeque::new(), capacity, state: TapeState::Running };
    let queue = Arc::new(Mutex::new(queue));
    (Tape(Some(Arc::clone(&queue))), TapeReader(queue))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outbox::SceneEvent;

    fn entry(step: u64) -> TapeEntry {
        TapeEntry::Event(ViewEvent { step, event: SceneEvent::Paused })
    }

    #[test]
    fn an_overrun_ends_the_recording_with_the_last_entry_that_fitted() {
        let (tape, reader) = tape(3);
        (0..5).for_each(|step| tape.push(entry(step)));
        assert!(!tape.is_on());
        let taken = |reader: &TapeReader| {
            let (entries, state) = reader.take();
            (entries.len(), state)
        };
        assert_eq!(taken(&reader), (3, TapeState::Overrun { capacity: 3 }));
        // Room that is made later changes nothing: there would be a gap.
        tape.push(entry(5));
        drop(tape);
        assert_eq!(taken(&reader), (0, TapeState::Overrun { capacity: 3 }), "the end of the session is no reason");
    }

    #[test]
    fn a_session_that_ends_says_so_and_one_that_nobody_records_keeps_nothing() {
        let (recorded, reader) = tape(3);
        recorded.push(entry(0));
        drop(recorded);
        let (entries, state) = reader.take();
        assert_eq!((entries.len(), state), (1, TapeState::Ended));
        let (left, reader) = tape(3);
        drop(reader);
        assert!(!left.is_on() && !Tape::default().is_on());
    }
}
