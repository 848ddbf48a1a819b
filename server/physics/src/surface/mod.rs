//! The dual-contoured surface: one vertex per connected component of the voxels of a dual cell,
//! one quad per boundary link, two opposite quads per parted link.
//!
//! A dual cell is the cube whose eight corners are the centres of 2x2x2 cells; it is named by its
//! lowest corner. The inside corners, joined by the intact ones of its twelve links, fall into
//! components; each component with a crossing has a vertex. Around a link lie four dual cells, and
//! the quad of one of its ends joins, in each of them, the vertex of the component that end is in.
//! Vertices of a cut's rim and beside it may leave their dual cells (`rims`).
//!
//! Invariants:
//! - Ids are a pure function of the lattice, so that a stream does not depend on when a viewer
//!   joined, and a surface rebuilt piece by piece equals one built at once.
//! - Every directed edge is cancelled by its opposite. In a face shared by two dual cells the links
//!   are common to both, so a run of corners joined within the face is in one component on either
//!   side; the run ends at two crossings, whose quads pass the face in opposite directions.
//! - Ids only appear. A crossing never goes away, and parting a component leaves its lowest corner
//!   in a component that keeps the number and gains a crossing.
//!
//! Deliberately absent: normals (a viewer computes them from the deformed quads), adaptation of
//! the grid, which stays as it was voxelized, and that of the surface to a blade, which stands beside it
//! (`adapt`).

pub(crate) mod adapt;
mod crossing;
pub mod delta;
mod dual_contouring;
pub mod hash;
mod lattice;
mod qef;
mod rims;
#[cfg(test)]
mod test_solids;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use crate::Vec3;
use crate::grid::{Grid, Link, LinkId, VoxelId};
use dual_contouring::{Components, Contoured};
use lattice::Lattice;
use rims::Mover;

/// Id of a surface vertex: `dual cell index * 8 + component`. Cells of the box `-1..dims + 1` are
/// numbered x fastest, a dual cell has the number of its lowest corner, and a component that of its
/// lowest corner among the eight (corner `c` at `(c & 1, c >> 1 & 1, c >> 2)`).
pub type VertexId = u32;
const VERTICES_PER_CELL: u32 = 8;
/// Id of a quad: `(lower cell index of its link * 3 + axis) * 2 + side`; side 0 bounds the material
/// at the link's lower end, side 1 that at its upper end.
pub type QuadId = u32;
const QUADS_PER_CELL: u32 = 6;

/// A vertex of the surface, in the reference configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceVertex {
    /// Reference position, m.
    pub position_m: [f32; 3],
    /// The voxel of its component that is nearest to it in its dual cell: the vertex moves with that voxel's element.
    pub voxel: VoxelId,
}

/// Four vertices, counter-clockwise seen from outside the material.
pub type Quad = [VertexId; 4];

/// What [`Surface::rebuild_touched`] changed; an id occurs at most once in each list, ascending.
/// Nothing is ever taken away, see the invariants above.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SurfaceChange {
    /// Vertices that are new or have moved or are bound to another voxel or element.
    pub upserted_vertices: Vec<VertexId>,
    /// Quads that are new or join other vertices.
    pub upserted_quads: Vec<QuadId>,
}

/// The vertices that an update has touched.
#[derive(Default)]
struct Touched {
    /// Those that there were, as they were before it.
    before: BTreeMap<VertexId, SurfaceVertex>,
    new: Vec<VertexId>,
}

/// The surface of one object.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    lattice: Lattice,
    /// Components of each dual cell with a crossing: of a fine lattice's cells few have one.
    components: BTreeMap<u32, Components>,
    vertices: BTreeMap<VertexId, SurfaceVertex>,
    quads: BTreeMap<QuadId, Quad>,
    /// Those of the vertices that leave their dual cells.
    movers: BTreeMap<VertexId, Mover>,
}

impl Surface {
    /// The surface of a grid as it stands.
    #[must_use]
    pub fn build(grid: &Grid) -> Self {
        let lattice = Lattice::new(grid);
        let mut surface = Self {
            lattice,
            components: BTreeMap::new(),
            vertices: BTreeMap::new(),
            quads: BTreeMap::new(),
            movers: BTreeMap::new(),
        };
        surface.rebuild_touched(grid, &crossed_links(grid), &[]);
        surface
    }

    /// Volume that it encloses in the reference configuration, m³.
    #[must_use]
    pub fn volume_m3(&self) -> f64 {
        let at = |id| point(self.vertices[&id].position_m);
        let triangles = self.quads.values().flat_map(|quad| triangulate(*quad));
        triangles.map(|ids| ids.map(at)).map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum()
    }

    /// Brings the surface up to date after the links `parted` were parted and the composite element
    /// of the voxels `rebound` was replaced. Costs in proportion to these lists, whose order and
    /// repetitions do not matter.
    pub(crate) fn rebuild_touched(&mut self, grid: &Grid, parted: &[LinkId], rebound: &[VoxelId]) -> SurfaceChange {
        let (mut change, mut touched) = (SurfaceChange::default(), Touched::default());
        let mut links: Vec<u32> = parted.iter().map(|link| self.lattice.link_index(*link)).collect();
        let mut dual_cells: Vec<u32> = Vec::with_capacity(4 * parted.len());
        dual_cells.extend(parted.iter().flat_map(|link| self.lattice.around(*link).map(|(dual_cell, _)| dual_cell)));
        sort_dedup(&mut dual_cells);
        for dual_cell in dual_cells {
            if self.contour(grid, dual_cell, &mut touched) {
                links.extend(self.lattice.links_of(dual_cell));
            }
        }
        sort_dedup(&mut links);
        for link in &links {
            self.join(grid, self.lattice.link(*link), &mut change);
        }
        self.settle_rims(grid, &links, &mut touched);
        let has_changed = |(id, before): (VertexId, SurfaceVertex)| (self.vertex(id) != Some(&before)).then_some(id);
        change.upserted_vertices.extend(touched.before.into_iter().filter_map(has_changed));
        change.upserted_vertices.extend(touched.new);
        self.report_rebound(grid, rebound, &mut change);
        sort_dedup(&mut change.upserted_vertices);
        change
    }

    /// Computes a dual cell's vertices anew. Returns whether quads that stood around it before may join other vertices
    /// now, or be split otherwise, or have other rims.
    fn contour(&mut self, grid: &Grid, dual_cell: u32, touched: &mut Touched) -> bool {
        let contoured = dual_contouring::contour(grid, self.lattice.cell(dual_cell));
        let mut has_changed = false;
        for (component, vertex) in contoured.vertices.into_iter().enumerate() {
            let Some(Contoured { mut vertex, wanted_m }) = vertex else { continue };
            let id = dual_cell * 8 + component as u32;
            let vertex_before = self.vertices.get(&id).copied();
            match vertex_before {
                Some(before) => _ = touched.before.entry(id).or_insert(before),
                None => touched.new.push(id),
            }
            let mover_before = self.movers.remove(&id);
            let from_before_m =
                vertex_before.map(|before| mover_before.map_or(before.position_m, |mover| mover.from_m));
            let wanted_before_m = mover_before.and_then(|mover| mover.wanted_m);
            let is_as_before = (from_before_m, wanted_before_m) == (Some(vertex.position_m), wanted_m);
            has_changed |= vertex_before.is_some() && !is_as_before || wanted_m != wanted_before_m;
            let mover = match mover_before {
                Some(mover) if is_as_before => Some(mover),
                _ => wanted_m.map(|_| Mover::new(vertex.position_m, wanted_m)),
            };
            if let Some(mover) = mover {
                vertex.position_m = mover.position_m();
                self.movers.insert(id, mover);
            }
            self.vertices.insert(id, vertex);
        }
        let components_before = self.components.insert(dual_cell, contoured.components);
        has_changed || components_before.is_some_and(|before| before != contoured.components)
    }

    /// Reports the vertices that move with one of these voxels.
    fn report_rebound(&self, grid: &Grid, rebound: &[VoxelId], change: &mut SurfaceChange) {
        for voxel in rebound {
            let dual_cells = self.lattice.dual_cells_of(grid.voxels()[voxel.index()].ijk);
            for dual_cell in dual_cells.into_iter().filter(|cell| self.components.contains_key(cell)) {
                let ids = dual_cell * 8..dual_cell * 8 + 8;
                let bound = self.vertices.range(ids).filter(|(_, vertex)| vertex.voxel == *voxel);
                change.upserted_vertices.extend(bound.map(|(id, _)| *id));
            }
        }
    }

    /// Sets the quads of a link.
    fn join(&mut self, grid: &Grid, link: LinkId, change: &mut SurfaceChange) {
        let sides = match grid.link(link) {
            Link::Parted(_) => 0..2,
            Link::Boundary(_) if grid.voxel_at(link.cell).is_some() => 0..1,
            Link::Boundary(_) => 1..2,
            Link::Intact | Link::Outside => 0..0,
        };
        for side in sides {
            let id = self.lattice.link_index(link) * 2 + side;
            let quad = self.quad_around(grid, link, side);
            if self.quads.insert(id, quad) != Some(quad) {
                change.upserted_quads.push(id);
            }
        }
    }

    fn quad_around(&self, grid: &Grid, link: LinkId, side: u32) -> Quad {
        let mut quad = self.lattice.around(link).map(|(dual_cell, lower_corner)| {
            let corner = lower_corner | (side as usize) << link.axis;
            let components = self.components.get(&dual_cell).expect("dual cells around a crossing are contoured");
            dual_cell * 8 + components.of(corner)
        });
        // From its lower end as the two sides of a cut are split alike.
        let lower_m = grid.centre_m(link.cell);
        let from_lower = |id| (self.contoured_m(id) - lower_m) / grid.voxel_size_m();
        if is_split_otherwise(quad.map(from_lower), link.axis) {
            quad.rotate_left(1);
        }
        if side == 1 {
            quad.reverse();
            quad.rotate_left(1);
        }
        quad
    }

    /// Every vertex, ids ascending.
    pub fn vertices(&self) -> impl ExactSizeIterator<Item = (VertexId, &SurfaceVertex)> {
        self.vertices.iter().map(|(id, vertex)| (*id, vertex))
    }

    /// Every quad, ids ascending.
    pub fn quads(&self) -> impl ExactSizeIterator<Item = (QuadId, &Quad)> {
        self.quads.iter().map(|(id, quad)| (*id, quad))
    }

    /// A vertex by its id.
    #[must_use]
    pub fn vertex(&self, id: VertexId) -> Option<&SurfaceVertex> {
        self.vertices.get(&id)
    }

    /// A quad by its id.
    #[must_use]
    pub fn quad(&self, id: QuadId) -> Option<&Quad> {
        self.quads.get(&id)
    }

    /// Whether a quad is of the object's own surface and no wall of a cut.
    fn is_skin(&self, grid: &Grid, quad: QuadId) -> bool {
        !matches!(grid.link(self.link_of(quad)), Link::Parted(_))
    }

    /// The link a quad stands on: parted where the quad is a cut face, else of the object's own
    /// surface.
    #[must_use]
    pub fn link_of(&self, quad: QuadId) -> LinkId {
        self.lattice.link(quad / 2)
    }
}

/// A position as the surface keeps it.
fn point(position_m: [f32; 3]) -> Vec3 {
    Vec3::from(position_m.map(f64::from))
}

/// Splits a quad along the diagonal from its first vertex.
#[must_use]
pub fn triangulate([a, b, c, d]: Quad) -> [[VertexId; 3]; 2] {
    [[a, b, c], [a, c, d]]
}

/// Whether a quad around a link is to be split along the diagonal from its second corner: the shorter one, unless that
/// leaves the quad's envelope and the other does not. The envelope is the four tetrahedra between the link and the quad's
/// edges; those of two quads do not overlap where every vertex is in its dual cell, so that what stays in them passes
/// through nothing (Ju and Udeshi 2006). Corners relative to the link's lower end, in voxels.
fn is_split_otherwise(corners: [Vec3; 4], axis: u8) -> bool {
    let length2 = |from: usize, to: usize| (corners[to] - corners[from]).norm_squared();
    let is_shorter = length2(1, 3) < length2(0, 2);
    let [a, b, c, d] = corners;
    let room = [room_in_envelope([a, c], [b, d], axis), room_in_envelope([b, d], [c, a], axis)];
    match room.map(|room| room >= 0.0) {
        [true, false] => false,
        [false, true] => true,
        [true, true] => is_shorter,
        [false, false] => room[1] > room[0],
    }
}

/// How far inside a quad's envelope a diagonal passes, in voxels along the link; less than zero: outside of it.
fn room_in_envelope([from, to]: [Vec3; 2], others: [Vec3; 2], axis: u8) -> f64 {
    let axis = usize::from(axis);
    let across = |a: &Vec3, b: &Vec3| a.cross(b)[axis];
    let along = to - from;
    // It passes the link on the side of one of the other corners, through the triangle of that corner and the link.
    let room = |corner: &Vec3| {
        let turn = across(&along, corner);
        let (share, reach) = (across(corner, &from) / turn, across(&along, &from) / turn);
        let above = from[axis] + share * along[axis] - reach * corner[axis];
        if reach < 0.0 { f64::NEG_INFINITY } else { above.min(1.0 - reach - above) }
    };
    others.iter().map(room).fold(f64::NEG_INFINITY, f64::max)
}

/// Every link with a crossing; a parted one twice, once for each of its voxels.
fn crossed_links(grid: &Grid) -> Vec<LinkId> {
    let links = grid.voxels().iter().flat_map(|voxel| Grid::links_of(voxel.ijk));
    links.map(|(link, _)| link).filter(|link| !grid.is_intact(*link)).collect()
}

fn sort_dedup(ids: &mut Vec<u32>) {
    ids.sort_unstable();
    ids.dedup();
}
