//! What viewers of a session get, and when.

use kerf_physics::StageClock;
use kerf_physics::step_io::StepOutput;
use kerf_physics::surface::delta::TopologyPatch;

use super::SessionCore;
use crate::limits::to_ns;
use crate::outbox::ViewState;
use crate::status::StepTimes;
use crate::structure_log::Place;

/// The next state is due, whatever the rate.
const AT_ONCE_NS: u64 = 0;

/// When the next of each is due, and what has been summed up for it.
#[derive(Default)]
pub(super) struct ViewSchedule {
    next_state_ns: u64,
    next_keyframe_ns: u64,
    /// The state of now was shown to every viewer, however few it takes.
    is_told_to_all: bool,
    times: StepTimes,
    /// What steps have changed in the structure since the last state.
    patch: Option<TopologyPatch>,
}

impl ViewSchedule {
    pub fn add_step(&mut self, output: &StepOutput, elapsed_ns: u64) {
        self.times.add(output, elapsed_ns);
    }

    /// Keeps what a step has changed until a state is published.
    fn add_patch(&mut self, next: &TopologyPatch) {
        let goes_on = self.patch.as_mut().is_some_and(|patch| patch.append(next).is_ok());
        if !goes_on {
            self.patch = Some(next.clone());
        }
    }

    /// The structure is replaced: what was changed in the old one is of no use.
    pub fn forget_patch(&mut self) {
        self.patch = None;
    }

    /// The next step is shown, whenever a state was published last.
    pub fn hasten_state(&mut self) {
        self.next_state_ns = AT_ONCE_NS;
    }
}

impl SessionCore {
    /// Publishes state as it falls due, after what has changed in the structure since the last one; nothing while
    /// nobody views.
    pub(super) fn serve_viewers(&mut self, now_ns: u64, clock: &dyn StageClock, stepped: bool) {
        if !self.publisher.is_viewed() {
            // Whoever comes next gets a keyframe of then.
            self.world.forget_surface();
            self.views.forget_patch();
            return;
        }
        if let Some(patch) = self.world.topology_patch().filter(|_| stepped) {
            self.views.add_patch(patch);
        }
        let is_keyframe_wanted = self.publisher.keyframe_wanted();
        let wants_keyframe = is_keyframe_wanted && now_ns >= self.views.next_keyframe_ns;
        // A session that stands owes the state that it stands with, which comes with the keyframe if one is to come.
        let owes_state = match stepped {
            true => now_ns >= self.views.next_state_ns,
            false => !self.views.is_told_to_all && !is_keyframe_wanted,
        };
        self.views.is_told_to_all &= !stepped;
        if !wants_keyframe && !owes_state {
            return;
        }
        if !stepped {
            // No other follows for who takes fewer.
            self.views.hasten_state();
            self.views.is_told_to_all = true;
        }
        if let Some(patch) = self.views.patch.take() {
            self.publisher.patch(patch);
        }
        if wants_keyframe {
            self.views.next_keyframe_ns = now_ns + to_ns(self.limits.min_keyframe_interval_s);
            self.publisher.keyframe(self.world.keyframe());
        }
        self.publish_state(now_ns, clock);
    }

    fn publish_state(&mut self, now_ns: u64, clock: &dyn StageClock) {
        let interval_ns = to_ns(1.0 / self.limits.view_rate_hz);
        let is_hastened = self.views.next_state_ns == AT_ONCE_NS;
        // From the time it was due, so that the rate is kept though steps do not divide it.
        self.views.next_state_ns = (self.views.next_state_ns + interval_ns).max(now_ns + interval_ns / 2);
        if let Some(took_ns) = self.world.adapt_surface(clock) {
            self.views.times.add_adaptation(took_ns);
        }
        let output = self.world.output();
        let displacements = |object: usize| {
            let mut displacements_m = Vec::new();
            self.world.node_displacements_m(object, &mut displacements_m);
            displacements_m
        };
        let objects = 0..self.scene.desc.objects.len();
        let version = output.topology_version;
        self.publisher.state(ViewState {
            place: Place { epoch: self.publisher.epoch(), version },
            topology_version: version,
            step: output.step,
            sim_time_s: output.sim_time_s,
            late_steps: self.pacer.counts().late_steps,
            node_displacements_m: objects.clone().map(displacements).collect(),
            adapted: objects.map(|object| self.world.adapted_vertices(object).to_vec()).collect(),
            tools: output.tools.clone(),
            energy: self.tally.energy,
            times: std::mem::take(&mut self.views.times),
            published_ns: now_ns,
            is_hastened,
        });
    }
}
