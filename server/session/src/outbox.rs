//! What leaves a session: structure as a log, state latest-wins, events as a short ring.
//!
//! The session's thread publishes, readers pull; a reader that does not pull costs nothing. State is
//! handed out only at the topology version that its reader has reached.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use tokio::sync::watch;

use crate::error::SessionError;
use crate::limits::{SessionLimits, to_ns};
use crate::lock::lock;
use crate::status::Phase;
use crate::structure_log::{Cursor, Next, StructureLog};
use crate::view_message::{SceneEvent, ViewEvent, ViewMessage, ViewState};
use crate::vitals::Vitals;

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

    pub fn set_phase(&self, phase: Phase) {
        *lock(&self.phase) = phase;
    }

    /// Lays an event onto its shelf, in the place of the oldest where there is no room.
    pub fn lay_event(&self, shelf: &mut Shelf, event: ViewEvent) {
        shelf.events.push_back(event);
        shelf.event_count += 1;
        while shelf.events.len() > self.max_events {
            shelf.events.pop_front();
        }
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
