//! A body's surface in shares: what tissue presses on tissue with.

use crate::Vec3;
use crate::body::{Body, Facet, MaterialPoint, TopologyChange};
use crate::grid::{LinkId, VoxelId};

/// A share of the surface of one element that looks about one way: of the object's own surface, or of the
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

/// The surface of a body, by element.
#[derive(Clone, Debug, Default)]
pub struct SurfacePatches {
    patches: Vec<SurfacePatch>,
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

impl SurfacePatches {
    /// The whole surface of a body.
    #[must_use]
    pub fn of(body: &Body) -> Self {
        let mut surface = Self::default();
        (0..body.base().elements.len()).for_each(|element| surface.add_element(body, element as u32));
        surface
    }

    /// The patches, by element.
    #[must_use]
    pub fn as_slice(&self) -> &[SurfacePatch] {
        &self.patches
    }

    /// Index of the patch that is the same share of the same element's surface, if there is any.
    #[must_use]
    pub fn find(&self, patch: &SurfacePatch) -> Option<usize> {
        self.patches.binary_search_by_key(&patch.key(), SurfacePatch::key).ok()
    }

    /// Whether a cut runs between elements.
    #[must_use]
    pub fn has_walls(&self) -> bool {
        self.patches.iter().any(|p| p.across.is_some())
    }

    /// Takes what `parted` and `change` touched, and what faces it across cuts; costs in proportion to
    /// that, but for one pass over the patches.
    pub fn update(&mut self, body: &Body, parted: &[LinkId], change: &TopologyChange) {
        let mut touched: Vec<u32> = change.elements.iter().copied().chain(body.elements_at(parted)).collect();
        let mut facing = Vec::new();
        for &element in &touched {
            facing.extend(body.facets_of(element as usize).filter_map(|facet| facet.across));
        }
        touched.append(&mut facing);
        touched.sort_unstable();
        touched.dedup();
        self.patches.retain(|p| touched.binary_search(&p.element).is_err());
        touched.iter().for_each(|&element| self.add_element(body, element));
        self.patches.sort_unstable_by_key(SurfacePatch::key);
    }

    fn add_element(&mut self, body: &Body, element: u32) {
        let mut sums: Vec<Sum> = Vec::new();
        for Facet { voxel, across, at_m, outward, area_m2, .. } in body.facets_of(element as usize) {
            let key = (across, side_of(&outward));
            let sum = match sums.iter_mut().position(|sum| sum.key == key) {
                Some(found) => &mut sums[found],
                None => {
                    sums.push(Sum { key, voxel, position: Vec3::zeros(), normal: Vec3::zeros(), area_m2: 0.0 });
                    sums.last_mut().expect("one was pushed")
                }
            };
            sum.position += at_m * area_m2;
            sum.normal += outward * area_m2;
            sum.area_m2 += area_m2;
        }
        sums.sort_unstable_by_key(|sum| sum.key);
        self.patches.extend(sums.iter().filter_map(|sum| {
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
}

fn side_of(normal: &Vec3) -> u8 {
    let axis = normal.iamax();
    2 * axis as u8 + u8::from(normal[axis] > 0.0)
}
