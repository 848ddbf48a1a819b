//! Where an element ends: the faces of its voxels on the body's own surface and at cuts.

use super::solid::Solid;
use crate::Vec3;
use crate::fem::composite::shape_functions;
use crate::grid::levels::LevelChange;
use crate::grid::{Crossing, Grid, Ijk, Link, LinkId, VoxelId};
use std::sync::OnceLock;

/// A voxel's face on the surface or at a cut, reference configuration.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    /// Voxel that it belongs to.
    pub(super) voxel: VoxelId,
    /// The voxel's cell.
    pub(super) cell: Ijk,
    /// Its side, as in [`Grid::links_of`].
    pub(super) side: u8,
    /// The voxel on the other side of the cut; `None` on the object's own surface.
    pub(super) beyond: Option<VoxelId>,
    /// Where the surface crosses the link, m.
    pub(super) at_m: Vec3,
    /// Unit normal out of the voxel.
    pub(super) outward: Vec3,
    /// Area of the surface within the face's column, m^2.
    pub(super) area_m2: f64,
}

/// A facet as it is kept: what the rest follows from.
#[derive(Clone, Debug)]
struct Face {
    voxel: VoxelId,
    side: u8,
    is_cut: bool,
    crossing: Crossing,
}

impl Face {
    /// The face at a link of a voxel, if the surface or a cut crosses it.
    fn at(grid: &Grid, cell: Ijk, side: u8, link: LinkId) -> Option<Self> {
        let voxel = grid.voxel_at(cell)?;
        let (crossing, is_cut) = match grid.link(link) {
            Link::Boundary(crossing) => (crossing, false),
            Link::Parted(crossing) => (crossing, true),
            Link::Intact | Link::Outside => return None,
        };
        // None that the surface runs along.
        (crossing.normal[link.axis as usize].abs() > 0.0).then_some(Self { voxel, side, is_cut, crossing })
    }

    fn facet(&self, grid: &Grid) -> Facet {
        let Self { voxel, side, is_cut, crossing } = *self;
        let cell = grid.voxels()[voxel.index()].ijk;
        let (link, other) = Grid::link_of(cell, side);
        let sign = if is_cut && side % 2 == 0 { -1.0 } else { 1.0 };
        let (axis, h) = (link.axis as usize, grid.voxel_size_m());
        let mut at_m = grid.centre_m(link.cell);
        at_m[axis] += f64::from(crossing.t) * h;
        let outward = Vec3::from(crossing.normal.map(f64::from)) * sign;
        let beyond = if is_cut { grid.voxel_at(other) } else { None };
        Facet { voxel, cell, side, beyond, at_m, outward, area_m2: h * h * outward[axis].abs() }
    }

    /// Those of an element are in the order of its voxels, then of their sides.
    fn key(&self) -> (VoxelId, u8) {
        (self.voxel, self.side)
    }
}

/// The facets of one element.
#[derive(Clone, Debug, Default)]
struct OfElement {
    /// Also those at links that were parted within the element.
    faces: Vec<Face>,
    /// Made when first asked for.
    moments_m2: OnceLock<Box<[Vec3; 8]>>,
}

/// The facets of a body, by element.
#[derive(Clone, Debug, Default)]
pub(super) struct Facets(Vec<OfElement>);

impl Facets {
    /// Those there are.
    pub(super) fn of(solid: Solid<'_>) -> Self {
        let mut facets = Self(vec![OfElement::default(); solid.level.elements.len()]);
        for voxel in solid.grid.voxels() {
            (0..).zip(Grid::links_of(voxel.ijk)).for_each(|(side, (link, _))| facets.add(solid, voxel.ijk, side, link));
        }
        for OfElement { faces, .. } in &mut facets.0 {
            faces.sort_unstable_by_key(Face::key);
            faces.shrink_to_fit();
        }
        facets
    }

    fn add(&mut self, solid: Solid<'_>, cell: Ijk, side: u8, link: LinkId) {
        self.take(solid, Face::at(solid.grid, cell, side, link));
    }

    fn take(&mut self, solid: Solid<'_>, faces: impl IntoIterator<Item = Face>) {
        for face in faces {
            self.0[solid.owner(face.voxel) as usize].faces.push(face);
        }
    }

    /// Takes what came up as links were `parted` and elements changed. Returns the elements whose facets changed and
    /// those that face them, ascending.
    pub(super) fn follow(&mut self, solid: Solid<'_>, parted: &[LinkId], change: &LevelChange) -> Vec<u32> {
        self.0.resize_with(solid.level.elements.len(), OfElement::default);
        for &(_, from) in &change.split_elements {
            let faces = std::mem::take(&mut self.0[from as usize].faces);
            self.take(solid, faces);
        }
        for &link in parted {
            self.add(solid, link.cell, 2 * link.axis + 1, link);
            self.add(solid, link.upper(), 2 * link.axis, link);
        }
        let ends = parted.iter().flat_map(|link| [link.cell, link.upper()]);
        let at_ends = ends.filter_map(|cell| solid.grid.voxel_at(cell)).map(|voxel| solid.owner(voxel));
        let mut touched = sorted(at_ends.chain(change.elements()).collect());
        let mut facing = Vec::new();
        for &element in &touched {
            let OfElement { faces, moments_m2 } = &mut self.0[element as usize];
            faces.sort_unstable_by_key(Face::key);
            // Whatever was asked for before: moments follow from the facets.
            *moments_m2 = OnceLock::new();
            let beyond = faces.iter().filter(|face| face.is_cut).filter_map(|face| face.facet(solid.grid).beyond);
            facing.extend(beyond.map(|voxel| solid.owner(voxel)));
        }
        touched.append(&mut facing);
        sorted(touched)
    }

    /// The facets of an element. A wall whose two sides belong to the element is left out: it is still in one
    /// piece.
    pub(super) fn of_element<'a>(&'a self, solid: Solid<'a>, element: u32) -> impl Iterator<Item = Facet> + 'a {
        let facets = self.0[element as usize].faces.iter().map(move |face| face.facet(solid.grid));
        facets.filter(move |facet| facet.beyond.is_none_or(|voxel| solid.owner(voxel) != element))
    }

    /// `int N_a n dA` over the facets of an element, n out of it, by corner a, m^2.
    pub(super) fn moments_m2(&self, solid: Solid<'_>, element: usize) -> &[Vec3; 8] {
        self.0[element].moments_m2.get_or_init(|| {
            let mut moments_m2 = Box::new([Vec3::zeros(); 8]);
            for facet in self.of_element(solid, element as u32) {
                let n = shape_functions(solid.local_coordinates(element, &facet.at_m));
                moments_m2.iter_mut().zip(n).for_each(|(moment, n)| *moment += facet.outward * (facet.area_m2 * n));
            }
            moments_m2
        })
    }
}

fn sorted(mut elements: Vec<u32>) -> Vec<u32> {
    elements.sort_unstable();
    elements.dedup();
    elements
}
