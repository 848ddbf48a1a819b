//! A recording that is played: it takes a session's place, so that viewers see it as if it were live.
//!
//! It obeys the commands that look on (pause, resume, step, describe) and those that go to another time; what would
//! change a session is refused. Where the frames come from is the caller's affair: see [`Footage`].

use std::time::Duration;

use kerf_physics::surface::delta::{Keyframe, TopologyPatch};
use tokio::sync::oneshot;

use crate::clock::MonotonicClock;
use crate::error::SessionError;
use crate::inbox::{CheckpointCommand, Command, Inbox};
use crate::publisher::Publisher;
use crate::seek::{Position, Seek};
use crate::status::{Phase, SessionStatus};
use crate::stepping::{StepOutcome, Stepped};
use crate::structure_log::Place;
use crate::view_message::{SceneEvent, ViewEvent, ViewState};

/// How often viewers are looked after while nothing is due, ns.
const STANDING_TICK_NS: u64 = 20_000_000;
/// Speeds that a recording is played at, times that of its making.
pub const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// A change of structure in a recording.
#[derive(Clone, Debug)]
pub enum Structure {
    /// The whole of it.
    Keyframe(Keyframe),
    /// What changed.
    Patch(TopologyPatch),
}

/// What a recording shows at one time.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Time since the recording began, ns.
    pub time_ns: u64,
    /// What happened since the frame before.
    pub events: Vec<ViewEvent>,
    /// How the structure changed since the frame before.
    pub structure: Vec<Structure>,
    /// Where everything is.
    pub state: ViewState,
}

/// Where the frames of a recording come from, in order.
pub trait Footage: Send {
    /// Time from the first to the last frame, ns.
    fn length_ns(&self) -> u64;

    /// The next frame; `None` after the last.
    ///
    /// # Errors
    /// What is wrong with the recording there.
    fn next(&mut self) -> Result<Option<Frame>, String>;

    /// The last frame until a time, or else the first, with the whole structure and without events; the frames after it
    /// come next.
    ///
    /// # Errors
    /// What is wrong with the recording there.
    fn seek(&mut self, time_ns: u64) -> Result<Option<Frame>, String>;
}

/// A recording, and how far it has been played.
pub(crate) struct Player {
    footage: Box<dyn Footage>,
    publisher: Publisher,
    phase: Phase,
    speed: f64,
    /// Time in the recording and on the clock from which it is played.
    from_ns: (u64, u64),
    shown: Frame,
    keyframe: Keyframe,
    next: Option<Frame>,
    /// Steps of [`Command::Step`] that are yet to be shown.
    owed: u32,
}

impl Player {
    /// The first frame of a recording; a recording without frames cannot be played.
    pub fn new(mut footage: Box<dyn Footage>, publisher: Publisher, seek: Seek) -> Result<Self, SessionError> {
        let refuse = |message| SessionError::Failed { message };
        let first = footage.seek(0).map_err(refuse)?;
        let first = first.ok_or_else(|| refuse("nothing was recorded that could be shown".into()))?;
        let mut player = Self {
            footage,
            phase: publisher.phase(),
            publisher,
            speed: 1.0,
            from_ns: (0, 0),
            shown: Frame::default(),
            keyframe: Keyframe::default(),
            next: None,
            owed: 0,
        };
        player.cut_to(first)?;
        player.seek(seek, MonotonicClock::now_ns())?;
        Ok(player)
    }

    /// Plays until the session is closed.
    pub fn run(mut self, inbox: &Inbox) {
        let mut commands = Vec::new();
        while inbox.take_commands(&mut commands) {
            commands.drain(..).for_each(|command| self.obey(command));
            let now_ns = MonotonicClock::now_ns();
            self.publisher.vitals().come_by(now_ns);
            if let Err(error) = self.play(now_ns) {
                self.fail(&error);
            }
            self.serve_newcomers();
            let due_ns = self.due_ns(now_ns).unwrap_or(u64::MAX).min(now_ns + STANDING_TICK_NS);
            inbox.wait(Duration::from_nanos(due_ns.saturating_sub(MonotonicClock::now_ns())));
        }
        self.set_phase(Phase::Closing, SceneEvent::Closing);
    }

    /// When the next frame is due on the clock; never while it stands.
    fn due_ns(&self, now_ns: u64) -> Option<u64> {
        if self.owed > 0 {
            return Some(now_ns);
        }
        let next = self.next.as_ref().filter(|_| self.phase == Phase::Running)?;
        let ahead_ns = next.time_ns.saturating_sub(self.from_ns.0) as f64 / self.speed;
        Some(self.from_ns.1 + ahead_ns as u64)
    }

    /// Shows what is due. Of several states that are due at once viewers see the last.
    fn play(&mut self, now_ns: u64) -> Result<(), SessionError> {
        let mut has_moved = false;
        while self.due_ns(now_ns).is_some_and(|due_ns| due_ns <= now_ns) {
            let Some(next) = self.next.take() else {
                self.owed = 0;
                break;
            };
            self.owed = self.owed.saturating_sub(1);
            self.next = self.footage.next().map_err(|message| SessionError::Failed { message })?;
            self.show(next)?;
            has_moved = true;
        }
        if has_moved {
            self.publish_state();
        }
        if self.phase == Phase::Running && self.next.is_none() {
            self.set_phase(Phase::Paused, SceneEvent::Paused);
        }
        Ok(())
    }

    /// Takes over a frame's structure and events.
    fn show(&mut self, mut frame: Frame) -> Result<(), SessionError> {
        for change in std::mem::take(&mut frame.structure) {
            match change {
                Structure::Keyframe(keyframe) => {
                    let epoch = self.publisher.start_over();
                    self.publisher.showcase.keyframe(epoch, keyframe.clone());
                    self.keyframe = keyframe;
                }
                Structure::Patch(patch) => {
                    let followed = self.keyframe.follow(&patch);
                    followed.map_err(|unfit| SessionError::Failed { message: unfit.to_string() })?;
                    self.publisher.showcase.patch(self.publisher.epoch(), patch);
                }
            }
        }
        let events = std::mem::take(&mut frame.events);
        events.into_iter().for_each(|happened| self.publisher.event(happened.step, happened.event));
        self.shown = frame;
        Ok(())
    }

    /// Goes on from a frame that has the whole structure.
    fn cut_to(&mut self, frame: Frame) -> Result<(), SessionError> {
        self.next = self.footage.next().map_err(|message| SessionError::Failed { message })?;
        self.show(frame)?;
        self.publish_state();
        Ok(())
    }

    fn seek(&mut self, seek: Seek, now_ns: u64) -> Result<Position, SessionError> {
        let at_ns = self.time_ns(now_ns);
        if let Some(time_s) = seek.time_s {
            let frame = self.footage.seek((time_s.max(0.0) * 1e9) as u64);
            let frame = frame.map_err(|message| SessionError::Failed { message })?;
            self.cut_to(frame.ok_or(SessionError::Closed)?)?;
        }
        self.speed = seek.speed.unwrap_or(self.speed).clamp(*SPEEDS.start(), *SPEEDS.end());
        self.from_ns = (if seek.time_s.is_some() { self.shown.time_ns } else { at_ns }, now_ns);
        Ok(self.position(now_ns))
    }

    /// Time in the recording that it is now, ns.
    fn time_ns(&self, now_ns: u64) -> u64 {
        let (from_ns, since_ns) = self.from_ns;
        let played_ns = (now_ns.saturating_sub(since_ns) as f64 * self.speed) as u64;
        match self.phase {
            Phase::Running => (from_ns + played_ns).min(self.footage.length_ns()),
            _ => self.shown.time_ns,
        }
    }

    fn position(&self, now_ns: u64) -> Position {
        Position {
            time_s: self.time_ns(now_ns) as f64 * 1e-9,
            length_s: self.footage.length_ns() as f64 * 1e-9,
            speed: self.speed,
            step: self.shown.state.step,
        }
    }

    fn publish_state(&self) {
        let state = &self.shown.state;
        let place = Place { epoch: self.publisher.epoch(), version: state.topology_version };
        self.publisher.showcase.state(ViewState { place, published_ns: MonotonicClock::now_ns(), ..state.clone() });
    }

    /// A viewer that came later gets the structure of now.
    fn serve_newcomers(&self) {
        if self.publisher.is_viewed() && self.publisher.keyframe_wanted() {
            self.publisher.showcase.keyframe(self.publisher.epoch(), self.keyframe.clone());
            self.publish_state();
        }
    }

    fn set_phase(&mut self, phase: Phase, event: SceneEvent) {
        self.phase = phase.clone();
        self.publisher.set_phase(phase);
        self.publisher.event(self.shown.state.step, event);
    }

    fn fail(&mut self, error: &SessionError) {
        tracing::error!(step = self.shown.state.step, "the recording cannot be played on: {error}");
        self.next = None;
        self.set_phase(Phase::Failed { message: error.to_string().into() }, SceneEvent::Failed);
    }

    fn obey(&mut self, command: Command) {
        // A caller that has given up waiting is no error.
        match command {
            Command::Pause(answer) => {
                self.pause();
                let _ = answer.send(self.shown.state.step);
            }
            Command::Resume(answer) => {
                let _ = answer.send(self.resume());
            }
            Command::Step(steps, answer) if steps.inputs.is_empty() => {
                self.pause();
                self.owed = steps.count;
                let _ = answer.send(Ok(self.shown()));
            }
            Command::Step(_, answer) => refuse(answer),
            Command::Describe(answer) => {
                let _ = answer.send(self.describe());
            }
            Command::Seek(to, answer) => {
                let _ = answer.send(self.seek(to, MonotonicClock::now_ns()));
            }
            Command::Reset(answer) => refuse(answer),
            Command::Leave(answer) => refuse(answer),
            Command::Stay(answer) => refuse(answer),
            Command::Checkpoint(command) => match command {
                CheckpointCommand::Save(_, answer) | CheckpointCommand::Restore(_, answer) => refuse(answer),
                CheckpointCommand::Read(_, answer) | CheckpointCommand::Copy(answer) => refuse(answer),
                CheckpointCommand::Keep(_, _, answer) => refuse(answer),
                CheckpointCommand::Check(_, answer) | CheckpointCommand::Delete(_, answer) => refuse(answer),
                CheckpointCommand::List(answer) => drop(answer.send(Vec::new())),
            },
            // Refused before it gets here: there is no world to look into.
            Command::Query(_) => {}
        }
    }

    fn pause(&mut self) {
        self.owed = 0;
        if self.phase == Phase::Running {
            self.set_phase(Phase::Paused, SceneEvent::Paused);
        }
    }

    /// Plays on; from the beginning once it has come to its end.
    fn resume(&mut self) -> Result<u64, SessionError> {
        if let Phase::Failed { message } = &self.phase {
            return Err(SessionError::Failed { message: message.to_string() });
        }
        if self.phase == Phase::Paused {
            let now_ns = MonotonicClock::now_ns();
            if self.next.is_none() {
                self.seek(Seek { time_s: Some(0.0), speed: None }, now_ns)?;
            }
            self.from_ns = (self.shown.time_ns, now_ns);
            self.owed = 0;
            self.set_phase(Phase::Running, SceneEvent::Resumed);
        }
        Ok(self.shown.state.step)
    }

    /// What is shown as its steps begin to be: a recording shows them one after the other.
    fn shown(&self) -> Stepped {
        let ViewState { step, sim_time_s, topology_version, energy, .. } = self.shown.state;
        let tools = self.shown.state.tools.clone();
        let waits = vec![false; tools.len()];
        let outcome = StepOutcome { step, sim_time_s, tools, waits, energy, tracked_displacement_m: Vec::new() };
        Stepped { outcomes: vec![outcome], topology_version, state_hash: 0 }
    }

    fn describe(&self) -> SessionStatus {
        let state = &self.shown.state;
        SessionStatus {
            phase: self.phase.clone(),
            step: state.step,
            sim_time_s: state.sim_time_s,
            topology_version: state.topology_version,
            late_steps: state.late_steps,
            energy: state.energy,
            ..SessionStatus::default()
        }
    }
}

fn refuse<T>(answer: oneshot::Sender<Result<T, SessionError>>) {
    let _ = answer.send(Err(SessionError::IsReplay));
}
