//! A tool in the world, or a part that goes along with one.

use crate::tool::{OPEN, Pose, ToolPath};
use serde::{Deserialize, Serialize};

/// Where a tool is.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Tool {
    pub(super) pose: Option<Pose>,
    /// Pose at the beginning of the step; equal to `pose` where it has just entered.
    pub(super) before: Option<Pose>,
    /// Fraction of their full opening that its jaws take, if it has any, and took at the beginning of the step.
    pub(super) opening: f64,
    pub(super) opening_before: f64,
    pub(super) entered: bool,
}

/// Lifted.
impl Default for Tool {
    fn default() -> Self {
        Self { pose: None, before: None, opening: OPEN, opening_before: OPEN, entered: false }
    }
}

impl Tool {
    pub(super) fn move_to(&mut self, pose: Pose, opening: f64) {
        if self.pose.is_none() {
            return self.enter_at(pose, opening);
        }
        (self.pose, self.opening) = (Some(pose), opening);
    }

    pub(super) fn enter_at(&mut self, pose: Pose, opening: f64) {
        (self.pose, self.before, self.entered) = (Some(pose), Some(pose), true);
        (self.opening, self.opening_before) = (opening, opening);
    }

    /// A part that it carries at `place`, as it goes itself.
    pub(super) fn carrying(&self, place: &Pose) -> Self {
        let at = |pose: &Pose| pose.of_carried(place);
        Self { pose: self.pose.as_ref().map(at), before: self.before.as_ref().map(at), ..*self }
    }

    /// How it moves in the step; `None` while it is lifted.
    pub(super) fn path(&self) -> Option<ToolPath> {
        let (pose, before) = (self.pose?, self.before?);
        let (opening, opening_before) = (self.opening, self.opening_before);
        Some(ToolPath { before, pose, opening_before, opening, entered: self.entered })
    }
}
