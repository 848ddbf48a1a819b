//! Narrow phase: where a point of a tool is in the material, by signed distance in the reference
//! configuration.

use super::broad::SpatialHash;
use crate::Vec3;
use crate::body::{Body, MaterialPoint};

/// The material point that lies at a scene position, if it is inside the tissue: in a filled voxel of
/// the element that maps it there, and behind the object's own surface.
#[must_use]
pub fn locate(body: &Body, hash: &SpatialHash, point_m: &Vec3) -> Option<MaterialPoint> {
    hash.around(point_m).find_map(|element| {
        let position_m = body.invert_map(element as usize, point_m)?;
        let voxel = body.grid.voxel_at(body.grid.cell_of(&position_m))?;
        let inside = body.element_of(voxel) == element as usize && body.grid.signed_distance_m(&position_m) < 0.0;
        inside.then_some(MaterialPoint { position_m, voxel })
    })
}
