//! Narrow phase: where a point of a tool is in the material, by signed distance in the reference
//! configuration.

use super::broad::SpatialHash;
use crate::Vec3;
use crate::body::Body;
use crate::grid::MaterialPoint;

/// A point within this fraction of an element's edge of its boundary is in it, so that rounding does not put
/// a point between two elements into neither. Rounding is some 1e-13 of an edge.
const BOUNDARY: f64 = 1e-9;

/// The material point that lies at a scene position, if it is inside the tissue: in a filled voxel of
/// the element that maps it there, and behind the object's own surface.
#[must_use]
pub fn locate(body: &Body, hash: &SpatialHash, point_m: &Vec3) -> Option<MaterialPoint> {
    hash.around(point_m).find_map(|element| {
        let position_m = body.invert_map(element as usize, point_m)?;
        let middle_m = body.rest_centre_m(element as usize);
        let drawn_in_m = position_m + (middle_m - position_m) * BOUNDARY;
        let voxel = body.state.grid.voxel_at(body.state.grid.cell_of(&drawn_in_m))?;
        let inside = body.element_of(voxel) == element as usize && body.state.grid.signed_distance_m(&position_m) < 0.0;
        inside.then_some(MaterialPoint { position_m, voxel })
    })
}
