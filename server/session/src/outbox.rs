//! What leaves a session: structure as a log, state latest-wins, events as a short ring.
//!
//! The session's thread publishes, readers pull; a reader that does not pull costs nothing. State is
//! handed out only at the topology version that its reader has reached.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use kerf_physics::fault::Fault;
use kerf_physics::step_io::{EnergyStep, ToolOutput};
use kerf_physics::surface::delta::{AdaptedVertex, Keyframe, TopologyPatch};
use rtrb::Producer;
use tokio::sync::watch;

use crate::counts::Counts;
use crate::error::SessionError;
use crate::late_steps::LateStep;
use crate::limits::{SessionLimits, to_ns};
use crate::lock::lock;
use crate::shortfall::Shortfall;
use crate::showcase::Showcase;
use crate::status::{Phase, StepTimes};
use crate::step_report::StepReport;
use crate::structure_log::{Cursor, Next, Place, StructureLog};
use crate::tape::{Tape, TapeEntry};
use crate::vitals::Vitals;

/// Where everything is.
#[derive(Clone, Debug, Default)]
pub struct ViewState {
    pub(crate) place: Place,
    /// Version of the structure it belongs to.
    pub topology_version: u64,
    /// Steps taken.
    pub step: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Late steps since the session began or was reset.
    pub late_steps: u64,
    /// Per object: displacement of every node slot, xyz interleaved, m, scene frame.
    pub node_displacements_m: Vec<Vec<f32>>,
    /// Per object: vertices of its surface that are adapted to a blade, ids ascending.
    pub adapted: Vec<Vec<AdaptedVertex>>,
    /// One entry per tool of the scene.
    pub tools: Vec<ToolOutput>,
    /// Energy booked since the scene was at rest: levels as they are, all else summed up, as viewers see a
    /// step in many.
    pub energy: EnergyStep,
    /// Durations of the steps since the state before.
    pub times: StepTimes,
    /// When it was published, ns on the server's monotonic clock.
    pub published_ns: u64,
    /// It is shown whatever a viewer's rate: there may be no later one.
    pub(crate) is_hastened: bool,
}

impl ViewState {
    /// Rises when the scene starts over or goes back: versions, steps and node slots mean something else then.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        self.place.epoch
    }
}

/// Something that happened to a session.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneEvent {
    /// The session stands.
    Paused,
    /// The session steps on.
    Resumed,
    /// The scene is at rest again.
    Reset,
    /// The session ends; nothing follows.
    Closing,
    /// A step panicked; the session stands until it is reset.
    Failed,
    /// A driver took a tool.
    ToolTaken(usize),
    /// A tool has no driver any more.
    ToolReleased(usize),
    /// The session gave up time that it had lost.
    Reanchored,
    /// So large a share of the last seconds' steps was late: the scene runs slower than the hands that drive it.
    Overloaded(f64),
    /// Relative residual that solves end at from now on: bounded work leaves more, or the scene's tolerance is kept again.
    ToleranceChanged(f64),
    /// The state was saved as the checkpoint of this name.
    CheckpointSaved(Arc<str>),
    /// The scene is at the checkpoint of this name again, every tool lifted.
    CheckpointRestored(Arc<str>),
    /// A checkpoint of this name came as a file.
    CheckpointUploaded(Arc<str>),
    /// State that was not finite, or had energy from nowhere, was rolled back.
    Fault(Fault),
    /// Solves fell short of what was asked of them.
    Unsolved(Shortfall),
    /// So many pieces fell out of the scene's reach and were put away.
    PutAway(u32),
}

/// An event and when it happened.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewEvent {
    /// Step after which it happened.
    pub step: u64,
    /// What happened.
    pub event: SceneEvent,
}

/// What a viewer gets.
#[derive(Clone, Debug)]
pub enum ViewMessage {
    /// The whole structure.
    Keyframe(Arc<Keyframe>),
    /// What changed in the structure.
    Patch(Arc<TopologyPatch>),
    /// Where everything is.
    State(Arc<ViewState>),
    /// Something happened.
    Event(ViewEvent),
}

/// What lies ready for viewers.
pub(crate) struct Shelf {
    pub log: StructureLog,
    pub state: Option<Arc<ViewState>>,
    events: VecDeque<ViewEvent>,
    /// Events ever published; the last of `events` has this number less one.
    event_count: u64,
}

/// The shared side of a session's output.
pub(crate) struct Outbox {
    pub shelf: Mutex<Shelf>,
    /// As the log has it, for the session's thread: it waits for no viewer.
    keyframe_wanted: AtomicBool,
    phase: Mutex<Phase>,
    viewers: AtomicUsize,
    /// Those who look on for the record.
    recorders: AtomicUsize,
    max_viewers: usize,
    max_events: usize,
    /// What shows without being asked for.
    pub vitals: Vitals,
}

impl Outbox {
    pub fn new(limits: &SessionLimits, phase: Phase) -> Self {
        let shelf = Shelf {
            log: StructureLog::new(limits.max_log_patches, limits.max_log_bytes),
            state: None,
            events: VecDeque::new(),
            event_count: 0,
        };
        Self {
            shelf: Mutex::new(shelf),
            keyframe_wanted: AtomicBool::new(false),
            phase: Mutex::new(phase),
            viewers: AtomicUsize::new(0),
            recorders: AtomicUsize::new(0),
            max_viewers: limits.max_viewers,
            max_events: limits.max_log_events,
            vitals: Vitals::new(to_ns(limits.hangs_after_s)),
        }
    }

    /// Patches that are kept for viewers, and the bytes that they hold.
    pub fn kept_patches(&self) -> (usize, usize) {
        lock(&self.shelf).log.kept()
    }

    /// Whether a viewer waits for a keyframe.
    pub fn keyframe_wanted(&self) -> bool {
        self.keyframe_wanted.load(Ordering::Acquire)
    }

    /// What the session is doing.
    pub fn phase(&self) -> Phase {
        lock(&self.phase).clone()
    }

    /// Viewers that are connected.
    pub fn viewers(&self) -> usize {
        self.viewers.load(Ordering::Acquire)
    }

    /// A new viewer, which sees events from now on.
    pub fn join(self: &Arc<Self>, bell: watch::Receiver<u64>) -> Result<Viewer, SessionError> {
        let shelf = lock(&self.shelf);
        if self.viewers() >= self.max_viewers {
            return Err(SessionError::TooManyViewers { limit: self.max_viewers });
        }
        Ok(self.seat(&shelf, bell, Seat::Guest))
    }

    /// One who looks on for the record, and is no guest: neither counted nor refused.
    pub fn join_for_the_record(self: &Arc<Self>, bell: watch::Receiver<u64>) -> Viewer {
        let shelf = lock(&self.shelf);
        self.seat(&shelf, bell, Seat::Recorder)
    }

    fn seat(self: &Arc<Self>, shelf: &Shelf, bell: watch::Receiver<u64>, seat: Seat) -> Viewer {
        self.count(seat).fetch_add(1, Ordering::AcqRel);
        Viewer {
            outbox: Arc::clone(self),
            seat,
            bell,
            cursor: Cursor::default(),
            next_event: shelf.event_count,
            last_state: None,
            interval_ns: 0,
            ended: false,
        }
    }

    fn count(&self, seat: Seat) -> &AtomicUsize {
        match seat {
            Seat::Guest => &self.viewers,
            Seat::Recorder => &self.recorders,
        }
    }

    /// Whether anybody views, for the record or not.
    pub fn is_viewed(&self) -> bool {
        [Seat::Guest, Seat::Recorder].into_iter().any(|seat| self.count(seat).load(Ordering::Acquire) > 0)
    }

    /// Takes over from the log whether somebody waits for a keyframe.
    pub fn note_wish(&self, log: &StructureLog) {
        self.keyframe_wanted.store(log.keyframe_wanted(), Ordering::Release);
    }

    fn leave(&self, seat: Seat) {
        let mut shelf = lock(&self.shelf);
        self.count(seat).fetch_sub(1, Ordering::AcqRel);
        if !self.is_viewed() {
            // The next viewer gets a keyframe of its own time.
            shelf.log.clear();
            shelf.state = None;
            shelf.events.clear();
        }
    }
}

/// What somebody looks on as.
#[derive(Clone, Copy)]
enum Seat {
    Guest,
    Recorder,
}

/// The session's end of its output.
pub(crate) struct Publisher {
    outbox: Arc<Outbox>,
    /// Where events are recorded, and steps.
    pub tape: Tape,
    /// Where surfaces and states go.
    pub showcase: Showcase,
    /// What is counted of all sessions; by itself until it is told of the others.
    pub counts: Arc<Counts>,
    reports: watch::Sender<Arc<StepReport>>,
    /// Where late steps go, if anybody may ask for them.
    pub late_steps: Option<Producer<LateStep>>,
}

impl Publisher {
    /// The publisher, and what new readers are made from. Readers see the end of the session by the
    /// end of the publisher and of all that its showcase was given to.
    pub fn new(outbox: Arc<Outbox>) -> (Self, watch::Receiver<u64>, watch::Receiver<Arc<StepReport>>) {
        let (bell, bell_reader) = watch::channel(0);
        let (reports, report_reader) = watch::channel(Arc::default());
        let showcase = Showcase::new(Arc::clone(&outbox), bell);
        let (tape, counts) = (Tape::default(), Arc::default());
        let publisher = Self { outbox, tape, showcase, counts, reports, late_steps: None };
        (publisher, bell_reader, report_reader)
    }

    /// What the session is doing, as others see it.
    pub fn phase(&self) -> Phase {
        self.outbox.phase()
    }

    pub fn set_phase(&self, phase: Phase) {
        *lock(&self.outbox.phase) = phase;
    }

    /// What shows of the session without being asked for.
    pub fn vitals(&self) -> &Vitals {
        &self.outbox.vitals
    }

    pub fn late_step(&mut self, late: LateStep) {
        if let Some(late_steps) = &mut self.late_steps {
            // Where there is no room it is counted alone.
            let _ = late_steps.push(late);
        }
    }

    /// Whether anybody views.
    pub fn is_viewed(&self) -> bool {
        self.outbox.is_viewed()
    }

    pub fn report(&self, report: StepReport) {
        self.reports.send_replace(Arc::new(report));
    }

    pub fn event(&self, step: u64, event: SceneEvent) {
        self.tape.push(&TapeEntry::Event(ViewEvent { step, event: event.clone() }));
        let Some(mut shelf) = self.showcase.shelf() else { return };
        shelf.events.push_back(ViewEvent { step, event });
        shelf.event_count += 1;
        while shelf.events.len() > self.outbox.max_events {
            shelf.events.pop_front();
        }
        drop(shelf);
        self.showcase.ring();
    }

    /// Whether somebody waits for a keyframe.
    pub fn keyframe_wanted(&self) -> bool {
        self.outbox.keyframe_wanted()
    }

    pub fn epoch(&self) -> u64 {
        lock(&self.outbox.shelf).log.epoch()
    }

    /// The scene is another from now on; its epoch.
    pub fn start_over(&self) -> u64 {
        let mut shelf = lock(&self.outbox.shelf);
        shelf.log.start_over();
        shelf.state = None;
        shelf.log.epoch()
    }
}

/// One viewer of a session. It pulls: what it does not ask for is not kept for it.
pub struct Viewer {
    outbox: Arc<Outbox>,
    seat: Seat,
    bell: watch::Receiver<u64>,
    cursor: Cursor,
    next_event: u64,
    /// The last state it got; cleared by structure, which a state has to follow.
    last_state: Option<LastState>,
    interval_ns: u64,
    ended: bool,
}

#[derive(Clone, Copy)]
struct LastState {
    step: u64,
    published_ns: u64,
}

impl Viewer {
    /// Limits states to one in `interval_ns`.
    pub fn set_interval_ns(&mut self, interval_ns: u64) {
        self.interval_ns = interval_ns;
    }

    /// What comes next, as soon as there is something; `None` once the session has ended.
    pub async fn next(&mut self) -> Option<ViewMessage> {
        loop {
            // Marked as heard before looking, so that nothing published in between is slept through.
            self.bell.borrow_and_update();
            if let Some(message) = self.try_next() {
                return Some(message);
            }
            if self.ended || self.bell.changed().await.is_err() {
                return self.try_next();
            }
        }
    }

    /// See [`ViewState::epoch`]: that of the structure which came last.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        self.cursor.place().map_or(0, |place| place.epoch)
    }

    /// Waits for the end of the session.
    pub async fn closed(&mut self) {
        while self.bell.changed().await.is_ok() {}
    }

    /// What comes next, if there is something. The order: the first keyframe; then events,
    /// structure, state.
    pub fn try_next(&mut self) -> Option<ViewMessage> {
        if self.ended {
            return None;
        }
        let outbox = Arc::clone(&self.outbox);
        let mut shelf = lock(&outbox.shelf);
        if let Some(event) = self.take_event(&shelf) {
            self.ended = event.event == SceneEvent::Closing;
            return Some(ViewMessage::Event(event));
        }
        match shelf.log.next(&mut self.cursor) {
            Next::Keyframe(keyframe) => {
                self.last_state = None;
                Some(ViewMessage::Keyframe(keyframe))
            }
            Next::Patch(patch) => {
                self.last_state = None;
                Some(ViewMessage::Patch(patch))
            }
            Next::UpToDate => self.take_state(&shelf).map(ViewMessage::State),
            Next::Awaiting => {
                outbox.note_wish(&shelf.log);
                None
            }
        }
    }

    /// Events wait for the first keyframe, except the end: after it there is none to wait for.
    fn take_event(&mut self, shelf: &Shelf) -> Option<ViewEvent> {
        let first = shelf.event_count - shelf.events.len() as u64;
        let mut index = usize::try_from(self.next_event.max(first) - first).ok()?;
        if self.cursor.place().is_none() {
            index += shelf.events.range(index..).position(|event| event.event == SceneEvent::Closing)?;
        }
        let event = shelf.events.get(index)?;
        self.next_event = first + index as u64 + 1;
        Some(event.clone())
    }

    fn take_state(&mut self, shelf: &Shelf) -> Option<Arc<ViewState>> {
        let state = shelf.state.as_ref().filter(|state| self.cursor.place() == Some(state.place))?;
        if let Some(last) = self.last_state {
            let too_early =
                !state.is_hastened && state.published_ns < last.published_ns.saturating_add(self.interval_ns);
            if state.step == last.step || too_early {
                return None;
            }
        }
        self.last_state = Some(LastState { step: state.step, published_ns: state.published_ns });
        Some(Arc::clone(state))
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.outbox.leave(self.seat);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_published_after_the_last_viewer_left_does_not_meet_the_next() {
        let outbox = Arc::new(Outbox::new(&SessionLimits::default(), Phase::Running));
        let (publisher, bell, _reports) = Publisher::new(Arc::clone(&outbox));
        drop(outbox.join(bell.clone()).unwrap());
        publisher.showcase.keyframe(0, Keyframe::default());
        publisher.showcase.patch(0, TopologyPatch { to_version: 1, ..TopologyPatch::default() });
        let mut next = outbox.join(bell).unwrap();
        assert!(next.try_next().is_none());
        assert!(publisher.keyframe_wanted());
        publisher.showcase.keyframe(0, Keyframe { topology_version: 5, ..Keyframe::default() });
        assert!(matches!(next.try_next(), Some(ViewMessage::Keyframe(now)) if now.topology_version == 5));
    }

    #[test]
    fn a_viewer_without_a_keyframe_hears_of_the_end_alone() {
        let outbox = Arc::new(Outbox::new(&SessionLimits::default(), Phase::Running));
        let (publisher, bell, _reports) = Publisher::new(Arc::clone(&outbox));
        let mut viewer = outbox.join(bell).unwrap();
        publisher.event(1, SceneEvent::ToolTaken(0));
        assert!(viewer.try_next().is_none());
        publisher.event(2, SceneEvent::Closing);
        let end = viewer.try_next();
        assert!(matches!(end, Some(ViewMessage::Event(last)) if last.event == SceneEvent::Closing));
        assert!(viewer.try_next().is_none());
    }
}
