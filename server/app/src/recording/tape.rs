//! What recordings and journals have in common: the entries of a tape as messages, and how its end ends them.

use std::io::{Seek, Write};

use kerf_proto::v1;
use kerf_proto::v1::view_response::Message;
use kerf_session::{TapeEntry, TapeState};
use mcap::{McapError, McapResult};

use super::convert;
use super::tracks::{Track, Tracks};
use crate::convert::view;

/// Writes an entry. A state to go on from is followed by the checkpoints that there are by then.
pub fn write<W: Write + Seek>(tracks: &mut Tracks<W>, time_ns: u64, entry: &TapeEntry) -> McapResult<()> {
    match entry {
        TapeEntry::Step(taped) => tracks.write(Track::Step, time_ns, &convert::step(taped)),
        TapeEntry::Checkpoint(name, kept) => tracks.write(Track::Checkpoint, time_ns, &convert::checkpoint(name, kept)),
        TapeEntry::Event(happened) => match view::event(happened) {
            Message::Event(event) => tracks.write(Track::Events, time_ns, &event),
            Message::Fault(fault) => tracks.write(Track::Faults, time_ns, &fault),
            _ => Ok(()),
        },
        TapeEntry::Base(base) => {
            let recorded = v1::RecordedBase { data: base.state.save(), is_paused: base.is_paused };
            tracks.write(Track::Base, time_ns, &recorded)?;
            let mut kept = base.checkpoints.iter();
            kept.try_for_each(|(name, kept)| tracks.write(Track::Checkpoint, time_ns, &convert::checkpoint(name, kept)))
        }
    }
}

/// How what is made of a tape ends, once it does: with its session, or why before it.
pub fn ended(state: TapeState) -> Option<Result<(), String>> {
    match state {
        TapeState::Running => None,
        TapeState::Ended => Some(Ok(())),
        TapeState::Overrun { capacity } => {
            Some(Err(format!("the disk is slower than the session: {capacity} steps and events waited to be written")))
        }
    }
}

/// What went wrong, without the numbers of the operating system.
pub fn plain(error: &McapError) -> String {
    let said = match error {
        McapError::Io(error) => error.to_string(),
        other => other.to_string(),
    };
    said.split(" (os error").next().unwrap_or_default().to_lowercase()
}
