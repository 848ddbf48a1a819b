//! From one model to the next without a jump.
//!
//! A new model seldom agrees with the old one where the tool is now. The difference is kept as an offset, so that the
//! force goes on from where it was, and is taken back over the blend time (the "recovery" of Mark et al., SIGGRAPH 96).

use kerf_script::Pose;
use nalgebra::Vector3;

use super::model::{LocalModel, Reaction, Update};

/// The newest model and what is left of the ones before.
#[derive(Clone, Copy, Debug, Default)]
pub struct Recovery {
    number: u64,
    model: Option<LocalModel>,
    /// What the models before it would add, N, at the blend's start.
    offset_n: Vector3<f64>,
    blend_s: f64,
    left_s: f64,
}

impl Recovery {
    /// Takes what the server said, where it is new; `tool` is where the tool is now.
    pub fn take(&mut self, update: &Update, tool: &Pose) {
        if update.number == self.number {
            return;
        }
        let before_n = self.reaction(tool).force_n;
        (self.number, self.model) = (update.number, update.model);
        (self.blend_s, self.left_s) = (update.blend_s, 0.0);
        self.offset_n = before_n - self.reaction(tool).force_n;
        self.left_s = update.blend_s;
    }

    /// Time passes.
    pub fn advance(&mut self, dt_s: f64) {
        self.left_s = (self.left_s - dt_s).max(0.0);
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
        recovery.take(&update(1, 1.0), &tool);
        assert_eq!(force(&recovery), 0.0, "from nothing");
        recovery.advance(8e-3);
        assert!((force(&recovery) - 1.5).abs() < 1e-12);
        recovery.take(&update(2, 3.0), &tool);
        assert!((force(&recovery) - 1.5).abs() < 1e-12);
        recovery.advance(4e-3);
        recovery.take(&update(2, 3.0), &tool);
        assert!((force(&recovery) - 2.5).abs() < 1e-12, "half of the way");
        recovery.take(&Update { number: 3, model: None, blend_s: 4e-3, ..Update::default() }, &tool);
        assert!((force(&recovery) - 2.5).abs() < 1e-12, "contact is lost without a jump, too");
        recovery.advance(4e-3);
        assert_eq!(force(&recovery), 0.0);
    }
}
