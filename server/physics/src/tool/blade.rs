//! A straight blade: an edge of finite width and two flanks behind it.

use super::Pose;
use crate::Vec3;
use crate::scene::BladeDesc;

/// Shape of a straight blade in the tool frame: the edge on the x axis, the flanks above it in +y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blade {
    /// Length of the edge, m.
    pub width_m: f64,
    /// Height of the flanks, m.
    pub height_m: f64,
    /// Half-width of the edge, m.
    pub edge_half_width_m: f64,
    /// Thickness behind the edge, m.
    pub thickness_m: f64,
}

impl From<&BladeDesc> for Blade {
    fn from(desc: &BladeDesc) -> Self {
        Self {
            width_m: desc.width_m,
            height_m: desc.height_m,
            edge_half_width_m: desc.edge_half_width_m,
            thickness_m: desc.thickness_m,
        }
    }
}

/// Directions of a blade in the scene frame.
#[derive(Clone, Copy, Debug)]
pub struct BladeFrame {
    /// Along the edge.
    pub along: Vec3,
    /// The cutting direction, spine to edge.
    pub forward: Vec3,
    /// Normal of the flanks.
    pub normal: Vec3,
}

impl BladeFrame {
    /// Of a tool at `pose`.
    #[must_use]
    pub fn of(pose: &Pose) -> Self {
        Self {
            along: pose.orientation * Vec3::x(),
            forward: pose.orientation * -Vec3::y(),
            normal: pose.orientation * Vec3::z(),
        }
    }
}

impl Blade {
    /// Number of edge samples no farther apart than `spacing_m`.
    #[must_use]
    pub fn sample_count(&self, spacing_m: f64) -> usize {
        (self.width_m / spacing_m).ceil().max(1.0) as usize
    }

    /// Sample `index` of `count`, tool frame: the middle of its share of the edge.
    #[must_use]
    pub fn sample(&self, index: usize, count: usize) -> Vec3 {
        Vec3::new(((index as f64 + 0.5) / count as f64 - 0.5) * self.width_m, 0.0, 0.0)
    }
}
