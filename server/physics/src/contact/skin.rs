//! The surface of a body in patches as fine as its elements resolve and a tool's radius asks: what a smooth
//! tool presses on.

use crate::Vec3;
use crate::body::{Body, Facet, MaterialPoint, TopologyChange};
use crate::grid::{Grid, Ijk, LinkId};

/// A share of the surface: at most a quarter of an element's face, as many points as a face has corners
/// integrate its pressure exactly, and at most half a radius wide, so that nothing slips between points.
#[derive(Clone, Copy, Debug)]
pub struct SkinPatch {
    /// The element that carries it.
    pub element: u32,
    /// Mean of its crossings by area.
    pub point: MaterialPoint,
    /// Mean outward normal by area, reference configuration; not of unit length.
    pub normal: Vec3,
    /// Area, m^2, reference configuration.
    pub area_m2: f64,
}

/// The surface of a body, by element: its own, and that of cuts that run between elements.
#[derive(Clone)]
pub struct Skin {
    patches: Vec<SkinPatch>,
    /// Widest patch, voxels.
    most_voxels: i32,
}

impl Skin {
    /// The whole surface of a body, for a tool of this radius.
    #[must_use]
    pub fn new(body: &Body, radius_m: f64) -> Self {
        let most_voxels = (0.5 * radius_m / body.grid.voxel_size_m()).clamp(1.0, f64::from(u16::MAX)) as i32;
        let mut skin = Self { patches: Vec::new(), most_voxels };
        (0..body.base().elements.len()).for_each(|element| skin.add_element(body, element as u32));
        skin
    }

    /// Number of patches.
    #[must_use]
    pub fn len(&self) -> usize {
        self.patches.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.patches.is_empty()
    }

    /// The patches of an element.
    pub fn of_element(&self, element: u32) -> impl Iterator<Item = &SkinPatch> {
        let first = self.patches.partition_point(|p| p.element < element);
        self.patches[first..].iter().take_while(move |p| p.element == element)
    }

    /// Takes the surface of what `parted` and `change` touched and of what lies across the cuts there.
    pub fn update(&mut self, body: &Body, parted: &[LinkId], change: &TopologyChange) {
        let owner = |cell: Ijk| body.grid.voxel_at(cell).map(|voxel| body.element_of(voxel) as u32);
        let mut touched: Vec<u32> = change.elements.iter().copied().chain(body.elements_at(parted)).collect();
        let voxels = touched.iter().flat_map(|element| body.voxels_of(*element as usize));
        let beside = voxels.flat_map(|voxel| Grid::links_of(body.grid.voxels()[voxel.index()].ijk));
        let across: Vec<u32> = beside.filter_map(|(_, other)| owner(other)).collect();
        touched.extend(across);
        touched.sort_unstable();
        touched.dedup();
        self.patches.retain(|p| touched.binary_search(&p.element).is_err());
        touched.iter().for_each(|&element| self.add_element(body, element));
        // Stable: within an element the patches keep their order.
        self.patches.sort_by_key(|p| p.element);
    }

    fn add_element(&mut self, body: &Body, element: u32) {
        let wide = (1i32 << body.element_level(element as usize) >> 1).clamp(1, self.most_voxels);
        let key = |facet: &Facet| (facet.side, facet.cell.map(|c| c / wide));
        let mut facets: Vec<Facet> = body.facets_of(element as usize).collect();
        facets.sort_by_key(key);
        for share in facets.chunk_by(|a, b| key(a) == key(b)) {
            let area_m2: f64 = share.iter().map(|facet| facet.area_m2).sum();
            let mean = |of: fn(&Facet) -> Vec3| share.iter().map(|f| of(f) * (f.area_m2 / area_m2)).sum::<Vec3>();
            let point = MaterialPoint { position_m: mean(|f| f.at_m), voxel: share[0].voxel };
            self.patches.push(SkinPatch { element, point, normal: mean(|f| f.outward), area_m2 });
        }
    }
}
