//! The surface as a mesh to walk on: which triangles meet at a vertex, which vertices move with an element.

use crate::grid::{MaterialPoint, VoxelId};
use crate::surface::delta::BodyStructure;
use crate::surface::{QUADS_PER_CELL, QuadId, Surface, SurfaceVertex, VERTICES_PER_CELL, VertexId, triangulate};

/// Index of a vertex in the mesh, in the order in which they came.
pub type Slot = u32;

/// The surface of one object by slots. It follows the surface in proportion to what changes.
///
/// What is visited in an order is visited by ids: slots tell when somebody began to look.
#[derive(Default)]
pub struct Mesh {
    vertices: Vec<Vertex>,
    quads: Vec<Quad>,
    slots: Index<VERTICES_PER_CELL>,
    quad_numbers: Index<QUADS_PER_CELL>,
    /// Vertices that move with each element, by element.
    bound: Vec<Vec<Slot>>,
    /// Quads to split anew.
    touched: Vec<u32>,
}

struct Vertex {
    id: VertexId,
    rest_m: [f32; 3],
    voxel: VoxelId,
    element: u32,
    /// The triangles that meet here, by the ids of their quads.
    corners: Vec<Corner>,
}

/// A triangle at one of its vertices: the other two in its order.
#[derive(Clone, Copy)]
struct Corner {
    quad: u32,
    others: [Slot; 2],
    /// The other side of the quad's link is a quad too: a blade has laid it open.
    is_cut: bool,
}

struct Quad {
    id: QuadId,
    corners: [Slot; 4],
}

impl Mesh {
    /// Takes over what a keyframe or a patch says of the object; `surface` is as it is after it.
    pub fn follow(&mut self, surface: &Surface, change: &BodyStructure) {
        self.touched.clear();
        for bound in &change.vertices {
            let vertex = surface.vertex(bound.id).expect("the patch names vertices of the surface");
            self.bind(bound.id, vertex, bound.element);
        }
        for quad in &change.quads {
            let number = self.join(quad.id, quad.vertices);
            self.touched.push(number);
            // What was the object's own surface on one side of the link is a cut face now.
            self.touched.extend(self.quad_numbers.find(quad.id ^ 1));
        }
        let mut touched = std::mem::take(&mut self.touched);
        touched.sort_unstable();
        touched.dedup();
        touched.iter().for_each(|quad| self.split(*quad));
        self.touched = touched;
    }

    fn bind(&mut self, id: VertexId, vertex: &SurfaceVertex, element: u32) {
        let slot = self.slots.find_or_add(id);
        if slot as usize == self.vertices.len() {
            let SurfaceVertex { position_m: rest_m, voxel } = *vertex;
            self.vertices.push(Vertex { id, rest_m, voxel, element, corners: Vec::new() });
        } else {
            let known = &mut self.vertices[slot as usize];
            self.bound[known.element as usize].retain(|other| *other != slot);
            (known.rest_m, known.voxel, known.element) = (vertex.position_m, vertex.voxel, element);
        }
        if self.bound.len() <= element as usize {
            self.bound.resize(element as usize + 1, Vec::new());
        }
        let bound = &mut self.bound[element as usize];
        let place = bound.partition_point(|other| self.vertices[*other as usize].id < id);
        bound.insert(place, slot);
    }

    /// Takes over which vertices a quad joins; its number.
    fn join(&mut self, id: QuadId, vertices: [VertexId; 4]) -> u32 {
        let corners = vertices.map(|vertex| self.slots.find(vertex).expect("a quad's vertices exist"));
        let quad = self.quad_numbers.find_or_add(id);
        if quad as usize == self.quads.len() {
            self.quads.push(Quad { id, corners });
        } else {
            self.part(quad);
            self.quads[quad as usize].corners = corners;
        }
        quad
    }

    /// Takes a quad's triangles away from its vertices.
    fn part(&mut self, quad: u32) {
        for slot in self.quads[quad as usize].corners {
            self.vertices[slot as usize].corners.retain(|corner| corner.quad != quad);
        }
    }

    /// Makes a quad's triangles anew.
    fn split(&mut self, quad: u32) {
        self.part(quad);
        let Quad { id, corners } = self.quads[quad as usize];
        let is_cut = self.quad_numbers.find(id ^ 1).is_some();
        for [a, b, c] in triangulate(corners) {
            for (at, others) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
                let quads = &self.quads;
                let corners = &mut self.vertices[at as usize].corners;
                let place = corners.partition_point(|corner| quads[corner.quad as usize].id <= id);
                corners.insert(place, Corner { quad, others, is_cut });
            }
        }
    }

    /// Number of vertices.
    #[must_use]
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// Id of a vertex.
    #[must_use]
    pub fn id(&self, slot: Slot) -> VertexId {
        self.vertices[slot as usize].id
    }

    /// The material point that a vertex is.
    #[must_use]
    pub fn point(&self, slot: Slot) -> MaterialPoint {
        let Vertex { rest_m, voxel, .. } = self.vertices[slot as usize];
        MaterialPoint { position_m: rest_m.map(f64::from).into(), voxel }
    }

    /// Vertices that move with an element.
    #[must_use]
    pub(crate) fn bound_to(&self, element: usize) -> &[Slot] {
        self.bound.get(element).map_or(&[], Vec::as_slice)
    }

    /// The triangles that meet at a vertex, by their other two vertices in the triangle's order.
    pub(crate) fn triangles_at(&self, slot: Slot) -> impl Iterator<Item = [Slot; 2]> + '_ {
        self.vertices[slot as usize].corners.iter().map(|corner| corner.others)
    }

    /// Those of them that are of cut faces.
    pub(crate) fn cut_triangles_at(&self, slot: Slot) -> impl Iterator<Item = [Slot; 2]> + '_ {
        let corners = self.vertices[slot as usize].corners.iter();
        corners.filter(|corner| corner.is_cut).map(|corner| corner.others)
    }
}

/// Numbers for ids in the order in which they come, of which `PER_CELL` lie in each cell of the lattice. The ids of
/// a cell are a chain.
#[derive(Default)]
struct Index<const PER_CELL: u32> {
    /// The last number given to an id of each cell.
    last: Vec<u32>,
    /// By number: the id, and the number given before it in its cell.
    ids: Vec<(u32, u32)>,
}

/// No number.
const NONE: u32 = u32::MAX;

impl<const PER_CELL: u32> Index<PER_CELL> {
    fn find(&self, id: u32) -> Option<u32> {
        let mut number = *self.last.get((id / PER_CELL) as usize)?;
        while let Some(&(found, before)) = self.ids.get(number as usize) {
            if found == id {
                return Some(number);
            }
            number = before;
        }
        None
    }

    fn find_or_add(&mut self, id: u32) -> u32 {
        self.find(id).unwrap_or_else(|| {
            let (cell, number) = ((id / PER_CELL) as usize, self.ids.len() as u32);
            if self.last.len() <= cell {
                self.last.resize(cell + 1, NONE);
            }
            self.ids.push((id, std::mem::replace(&mut self.last[cell], number)));
            number
        })
    }
}
