//! The surface as a mesh to walk on: which triangles meet at a vertex, which vertices move with an element.

use std::collections::BTreeMap;

use crate::body::MaterialPoint;
use crate::surface::delta::BodyStructure;
use crate::surface::{QuadId, Surface, VertexId, triangulate};

/// Index of a vertex in the mesh, in the order in which they came.
pub type Slot = u32;

/// The surface of one object by slots. It follows the surface in proportion to what changes.
///
/// What is visited in an order is visited by ids: slots tell when somebody began to look.
#[derive(Default)]
pub struct Mesh {
    vertices: Vec<Vertex>,
    quads: Vec<Quad>,
    slot_of: BTreeMap<VertexId, Slot>,
    quad_of: BTreeMap<QuadId, u32>,
    /// Vertices that move with each element, by element.
    bound: Vec<Vec<Slot>>,
}

struct Vertex {
    id: VertexId,
    point: MaterialPoint,
    element: u32,
    quads: Vec<u32>,
}

struct Quad {
    id: QuadId,
    corners: [Slot; 4],
    triangles: [[Slot; 3]; 2],
    /// The other side of its link is a quad too: a blade has laid it open.
    is_cut: bool,
}

impl Mesh {
    /// Takes over what a keyframe or a patch says of the object; `surface` is as it is after it.
    pub fn follow(&mut self, surface: &Surface, change: &BodyStructure) {
        for bound in &change.vertices {
            let vertex = surface.vertex(bound.id).expect("the patch names vertices of the surface");
            let point = MaterialPoint { position_m: vertex.position_m.map(f64::from).into(), voxel: vertex.voxel };
            self.bind(bound.id, point, bound.element);
        }
        for quad in &change.quads {
            self.join(quad.id, quad.vertices.map(|id| self.slot_of[&id]));
        }
        // A vertex that has moved may turn the diagonal of a quad that has not changed.
        for bound in &change.vertices {
            let slot = self.slot_of[&bound.id];
            for index in 0..self.vertices[slot as usize].quads.len() {
                self.split(self.vertices[slot as usize].quads[index], surface);
            }
        }
        change.quads.iter().for_each(|quad| self.split(self.quad_of[&quad.id], surface));
    }

    fn bind(&mut self, id: VertexId, point: MaterialPoint, element: u32) {
        let next = self.vertices.len() as Slot;
        let slot = *self.slot_of.entry(id).or_insert(next);
        if slot == next {
            self.vertices.push(Vertex { id, point, element, quads: Vec::new() });
        } else {
            let vertex = &mut self.vertices[slot as usize];
            self.bound[vertex.element as usize].retain(|other| *other != slot);
            (vertex.point, vertex.element) = (point, element);
        }
        if self.bound.len() <= element as usize {
            self.bound.resize(element as usize + 1, Vec::new());
        }
        let bound = &mut self.bound[element as usize];
        let place = bound.partition_point(|other| self.vertices[*other as usize].id < id);
        bound.insert(place, slot);
    }

    fn join(&mut self, id: QuadId, corners: [Slot; 4]) {
        let next = self.quads.len() as u32;
        let quad = *self.quad_of.entry(id).or_insert(next);
        if quad == next {
            self.quads.push(Quad { id, corners, triangles: Default::default(), is_cut: false });
        } else {
            for corner in self.quads[quad as usize].corners {
                self.vertices[corner as usize].quads.retain(|other| *other != quad);
            }
            self.quads[quad as usize].corners = corners;
        }
        if let Some(opposite) = self.quad_of.get(&(id ^ 1)) {
            self.quads[*opposite as usize].is_cut = true;
            self.quads[quad as usize].is_cut = true;
        }
        for corner in corners {
            let quads = &mut self.vertices[corner as usize].quads;
            let place = quads.partition_point(|other| self.quads[*other as usize].id < id);
            if quads.get(place) != Some(&quad) {
                quads.insert(place, quad);
            }
        }
    }

    fn split(&mut self, quad: u32, surface: &Surface) {
        let ids = self.quads[quad as usize].corners.map(|slot| self.vertices[slot as usize].id);
        let rest_m = |id: VertexId| surface.vertex(id).expect("a quad's vertices exist").position_m;
        let triangles = triangulate(ids, rest_m).map(|triangle| triangle.map(|id| self.slot_of[&id]));
        self.quads[quad as usize].triangles = triangles;
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
    pub fn point(&self, slot: Slot) -> &MaterialPoint {
        &self.vertices[slot as usize].point
    }

    /// Vertices that move with an element.
    #[must_use]
    pub fn bound_to(&self, element: usize) -> &[Slot] {
        self.bound.get(element).map_or(&[], Vec::as_slice)
    }

    /// The triangles that meet at a vertex, each turned so that it begins with it.
    pub fn triangles_at(&self, slot: Slot) -> impl Iterator<Item = [Slot; 3]> + '_ {
        self.quads_at(slot).flat_map(move |quad| quad.triangles_at(slot))
    }

    /// Those of them that are of cut faces.
    pub fn cut_triangles_at(&self, slot: Slot) -> impl Iterator<Item = [Slot; 3]> + '_ {
        self.quads_at(slot).filter(|quad| quad.is_cut).flat_map(move |quad| quad.triangles_at(slot))
    }

    fn quads_at(&self, slot: Slot) -> impl Iterator<Item = &Quad> + '_ {
        self.vertices[slot as usize].quads.iter().map(|quad| &self.quads[*quad as usize])
    }
}

impl Quad {
    fn triangles_at(&self, slot: Slot) -> impl Iterator<Item = [Slot; 3]> + '_ {
        self.triangles.iter().filter_map(move |&[a, b, c]| {
            [[a, b, c], [b, c, a], [c, a, b]].into_iter().find(|turned| turned[0] == slot)
        })
    }
}
