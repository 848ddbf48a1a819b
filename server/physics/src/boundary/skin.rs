//! The surface in patches as fine as its elements resolve and a tool's radius asks: what a smooth tool presses on.

use super::facet::{Facet, Facets};
use super::solid::Solid;
use crate::Vec3;
use crate::grid::MaterialPoint;

/// A patch of the surface: at most a sixteenth of an element's face, so that a dent that is half as wide as that still
/// has some twenty points, and at most half a radius wide, so that nothing slips between points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinPatch {
    /// The element that carries it.
    pub element: u32,
    /// Side of the voxel at its point that it is part of: with that voxel, what it is known by.
    pub side: u8,
    /// Mean of its crossings by area.
    pub point: MaterialPoint,
    /// Mean outward normal by area, reference configuration; not of unit length.
    pub normal: Vec3,
    /// Area, m^2, reference configuration.
    pub area_m2: f64,
}

/// The surface of a body, by element: its own, and that of cuts that run between elements.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    patches: Vec<SkinPatch>,
    /// Widest patch, voxels.
    most_voxels: i32,
}

impl Skin {
    /// The whole surface of a body, for a tool of this radius.
    pub(super) fn of(solid: Solid<'_>, facets: &Facets, radius_m: f64) -> Self {
        let most_voxels = (0.5 * radius_m / solid.grid.voxel_size_m()).clamp(1.0, f64::from(u16::MAX)) as i32;
        Self { patches: Vec::new(), most_voxels }.made_anew(solid, facets)
    }

    /// The whole surface of a body, as fine as this one.
    pub(super) fn made_anew(&self, solid: Solid<'_>, facets: &Facets) -> Self {
        let mut skin = Self { patches: Vec::new(), most_voxels: self.most_voxels };
        (0..solid.level.elements.len() as u32).for_each(|element| skin.add_element(solid, facets, element));
        skin
    }

    /// Number of patches.
    #[must_use]
    pub fn len(&self) -> usize {
        self.patches.len()
    }

    /// The patches of an element.
    pub fn of_element(&self, element: u32) -> impl Iterator<Item = &SkinPatch> {
        let first = self.patches.partition_point(|p| p.element < element);
        self.patches[first..].iter().take_while(move |p| p.element == element)
    }

    /// Takes the surface of the `touched` elements anew.
    pub(super) fn update(&mut self, solid: Solid<'_>, facets: &Facets, touched: &[u32]) {
        self.patches.retain(|p| touched.binary_search(&p.element).is_err());
        touched.iter().for_each(|&element| self.add_element(solid, facets, element));
        // Stable: within an element the patches keep their order.
        self.patches.sort_by_key(|p| p.element);
    }

    fn add_element(&mut self, solid: Solid<'_>, facets: &Facets, element: u32) {
        let edge_voxels = solid.level.elements[element as usize].size << solid.level.exponent;
        let wide = (edge_voxels >> 2).clamp(1, self.most_voxels);
        let key = |facet: &Facet| (facet.side, facet.cell.map(|c| c / wide));
        let mut facets: Vec<Facet> = facets.of_element(solid, element).collect();
        facets.sort_by_key(|facet| key(facet));
        for patch in facets.chunk_by(|a, b| key(a) == key(b)) {
            let area_m2: f64 = patch.iter().map(|facet| facet.area_m2).sum();
            let mean = |of: fn(&Facet) -> Vec3| patch.iter().map(|f| of(f) * (f.area_m2 / area_m2)).sum::<Vec3>();
            let point = MaterialPoint { position_m: mean(|f| f.at_m), voxel: patch[0].voxel };
            self.patches.push(SkinPatch { element, side: patch[0].side, point, normal: mean(|f| f.outward), area_m2 });
        }
    }
}
