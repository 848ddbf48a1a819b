//! Shows a session: makes surfaces, patches and states of the shots that its thread hands over.
//!
//! It contours what has parted, adapts the surface to the blades and hashes it, on a thread of its own below the one that
//! steps. A session has one: what is large in one scene then delays no other's pictures, and one that nobody views
//! sleeps.

use std::panic::{AssertUnwindSafe, catch_unwind};

use kerf_physics::view::View;
use kerf_physics::{Stage, StageClock};

use crate::feed::{News, Next, Shot, Shots};
use crate::showcase::Showcase;
use crate::status::StepTimes;

/// Shows one session.
pub(crate) struct Projector {
    shots: Shots,
    showcase: Showcase,
    /// What is known of the scene; nothing before a shot with the whole structure.
    view: Option<View>,
}

impl Projector {
    pub fn new(shots: Shots, showcase: Showcase) -> Self {
        Self { shots, showcase, view: None }
    }

    /// Shows what comes until the session ends.
    pub fn run(mut self, clock: &dyn StageClock) {
        loop {
            match self.shots.next() {
                Next::Shot(shot) => self.show(shot, clock),
                Next::Forget => self.view = None,
                Next::End => return,
            }
        }
    }

    /// Shows what waits.
    #[cfg(any(test, feature = "virtual-time"))]
    pub fn show_waiting(&mut self, clock: &dyn StageClock) {
        while let Some(next) = self.shots.try_next() {
            match next {
                Next::Shot(shot) => self.show(shot, clock),
                Next::Forget => self.view = None,
                Next::End => return,
            }
        }
    }

    /// A panic costs viewers the pictures until the scene is another or all of them have left, and the session nothing.
    fn show(&mut self, mut shot: Box<Shot>, clock: &dyn StageClock) {
        if catch_unwind(AssertUnwindSafe(|| self.publish(&mut shot, clock))).is_err() {
            tracing::error!(step = shot.state.step, "showing a step panicked: viewers see no more of the session");
            self.view = None;
        }
        self.shots.give_back(shot);
    }

    fn publish(&mut self, shot: &mut Shot, clock: &dyn StageClock) {
        let epoch = shot.state.epoch();
        let mut laps = Laps { clock, last_ns: clock.now_ns(), times: &mut shot.state.times };
        if let Some(news) = shot.structure.take() {
            self.follow(epoch, news);
            laps.end(Stage::Surface);
        }
        let Some(view) = &mut self.view else { return };
        if shot.wants_keyframe {
            self.showcase.keyframe(epoch, view.keyframe());
        }
        laps.begin();
        view.adapt(&shot.frame);
        if shot.frame.is_touched() {
            laps.end(Stage::Adaptation);
        }
        let objects = 0..view.surfaces().count();
        let displacements = |object: usize| {
            let mut displacements_m = Vec::new();
            view.node_displacements_m(&shot.frame, object, &mut displacements_m);
            displacements_m
        };
        let mut state = shot.state.clone();
        state.node_displacements_m = objects.clone().map(displacements).collect();
        state.adapted = objects.map(|object| view.adapted_vertices(object).to_vec()).collect();
        self.showcase.state(state);
    }

    fn follow(&mut self, epoch: u64, news: News) {
        match (news, &mut self.view) {
            (News::Whole(structure), view) => *view = Some(View::new(structure)),
            (News::Change(change), Some(view)) => self.showcase.patch(epoch, view.follow(&change)),
            (News::Change(_), None) => {}
        }
    }
}

/// Takes the time of what is shown.
struct Laps<'a> {
    clock: &'a dyn StageClock,
    last_ns: u64,
    times: &'a mut StepTimes,
}

impl Laps<'_> {
    fn begin(&mut self) {
        self.last_ns = self.clock.now_ns();
    }

    fn end(&mut self, stage: Stage) {
        let now_ns = self.clock.now_ns();
        self.times.stage_ns[stage as usize] += now_ns.saturating_sub(self.last_ns);
        self.last_ns = now_ns;
    }
}
