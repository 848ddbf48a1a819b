//! The frames of a recording in a file.

use std::collections::VecDeque;

use anyhow::Result;
use kerf_proto::v1;
use kerf_session::{Footage, Frame, SceneEvent, Structure, ViewEvent};

use super::convert;
use super::reader::{Entry, Recording};
use super::tracks::Track;

/// Where the frames of a file are read.
pub struct FileFootage {
    recording: Recording,
    /// Chunk that is read next.
    next_chunk: usize,
    /// What was read and not yet shown.
    ahead: VecDeque<Entry>,
    /// What was read of the frame that comes next.
    frame: Frame,
    /// A frame that was read too early: it comes next.
    held: Option<Frame>,
    energy: v1::EnergyLedger,
}

impl FileFootage {
    /// From the beginning.
    #[must_use]
    pub fn new(recording: Recording) -> Self {
        Self {
            recording,
            next_chunk: 0,
            ahead: VecDeque::new(),
            frame: Frame::default(),
            held: None,
            energy: v1::EnergyLedger::default(),
        }
    }

    fn next_entry(&mut self) -> Result<Option<Entry>> {
        while self.ahead.is_empty() && self.next_chunk < self.recording.chunks() {
            self.ahead = self.recording.chunk(self.next_chunk)?.into();
            self.next_chunk += 1;
        }
        Ok(self.ahead.pop_front())
    }

    fn next_frame(&mut self) -> Result<Option<Frame>> {
        if let Some(held) = self.held.take() {
            return Ok(Some(held));
        }
        while let Some(entry) = self.next_entry()? {
            match entry.track {
                Track::Keyframe => {
                    self.frame.structure.push(Structure::Keyframe(convert::keyframe(&entry.read()?)?));
                }
                Track::Patch => self.frame.structure.push(Structure::Patch(convert::patch(&entry.read()?)?)),
                Track::Energy => self.energy = entry.read()?,
                Track::Events => self.frame.events.extend(convert::event(&entry.read()?)),
                Track::Faults => self.frame.events.push(fault(entry.read()?)),
                Track::State => {
                    let mut frame = std::mem::take(&mut self.frame);
                    frame.time_ns = entry.time_ns.saturating_sub(self.recording.span_ns().0);
                    frame.state = convert::view_state(&entry.read()?, &self.energy)?;
                    return Ok(Some(frame));
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// The newest chunk that has a keyframe and no later message than `before` chunks have.
    fn chunk_with_keyframe(&mut self, before: usize) -> Result<usize> {
        for index in (0..before).rev() {
            if self.recording.chunk(index)?.iter().any(|entry| entry.track == Track::Keyframe) {
                return Ok(index);
            }
        }
        Ok(0)
    }

    fn go_to(&mut self, chunk: usize) {
        self.next_chunk = chunk;
        self.ahead.clear();
        (self.frame, self.held) = (Frame::default(), None);
    }

    fn find(&mut self, time_ns: u64) -> Result<Option<Frame>> {
        let until = self.recording.chunks_until(self.recording.span_ns().0.saturating_add(time_ns));
        let mut first = self.chunk_with_keyframe(until)?;
        loop {
            self.go_to(first);
            match self.play_to(time_ns)? {
                Some(frame) => return Ok(Some(frame)),
                // The keyframe of that chunk is later than the time: one before it is needed, or else the first.
                None if first > 0 => first = self.chunk_with_keyframe(first)?,
                None => {
                    let first_ns = self.first_time_ns()?;
                    return self.play_to(first_ns);
                }
            }
        }
    }

    /// The time of the first frame.
    fn first_time_ns(&mut self) -> Result<u64> {
        self.go_to(0);
        let time_ns = self.next_frame()?.map_or(0, |frame| frame.time_ns);
        self.go_to(0);
        Ok(time_ns)
    }

    /// The last frame until a time, with the whole structure; `None` where no keyframe comes until then.
    fn play_to(&mut self, time_ns: u64) -> Result<Option<Frame>> {
        let (mut structure, mut last) = (None, None);
        loop {
            let Some(frame) = self.next_frame()? else { break };
            if frame.time_ns > time_ns {
                self.held = Some(frame);
                break;
            }
            for change in frame.structure {
                match (change, &mut structure) {
                    (Structure::Keyframe(keyframe), structure) => *structure = Some(keyframe),
                    (Structure::Patch(patch), Some(structure)) => structure.follow(&patch)?,
                    (Structure::Patch(_), None) => {}
                }
            }
            last = Some((frame.time_ns, frame.state));
        }
        Ok(last.zip(structure).map(|((time_ns, state), keyframe)| Frame {
            time_ns,
            events: Vec::new(),
            structure: vec![Structure::Keyframe(keyframe)],
            state,
        }))
    }
}

impl Footage for FileFootage {
    fn length_ns(&self) -> u64 {
        let (start_ns, end_ns) = self.recording.span_ns();
        end_ns - start_ns
    }

    fn next(&mut self) -> Result<Option<Frame>, String> {
        self.next_frame().map_err(|error| format!("{error:#}"))
    }

    fn seek(&mut self, time_ns: u64) -> Result<Option<Frame>, String> {
        self.find(time_ns).map_err(|error| format!("{error:#}"))
    }
}

fn fault(recorded: v1::Fault) -> ViewEvent {
    use kerf_physics::fault::{Fault, FaultKind};
    let what = match recorded.kind() {
        v1::FaultKind::ToolWrench => FaultKind::ToolWrench,
        v1::FaultKind::Energy => FaultKind::Energy,
        _ => FaultKind::NodeState,
    };
    let step = recorded.step;
    ViewEvent { step, event: SceneEvent::Fault(Fault { step, object: recorded.object, what }) }
}
