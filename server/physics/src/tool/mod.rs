//! Tools: their pose and their shape.

pub mod blade;
pub mod edge;
pub mod flanks;

use crate::{Quat, Vec3};

/// Pose of a tool in the scene frame. Tool frame: origin = reference point = middle of the edge,
/// +x along the edge, -y the cutting direction (spine to edge), +z the blade's normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Reference point, m.
    pub position_m: Vec3,
    /// Rotation from the tool frame to the scene frame.
    pub orientation: Quat,
}

impl Default for Pose {
    fn default() -> Self {
        Self { position_m: Vec3::zeros(), orientation: Quat::identity() }
    }
}

impl Pose {
    /// Scene position of a point given in the tool frame, m.
    #[must_use]
    pub fn transform(&self, local_m: &Vec3) -> Vec3 {
        self.position_m + self.orientation * local_m
    }
}
