//! The view that a world keeps itself, for callers without one.

use crate::surface::delta::TopologyPatch;
use crate::view::{Frame, View};

/// A view that the world keeps itself: from when somebody asks for a keyframe until the surface is forgotten.
pub(super) struct OwnView {
    pub(super) view: View,
    pub(super) frame: Frame,
    /// What the last step changed in the structure.
    pub(super) patch: Option<TopologyPatch>,
    /// The surfaces are adapted to where the tools are now.
    pub(super) is_adapted: bool,
}

impl OwnView {
    /// Forgets what the last step changed, and where the surface was adapted to it.
    pub(super) fn begin_step(&mut self) {
        self.patch = None;
        self.is_adapted = false;
        self.view.clear_adaptation();
    }
}
