//! The thread that writes a recording.

use std::collections::VecDeque;
use std::io::{Seek, Write};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::Result;
use kerf_physics::surface::delta::Keyframe;
use kerf_proto::{foxglove, v1};
use kerf_session::clock::MonotonicClock;
use kerf_session::{DriverId, Reel, TapeEntry, TapeState, TapedStep, ViewMessage, ViewState};
use mcap::McapResult;

use super::tape::plain;
use super::tracks::{Track, Tracks};
use super::{Pictures, Told, convert, surface, tape};
use crate::convert::contact::contact;
use crate::convert::scene::energy_ledger;
use crate::convert::view;

/// How often the tape is looked at.
const LOOK: Duration = Duration::from_millis(8);
/// A chunk is written out at least this often, ns: what a kill loses.
const FLUSH_NS: u64 = 500_000_000;
/// Shortest time between two surfaces, ns: they are large, and for a glance.
const SURFACE_NS: u64 = 100_000_000;
/// Drivers are numbered from 1 on: contacts of nobody's echo nothing.
const NOBODY: DriverId = DriverId(0);
/// Every step's contact is recorded: nothing is blended between two.
const OF_NO_STREAM: (u64, f64) = (0, f64::INFINITY);

/// A recording that goes on.
pub struct Writer<W: Write + Seek> {
    tracks: Tracks<W>,
    reel: Reel,
    told: Arc<Told>,
    room: Box<dyn Fn() -> Result<(), String> + Send>,
    clock: LogClock,
    /// When the tape was looked at before, ns on the monotonic clock.
    looked_ns: u64,
    flushed_ns: u64,
    steps: u64,
    /// Per tool: whether it was in the scene after the last step.
    placed: Vec<bool>,
    /// Structure that waits for its state.
    changes: Vec<ViewMessage>,
    surface: Option<Surface>,
}

/// What the surface is drawn of.
struct Surface {
    objects: Vec<String>,
    structure: Option<Keyframe>,
    drawn_ns: u64,
}

/// Wall time that the monotonic clock moves on.
#[derive(Clone, Copy)]
pub(crate) struct LogClock {
    unix_ns: u64,
    monotonic_ns: u64,
}

impl LogClock {
    /// As both clocks are now.
    ///
    /// # Errors
    /// It is before 1970.
    pub fn now() -> Result<Self> {
        let unix_ns = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.as_nanos() as u64;
        Ok(Self { unix_ns, monotonic_ns: MonotonicClock::now_ns() })
    }

    /// Wall time, ns since 1970, of a time of the monotonic clock.
    pub fn unix_ns(self, monotonic_ns: u64) -> u64 {
        (self.unix_ns + monotonic_ns).saturating_sub(self.monotonic_ns)
    }
}

impl<W: Write + Seek + Send> Writer<W> {
    /// Writes the header out. `room` says before each chunk whether it may be written, or why not.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn begin(
        sink: W,
        header: &v1::RecordingHeader,
        mut reel: Reel,
        pictures: Pictures,
        told: Arc<Told>,
        room: impl Fn() -> Result<(), String> + Send + 'static,
    ) -> Result<Self> {
        let clock = LogClock::now()?;
        let scene = header.scene.clone().unwrap_or_default();
        let tools = scene.tools.len();
        let mut tracks = vec![
            Track::Header,
            Track::Base,
            Track::Step,
            Track::Events,
            Track::Checkpoint,
            Track::Faults,
            Track::Energy,
        ];
        tracks.extend([Track::Keyframe, Track::Patch, Track::State]);
        tracks.extend((0..tools).flat_map(|tool| [Track::Contact(tool), Track::Pose(tool)]));
        tracks.extend(pictures.with_surface.then_some(Track::Surface));
        let begun = Tracks::begin(sink, tracks, |tracks| tracks.write(Track::Header, clock.unix_ns, header));
        let tracks = begun.map_err(|error| anyhow::Error::msg(plain(&error)))?;
        reel.pictures.set_interval_ns((1e9 / pictures.rate_hz) as u64);
        let objects = scene.objects.into_iter().map(|object| object.name).collect();
        let surface = pictures.with_surface.then_some(Surface { objects, structure: None, drawn_ns: 0 });
        Ok(Self {
            tracks,
            reel,
            told,
            room: Box::new(room),
            clock,
            looked_ns: clock.monotonic_ns,
            flushed_ns: clock.monotonic_ns,
            steps: 0,
            placed: vec![false; tools],
            changes: Vec::new(),
            surface,
        })
    }

    /// Records until the session ends or the recording does.
    pub fn run(mut self) {
        let (ended, is_file_sound) = loop {
            match self.look() {
                Ok(None) => std::thread::sleep(LOOK),
                Ok(Some(ended)) => break (ended, true),
                Err(error) => break (Err(plain(&error)), false),
            }
        };
        let Self { tracks, told, steps, .. } = self;
        let finished = match is_file_sound {
            true => tracks.finish().map_err(|error| plain(&error)),
            // What is in it up to the last chunk stays.
            false => {
                tracks.abandon();
                Ok(())
            }
        };
        let cut_off = ended.is_err();
        let error = ended.and(finished).err().unwrap_or_default();
        told.note(|recording| {
            (recording.is_cut_off, recording.error) = (cut_off, error);
            if is_file_sound {
                recording.steps = steps;
            }
        });
        let v1::Recording { file, steps, error, .. } = told.so_far();
        match error.is_empty() {
            true => tracing::info!(file, steps, "session recorded"),
            false => tracing::error!(file, steps, "the recording has ended before its session: {error}"),
        }
    }

    /// Writes what has come since the last look. The outcome, once there is one: the session has ended, or why the
    /// recording does before it.
    fn look(&mut self) -> McapResult<Option<Result<(), String>>> {
        let now_ns = MonotonicClock::now_ns();
        let (entries, state) = self.reel.tape.take();
        self.write_entries(entries)?;
        self.write_pictures()?;
        self.looked_ns = now_ns;
        let has_ended = state != TapeState::Running;
        if has_ended || now_ns - self.flushed_ns >= FLUSH_NS {
            self.flushed_ns = now_ns;
            self.tracks.flush()?;
            let steps = self.steps;
            self.told.note(|recording| recording.steps = steps);
            if let (TapeState::Running, Err(full)) = (state, (self.room)()) {
                return Ok(Some(Err(full)));
            }
        }
        Ok(tape::ended(state))
    }

    fn write_entries(&mut self, entries: VecDeque<TapeEntry>) -> McapResult<()> {
        // Between the last look and this one, and after what was written before it.
        let time_ns = self.clock.unix_ns(self.looked_ns);
        entries.iter().try_for_each(|entry| match entry {
            TapeEntry::Step(taped) => self.write_step(taped, entry),
            // Steps that were recorded lead there.
            TapeEntry::Base(_) if self.steps > 0 => Ok(()),
            _ => tape::write(&mut self.tracks, time_ns, entry),
        })
    }

    fn write_step(&mut self, taped: &TapedStep, entry: &TapeEntry) -> McapResult<()> {
        let time_ns = self.clock.unix_ns(taped.report.ended_ns);
        tape::write(&mut self.tracks, time_ns, entry)?;
        for (tool, was_placed) in self.placed.iter_mut().enumerate() {
            let is_placed = taped.report.tools.get(tool).is_some_and(|tool| tool.output.pose.is_some());
            if std::mem::replace(was_placed, is_placed) || is_placed {
                let felt = contact(&taped.report, tool, NOBODY, OF_NO_STREAM, 0);
                self.tracks.write(Track::Contact(tool), time_ns, &felt)?;
            }
        }
        self.steps += 1;
        Ok(())
    }

    /// Structure is written with the state that follows it, whose time it has.
    fn write_pictures(&mut self) -> McapResult<()> {
        while let Some(message) = self.reel.pictures.try_next() {
            match message {
                ViewMessage::Keyframe(_) | ViewMessage::Patch(_) => self.changes.push(message),
                ViewMessage::State(state) => self.write_state(&state)?,
                // From the tape.
                ViewMessage::Event(_) => {}
            }
        }
        Ok(())
    }

    fn write_state(&mut self, state: &ViewState) -> McapResult<()> {
        let time_ns = self.clock.unix_ns(state.published_ns);
        for change in std::mem::take(&mut self.changes) {
            match &change {
                ViewMessage::Keyframe(keyframe) => {
                    // Without quanta: recorded displacements are in metres.
                    let quanta_m = vec![0.0; keyframe.bodies.len()];
                    self.tracks.write(Track::Keyframe, time_ns, &view::keyframe(keyframe, &quanta_m))?;
                }
                ViewMessage::Patch(patch) => self.tracks.write(Track::Patch, time_ns, &view::patch(patch))?,
                ViewMessage::State(_) | ViewMessage::Event(_) => {}
            }
            self.surface.iter_mut().for_each(|surface| surface.follow(&change));
        }
        self.tracks.write(Track::Energy, time_ns, &energy_ledger(&state.energy))?;
        self.tracks.write(Track::State, time_ns, &convert::state(state))?;
        for (tool, output) in state.tools.iter().enumerate() {
            if let Some(pose) = &output.pose {
                self.tracks.write(Track::Pose(tool), time_ns, &surface::pose_in_frame(time_ns, pose))?;
            }
        }
        if let Some(update) = self.surface.as_mut().and_then(|surface| surface.draw(time_ns, state)) {
            self.tracks.write(Track::Surface, time_ns, &update)?;
        }
        Ok(())
    }
}

impl Surface {
    fn follow(&mut self, change: &ViewMessage) {
        match (change, &mut self.structure) {
            (ViewMessage::Keyframe(keyframe), structure) => *structure = Some(Keyframe::clone(keyframe)),
            // One that does not fit leaves nothing to draw until the next keyframe.
            (ViewMessage::Patch(patch), structure) => {
                *structure = structure.take().and_then(|mut known| known.follow(patch).is_ok().then_some(known));
            }
            _ => {}
        }
    }

    fn draw(&mut self, time_ns: u64, state: &ViewState) -> Option<foxglove::SceneUpdate> {
        let structure = self.structure.as_ref().filter(|_| time_ns >= self.drawn_ns + SURFACE_NS)?;
        self.drawn_ns = time_ns;
        Some(surface::scene_update(time_ns, &self.objects, structure, state))
    }
}
