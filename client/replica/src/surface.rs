//! The surface of an object as triangles.

use crate::body::Body;

/// The surface of one object where it is now.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Vertex positions, m, scene frame, in the order of the vertices' ids.
    pub positions_m: Vec<[f32; 3]>,
    /// Indices into `positions_m`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// Evaluates an object's surface.
    #[must_use]
    pub fn of(body: &Body) -> Self {
        let ids: Vec<u32> = body.vertices().keys().copied().collect();
        let positions_m = body.vertices().values().map(|vertex| body.position_m(vertex)).collect();
        let mut triangles = Vec::with_capacity(2 * body.quads().len());
        for corners in body.quads().values() {
            // Corners exist (see `Body`), so the search always finds them.
            let [a, b, c, d] = corners.map(|id| ids.partition_point(|&other| other < id) as u32);
            triangles.push([a, b, c]);
            triangles.push([a, c, d]);
        }
        Self { positions_m, triangles }
    }
}
