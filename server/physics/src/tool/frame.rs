//! The directions of a blade at a point of its edge.

use crate::{Quat, Vec3};
use serde::{Deserialize, Serialize};

/// Directions of a blade at a point of its edge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BladeFrame {
    /// Along the edge.
    pub along: Vec3,
    /// The cutting direction, spine to edge, as far as it is across the edge.
    pub forward: Vec3,
    /// Normal of the flanks.
    pub normal: Vec3,
}

impl BladeFrame {
    /// In the tool frame, where the edge has the unit tangent `along`; the cutting direction is -y.
    #[must_use]
    pub(crate) fn of_tangent(along: Vec3) -> Self {
        let down = -Vec3::y();
        let forward = (down - along * along.dot(&down)).normalize();
        Self { along, forward, normal: forward.cross(&along) }
    }

    /// The same directions in the scene frame, of a tool with this orientation.
    #[must_use]
    pub fn turned(&self, orientation: &Quat) -> Self {
        Self { along: orientation * self.along, forward: orientation * self.forward, normal: orientation * self.normal }
    }
}
