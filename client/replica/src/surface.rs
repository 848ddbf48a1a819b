//! The surface of an object as triangles.

use crate::body::Body;

/// What a face of the surface bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Face {
    /// The object's own surface.
    Skin,
    /// Material that a blade laid open.
    Cut,
}

/// A triangle, counter-clockwise seen from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangle {
    /// Indices into [`Surface::positions_m`].
    pub vertices: [u32; 3],
    /// What it bounds.
    pub face: Face,
    /// Place of the region that it bounds, among the object's own material (0) and its regions.
    pub region: u16,
}

/// The surface of an object where it is now.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Vertex positions, m, scene frame, in the order of the vertices' ids.
    pub positions_m: Vec<[f32; 3]>,
    /// Two for each quad, in the order of the quads' ids.
    pub triangles: Vec<Triangle>,
}

impl Surface {
    /// Evaluates an object's surface.
    #[must_use]
    pub fn of(body: &Body) -> Self {
        let ids: Vec<u32> = body.vertices().keys().copied().collect();
        let positions_m = body.vertices().iter().map(|(id, vertex)| body.position_m(*id, vertex)).collect();
        let mut triangles = Vec::with_capacity(2 * body.quads().len());
        for (id, corners) in body.quads() {
            // The other side of the link exists only where a blade parted it.
            let face = if body.quads().contains_key(&(id ^ 1)) { Face::Cut } else { Face::Skin };
            let region = region(corners.map(|id| body.vertices()[&id].material()));
            // Corners exist (see `Body`), so the search always finds them.
            let [a, b, c, d] = corners.map(|id| ids.partition_point(|&other| other < id) as u32);
            triangles.extend([[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face, region }));
        }
        Self { positions_m, triangles }
    }
}

/// The region of a quad, of which the wire tells the materials of its corners: that of most of them, of the first where
/// several are of as many.
fn region(materials: [u32; 4]) -> u16 {
    let count = |material: &u32| materials.iter().filter(|other| *other == material).count();
    let most = materials.iter().map(count).max();
    let found = materials.iter().find(|material| Some(count(material)) == most);
    found.and_then(|material| u16::try_from(*material).ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::region;

    #[test]
    fn a_quad_is_of_the_region_that_most_of_its_corners_have_and_of_the_first_of_as_many() {
        assert_eq!(region([0, 2, 2, 1]), 2);
        assert_eq!(region([1, 0, 0, 1]), 1);
        assert_eq!(region([3, 1, 0, 2]), 3);
        assert_eq!(region([7; 4]), 7);
    }
}
