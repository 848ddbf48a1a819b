//! A blade: an edge of any shape and the two flanks behind it.

use super::edge::Edge;
use super::flanks::{Flanks, Thickness};
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
    /// Factor on the stiffness of its contacts that is a penalty: 1, see [`crate::World::scale_blade_penalties`].
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
        let BladeDesc { edge_half_width_m, flank_friction, .. } = *desc;
        Ok(Self { edge, flanks, edge_half_width_m, flank_friction, penalty_factor: 1.0 })
    }
}
