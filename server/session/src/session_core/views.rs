//! What viewers of a session get, and when: shots, which are handed over to whoever shows them.

use kerf_physics::step_io::StepOutput;
use kerf_physics::view::StructureChange;

use super::SessionCore;
use crate::feed::{News, Shot};
use crate::limits::to_ns;
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
    /// Epoch of what is shown.
    epoch: u64,
    /// Things in the structure that was handed over: from a change of as many on, the whole costs less. `None` where none
    /// was, or where what was is of no use any more.
    pub(super) handed_over: Option<usize>,
    /// What steps have changed in that structure since the last shot.
    change: Option<StructureChange>,
}

impl ViewSchedule {
    /// Of a scene that has started over.
    pub fn of_epoch(epoch: u64) -> Self {
        Self { epoch, ..Self::default() }
    }

    pub fn add_step(&mut self, output: &StepOutput, elapsed_ns: u64) {
        self.times.add(output, elapsed_ns);
    }

    /// Keeps what a step has changed until a shot is handed over.
    fn add_change(&mut self, next: StructureChange) {
        match &mut self.change {
            Some(change) => change.append(next),
            None => self.change = Some(next),
        }
        if self.change.as_ref().map(StructureChange::len) > self.handed_over {
            self.forget_structure();
        }
    }

    /// What was handed over is of no use any more.
    fn forget_structure(&mut self) {
        (self.handed_over, self.change) = (None, None);
    }

    /// The next step is shown, whenever a state was published last.
    pub fn hasten_state(&mut self) {
        self.next_state_ns = AT_ONCE_NS;
    }
}

impl SessionCore {
    /// Hands state over as it falls due, with what has changed in the structure since the last one; nothing while
    /// nobody views.
    pub(super) fn serve_viewers(&mut self, now_ns: u64, stepped: bool) {
        if !self.publisher.is_viewed() {
            // Whoever comes next gets a keyframe of then.
            if self.views.handed_over.is_some() {
                self.feed.forget();
                self.views.forget_structure();
            }
            return;
        }
        if stepped && self.views.handed_over.is_some() {
            self.world.structure_change().into_iter().for_each(|change| self.views.add_change(change));
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
        if wants_keyframe {
            self.views.next_keyframe_ns = now_ns + to_ns(self.limits.min_keyframe_interval_s);
        }
        self.hand_over(now_ns, wants_keyframe);
    }

    fn hand_over(&mut self, now_ns: u64, wants_keyframe: bool) {
        let interval_ns = to_ns(1.0 / self.limits.view_rate_hz);
        let mut shot = self.feed.take_back();
        shot.state.is_hastened |= self.views.next_state_ns == AT_ONCE_NS;
        // From the time it was due, so that the rate is kept though steps do not divide it.
        self.views.next_state_ns = (self.views.next_state_ns + interval_ns).max(now_ns + interval_ns / 2);
        shot.wants_keyframe |= wants_keyframe;
        self.tell_structure(&mut shot);
        self.world.write_frame(&mut shot.frame);
        self.tell_state(&mut shot, now_ns);
        self.feed.hand_over(shot);
    }

    /// Goes on with what the shot has of the structure.
    fn tell_structure(&mut self, shot: &mut Shot) {
        let told = shot.structure.take();
        let change = self.views.change.take();
        let news = match (told, change) {
            _ if self.views.handed_over.is_none() => None,
            (Some(News::Change(mut told)), Some(change)) => {
                told.append(change);
                (Some(told.len()) <= self.views.handed_over).then_some(Some(News::Change(told)))
            }
            // A whole that nobody has taken yet is out of date.
            (Some(News::Whole(_)), Some(_)) => None,
            (told, change) => Some(told.or(change.map(News::Change))),
        };
        shot.structure = news.unwrap_or_else(|| {
            // Those who view have nothing that leads to it.
            shot.wants_keyframe = true;
            let structure = self.world.structure();
            self.views.handed_over = Some(structure.len());
            Some(News::Whole(structure))
        });
    }

    fn tell_state(&mut self, shot: &mut Shot, now_ns: u64) {
        let (output, state) = (self.world.output(), &mut shot.state);
        state.place = Place { epoch: self.views.epoch, version: output.topology_version };
        state.topology_version = output.topology_version;
        (state.step, state.sim_time_s) = (output.step, output.sim_time_s);
        state.late_steps = self.pacer.counts().late_steps;
        state.tools.clone_from(&output.tools);
        state.energy = self.tally.energy;
        state.times.join(&std::mem::take(&mut self.views.times));
        state.published_ns = now_ns;
    }
}
