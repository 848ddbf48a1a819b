//! A blade: an edge of any shape and the two flanks behind it.

use super::edge::{Edge, EdgeEnd, EdgeSegment};
use super::flanks::{Flanks, Thickness};
use super::pose::Pose;
use crate::Vec3;
use crate::math::Aabb;
use crate::scene::{BladeDesc, SceneError};
use serde::{Deserialize, Serialize};

/// Shape of a blade in the tool frame. The flanks are the surface that the edge sweeps in +y.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Blade {
    /// Its edge.
    pub edge: Edge,
    /// The surface behind the edge.
    pub flanks: Flanks,
    /// Half-width of the edge, m.
    pub edge_half_width_m: f64,
    /// Coefficient of the friction on the flanks.
    pub flank_friction: Option<f64>,
    /// Whether the ends of the edge cut too, up to the spine.
    pub sharp_ends: bool,
    /// Factor on the stiffness of its contacts that is a penalty: 1, see [`crate::verification::scale_blade_penalties`].
    pub penalty_factor: f64,
}

impl Blade {
    /// From its description.
    ///
    /// # Errors
    /// The points of its edge are still in a file.
    pub fn new(desc: &BladeDesc) -> Result<Self, SceneError> {
        let edge = Edge::through(desc.edge.points_m(desc.width_m)?);
        let thickness = Thickness::new(desc.thickness_m, desc.wedge_angle_rad);
        let flanks = Flanks::behind(&edge, desc.height_m, thickness);
        let BladeDesc { edge_half_width_m, flank_friction, sharp_ends, .. } = *desc;
        Ok(Self { edge, flanks, edge_half_width_m, flank_friction, sharp_ends, penalty_factor: 1.0 })
    }

    /// Boxes around what the parts of its outline sweep from one pose to another, scene frame: of the first end, the edge
    /// and the last end.
    pub(crate) fn swept_boxes(&self, poses: [&Pose; 2], margin_m: f64) -> [Aabb; 3] {
        let around = |points_m: &[Vec3]| {
            Aabb::around(points_m.iter().flat_map(|at| poses.map(|pose| pose.transform(at)))).grown(margin_m)
        };
        let end = |at: Option<&Vec3>| match at {
            Some(at) if self.sharp_ends => around(&[*at, at + Vec3::y() * self.flanks.height_m()]),
            _ => around(&[]),
        };
        let edge_m = self.edge.points_m();
        [end(edge_m.first()), around(edge_m), end(edge_m.last())]
    }

    /// What of its outline cuts, from one end to the other: segments no longer than `longest_m`, and how many of them are
    /// of the first end and of the edge.
    pub(crate) fn outline(&self, longest_m: f64) -> (Vec<EdgeSegment>, [usize; 2]) {
        let edge = self.edge.segments(longest_m);
        if !self.sharp_ends {
            let count = edge.len();
            return (edge, [0, count]);
        }
        let end = |end| self.edge.end_segments(end, self.flanks.height_m(), longest_m);
        let first = end(EdgeEnd::First);
        let counts = [first.len(), edge.len()];
        (first.into_iter().chain(edge).chain(end(EdgeEnd::Last)).collect(), counts)
    }
}
