//! The session's end of its output: to viewers through the outbox, to those who record through the tape.

use std::sync::Arc;

use rtrb::Producer;
use tokio::sync::watch;

use crate::counts::Counts;
use crate::late_steps::LateStep;
use crate::lock::lock;
use crate::outbox::Outbox;
use crate::showcase::Showcase;
use crate::status::Phase;
use crate::step_report::StepReport;
use crate::tape::{Tape, TapeEntry};
use crate::view_message::{SceneEvent, ViewEvent};
use crate::vitals::Vitals;

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
        self.outbox.set_phase(phase);
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
        self.outbox.lay_event(&mut shelf, ViewEvent { step, event });
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

#[cfg(test)]
mod tests {
    use kerf_physics::surface::delta::{Keyframe, TopologyPatch};

    use super::*;
    use crate::limits::SessionLimits;
    use crate::view_message::ViewMessage;

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
