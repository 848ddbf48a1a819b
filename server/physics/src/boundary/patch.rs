//! The surface in patches, by element: what tissue presses on tissue with, and flanks of blades on walls.

use super::facet::Facets;
use super::solid::Solid;
use crate::Vec3;
use crate::grid::{MaterialPoint, VoxelId};

/// A patch of the surface of one element that faces about one way: of the object's own surface, or of the
/// wall that it has in common with one element across a cut. The two sides of such a wall are made of the
/// same crossings, so that in a closed cut they lie in one another exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePatch {
    /// The element that carries it.
    pub element: u32,
    /// The element on the other side of the cut; `None` on the object's own surface.
    pub across: Option<u32>,
    /// Axis of the normal's largest component and its sign: `2 axis + (1 where positive)`.
    side: u8,
    /// Mean of the crossings by area, carried by one of the element's voxels.
    pub point: MaterialPoint,
    /// Unit outward normal, reference configuration.
    pub normal: Vec3,
    /// Area, m^2, reference configuration.
    pub area_m2: f64,
}

/// What patches are in order by, and known again by: element, element across, side.
pub type PatchKey = (u32, Option<u32>, u8);

impl SurfacePatch {
    /// Its key.
    #[must_use]
    pub fn key(&self) -> PatchKey {
        (self.element, self.across, self.side)
    }
}

/// Sums over the crossings of a patch, by area.
struct Sum {
    key: (Option<u32>, u8),
    voxel: VoxelId,
    position: Vec3,
    normal: Vec3,
    area_m2: f64,
}

/// Sums the facets of the `touched` elements up anew; costs in proportion to them, but for one pass over the patches.
pub(super) fn update(patches: &mut Vec<SurfacePatch>, solid: Solid<'_>, facets: &Facets, touched: &[u32]) {
    patches.retain(|patch| touched.binary_search(&patch.element).is_err());
    touched.iter().for_each(|&element| add_element(patches, solid, facets, element));
    // The sort is made for what stands in ascending runs: here two.
    patches.sort_by_key(SurfacePatch::key);
}

fn add_element(patches: &mut Vec<SurfacePatch>, solid: Solid<'_>, facets: &Facets, element: u32) {
    let mut sums: Vec<Sum> = Vec::new();
    for facet in facets.of_element(solid, element) {
        let key = (facet.beyond.map(|voxel| solid.owner(voxel)), side_of(&facet.outward));
        let sum = match sums.iter_mut().position(|sum| sum.key == key) {
            Some(found) => &mut sums[found],
            None => {
                let (position, normal) = (Vec3::zeros(), Vec3::zeros());
                sums.push(Sum { key, voxel: facet.voxel, position, normal, area_m2: 0.0 });
                sums.last_mut().expect("one was pushed")
            }
        };
        sum.position += facet.at_m * facet.area_m2;
        sum.normal += facet.outward * facet.area_m2;
        sum.area_m2 += facet.area_m2;
    }
    sums.sort_unstable_by_key(|sum| sum.key);
    patches.extend(sums.iter().filter_map(|sum| {
        Some(SurfacePatch {
            element,
            across: sum.key.0,
            side: sum.key.1,
            point: MaterialPoint { position_m: sum.position / sum.area_m2, voxel: sum.voxel },
            normal: sum.normal.try_normalize(f64::MIN_POSITIVE)?,
            area_m2: sum.area_m2,
        })
    }));
}

fn side_of(normal: &Vec3) -> u8 {
    let axis = normal.iamax();
    2 * axis as u8 + u8::from(normal[axis] > 0.0)
}
