//! From one model to the next without a jump, and what the newest one goes through meanwhile.
//!
//! A new model seldom agrees with the old one where the tool is now. The difference is kept as an offset, so that the
//! force goes on from where it was, and is taken back over the blend time (the "recovery" of Mark et al., SIGGRAPH 96).
//!
//! A cut that begins is felt when the tool's own force says so, not a round trip later. The models that follow know
//! nothing of it until one answers a pose from after it; from then on the server's word counts again.

use kerf_script::Pose;
use nalgebra::Vector3;

use super::model::{LocalModel, Reaction, Update};

/// The server is taken to know of a cut once it answers a pose from this long after it began, s: where it says that one
/// begins a little later, it does not begin twice.
const KNOWN_AFTER_S: f64 = 2e-3;

/// The newest model and what is left of the ones before.
#[derive(Clone, Copy, Debug, Default)]
pub struct Recovery {
    number: u64,
    model: Option<LocalModel>,
    /// What the models before it would add, N, at the blend's start.
    offset_n: Vector3<f64>,
    blend_s: f64,
    left_s: f64,
    /// How long ago a cut began that the server has not been heard of since, s.
    given_s: Option<f64>,
}

impl Recovery {
    /// Takes what the server said, where it is new; `tool` is where the tool is now, `pose_age_s` the age of the pose that
    /// the server speaks of.
    pub fn take(&mut self, update: &Update, tool: &Pose, pose_age_s: f64) {
        if update.number == self.number {
            return;
        }
        let before_n = self.reaction(tool).force_n;
        (self.number, self.model) = (update.number, update.model);
        self.given_s = self.given_s.filter(|given_s| pose_age_s + KNOWN_AFTER_S > *given_s);
        if self.given_s.is_some() {
            self.model.iter_mut().for_each(LocalModel::give);
        }
        (self.blend_s, self.left_s) = (update.blend_s, 0.0);
        self.offset_n = before_n - self.reaction(tool).force_n;
        self.left_s = update.blend_s;
    }

    /// Whether a cut begins with the tool there, at this velocity. If so, from now on it has.
    pub fn gives(&mut self, tool: &Pose, velocity_m_per_s: &Vector3<f64>) -> bool {
        let Some(model) = self.model.as_mut().filter(|model| model.gives(tool, velocity_m_per_s)) else { return false };
        model.give();
        self.given_s = Some(0.0);
        true
    }

    /// The tool has come there, and stays.
    pub fn slip(&mut self, tool: &Pose, velocity_m_per_s: &Vector3<f64>) {
        self.model.iter_mut().for_each(|model| model.slip(tool, velocity_m_per_s));
    }

    /// Time passes.
    pub fn advance(&mut self, dt_s: f64) {
        self.left_s = (self.left_s - dt_s).max(0.0);
        self.given_s.iter_mut().for_each(|given_s| *given_s += dt_s);
    }

    /// The force at a pose.
    #[must_use]
    pub fn reaction(&self, pose: &Pose) -> Reaction {
        let mut reaction = self.model.map_or_else(Reaction::default, |model| model.reaction(pose));
        if self.left_s > 0.0 {
            reaction.force_n += self.offset_n * (self.left_s / self.blend_s);
        }
        reaction
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::tests::{at, floor};
    use super::super::model::{Along, Give};
    use super::*;

    #[test]
    fn a_new_model_changes_nothing_at_once_and_everything_after_the_blend() {
        let mut recovery = Recovery::default();
        let tool = at(0.0, -1e-3, 0.0);
        let update = |number, force_n| {
            let model = LocalModel { force_n: Vector3::y() * force_n, ..floor() };
            Update { number, model: Some(model), blend_s: 8e-3, ..Update::default() }
        };
        let force = |recovery: &Recovery| recovery.reaction(&tool).force_n.y;
        recovery.take(&update(1, 1.0), &tool, 0.0);
        assert_eq!(force(&recovery), 0.0, "from nothing");
        recovery.advance(8e-3);
        assert!((force(&recovery) - 1.5).abs() < 1e-12);
        recovery.take(&update(2, 3.0), &tool, 0.0);
        assert!((force(&recovery) - 1.5).abs() < 1e-12);
        recovery.advance(4e-3);
        recovery.take(&update(2, 3.0), &tool, 0.0);
        assert!((force(&recovery) - 2.5).abs() < 1e-12, "half of the way");
        recovery.take(&Update { number: 3, model: None, blend_s: 4e-3, ..Update::default() }, &tool, 0.0);
        assert!((force(&recovery) - 2.5).abs() < 1e-12, "contact is lost without a jump, too");
        recovery.advance(4e-3);
        assert_eq!(force(&recovery), 0.0);
    }

    #[test]
    fn a_cut_begins_when_the_tool_says_so_and_once_though_the_server_is_behind() {
        let mut recovery = Recovery::default();
        let give = Some(Give { at_n: 1.4, left_n: 0.8 });
        let update = |number, give: Option<Give>| {
            let cap_n = give.map_or(0.8, |_| 1.5);
            let force_n = Vector3::y() * give.map_or(0.8, |_| 1.0);
            let model =
                LocalModel { force_n, along: Along::Yields { direction: Vector3::y(), cap_n, give }, ..floor() };
            Update { number, model: Some(model), blend_s: 1e-3, ..Update::default() }
        };
        let [shallow, deep] = [at(0.0, -5e-4, 0.0), at(0.0, -9e-4, 0.0)];
        let force = |recovery: &Recovery, tool: &Pose| recovery.reaction(tool).force_n.y;
        let step = |recovery: &mut Recovery, tool: &Pose| {
            recovery.advance(1e-3);
            let gives = recovery.gives(tool, &Vector3::zeros());
            recovery.slip(tool, &Vector3::zeros());
            gives
        };
        recovery.take(&update(1, give), &shallow, 0.0);
        assert!(!(0..5).any(|_| step(&mut recovery, &shallow)));
        assert!((force(&recovery, &shallow) - 1.25).abs() < 1e-12, "less than what it gives at");
        assert!(step(&mut recovery, &deep) && !step(&mut recovery, &deep));
        assert!((force(&recovery, &deep) - 0.8).abs() < 1e-12);
        // The server answers a pose from 20 ms ago: before the cut.
        (2..6).for_each(|number| {
            recovery.take(&update(number, give), &deep, 0.02);
            assert!(!step(&mut recovery, &deep));
            assert!((force(&recovery, &deep) - 0.8).abs() < 1e-12, "contact {number}");
        });
        // It knows of the cut, and says the same.
        recovery.take(&update(6, None), &deep, 1e-3);
        assert!(!step(&mut recovery, &deep));
        assert!((force(&recovery, &deep) - 0.8).abs() < 1e-12);
        // Another place, whole tissue: what it says counts again.
        recovery.take(&update(7, give), &shallow, 1e-3);
        assert!(!(0..2).any(|_| step(&mut recovery, &shallow)));
        assert!((force(&recovery, &shallow) - 1.25).abs() < 1e-12);
    }
}
