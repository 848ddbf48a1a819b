//! Surfaces as plain vertices, for clients that cannot skin.
//!
//! Each vertex is a node of what viewers get. All viewers of one encoder see the same numbers for them, whenever they
//! joined, so that a state is encoded once for all.

use std::collections::HashMap;

use kerf_physics::surface::delta::{AdaptedVertex, BodyStructure, BoundVertex, Keyframe, TopologyPatch};
use kerf_physics::surface::{QuadId, VertexId};
use kerf_proto::v1;
use kerf_session::ViewState;
use prost::bytes::Bytes;

/// The newest structure that any viewer was told of, from which states are computed.
#[derive(Default)]
pub struct Vertices {
    epoch: u64,
    /// `None` before the first keyframe.
    version: Option<u64>,
    bodies: Vec<Body>,
}

/// What an object's vertices move with.
#[derive(Default)]
struct Body {
    /// By id.
    node_rest_m: Vec<[f32; 3]>,
    /// Nodes by id of the element.
    elements: Vec<[u32; 8]>,
    /// Numbers of the vertices as viewers know them, in the order in which they came.
    numbers: HashMap<VertexId, u32>,
    vertices: Vec<Vertex>,
    quad_indices: HashMap<QuadId, usize>,
    /// Numbers of their corners.
    quads: Vec<[u32; 4]>,
}

#[derive(Clone, Copy)]
struct Vertex {
    rest_m: [f32; 3],
    element: u32,
    /// How much the displacement of each of the element's corners counts.
    weights: [f32; 8],
    material: u16,
}

impl Vertices {
    /// A keyframe for viewers; `None` where it is of a scene that has started over since.
    pub fn keyframe(&mut self, epoch: u64, keyframe: &Keyframe, quanta_m: &[f64]) -> Option<v1::Keyframe> {
        if epoch < self.epoch {
            return None;
        }
        if epoch > self.epoch {
            *self = Self { epoch, ..Self::default() };
        }
        self.bodies.resize_with(keyframe.bodies.len(), Body::default);
        if self.version.is_none_or(|version| version < keyframe.topology_version) {
            self.follow(keyframe.topology_version, &keyframe.bodies);
        }
        let bodies = self.bodies.iter().zip(&keyframe.bodies).zip(quanta_m);
        Some(v1::Keyframe {
            topology_version: keyframe.topology_version,
            bodies: bodies
                .map(|((body, whole), quantum_m)| v1::BodyStructure { quantum_m: *quantum_m, ..body.told(whole) })
                .collect(),
            surface_hash: 0,
            encoding: v1::SurfaceEncoding::Vertices.into(),
        })
    }

    /// A patch for viewers; `None` where it is of a scene that has started over since.
    pub fn patch(&mut self, epoch: u64, patch: &TopologyPatch) -> Option<v1::TopologyPatch> {
        if epoch != self.epoch {
            return None;
        }
        // One that others have had already says nothing new.
        if self.version.is_some_and(|version| version < patch.to_version) {
            self.follow(patch.to_version, &patch.bodies);
        }
        Some(v1::TopologyPatch {
            from_version: patch.from_version,
            to_version: patch.to_version,
            bodies: self.bodies.iter().zip(&patch.bodies).map(|(body, change)| body.told(change)).collect(),
            surface_hash: 0,
        })
    }

    /// Displacements of each object's vertices, m, with what they are adapted by; `None` where the state is not of the
    /// structure as it is now. A viewer whose state it was is yet to be told of that structure, and then gets a
    /// state of it.
    pub fn displacements_m(&self, state: &ViewState) -> Option<Vec<Vec<[f32; 3]>>> {
        if (state.epoch(), Some(state.topology_version)) != (self.epoch, self.version) {
            return None;
        }
        let objects = self.bodies.iter().zip(&state.node_displacements_m).zip(&state.adapted);
        Some(objects.map(|((body, nodes_m), adapted)| body.displacements_m(nodes_m, adapted)).collect())
    }

    /// Normals of each object's vertices where they are displaced, as the wire has them.
    pub fn normals(&self, displacements_m: &[Vec<[f32; 3]>]) -> Vec<Bytes> {
        self.bodies.iter().zip(displacements_m).map(|(body, moved_m)| body.normals(moved_m)).collect()
    }

    fn follow(&mut self, version: u64, changes: &[BodyStructure]) {
        self.version = Some(version);
        self.bodies.iter_mut().zip(changes).for_each(|(body, change)| body.follow(change));
    }
}

impl Body {
    fn follow(&mut self, change: &BodyStructure) {
        for node in &change.nodes {
            *entry(&mut self.node_rest_m, node.id) = node.rest_m;
        }
        for element in &change.elements {
            *entry(&mut self.elements, element.id) = element.nodes;
        }
        for bound in &change.vertices {
            let vertex = self.bind(bound);
            let number = *self.numbers.entry(bound.id).or_insert(self.vertices.len() as u32) as usize;
            match self.vertices.get_mut(number) {
                Some(known) => *known = vertex,
                None => self.vertices.push(vertex),
            }
        }
        for held in &change.held {
            let number = self.numbers[&held.id] as usize;
            self.vertices[number].weights = held.weights;
        }
        for quad in &change.quads {
            let corners = quad.vertices.map(|id| self.numbers[&id]);
            let index = *self.quad_indices.entry(quad.id).or_insert(self.quads.len());
            match self.quads.get_mut(index) {
                Some(known) => *known = corners,
                None => self.quads.push(corners),
            }
        }
    }

    fn bind(&self, bound: &BoundVertex) -> Vertex {
        let weights = std::array::from_fn(|corner| corner_weight(corner, bound.local));
        let nodes = &self.elements[bound.element as usize];
        let rest_m = weighted(nodes, &weights, |node| self.node_rest_m[node]);
        Vertex { rest_m, element: bound.element, weights, material: bound.material }
    }

    /// What viewers are told of a structure that this body has followed.
    fn told(&self, change: &BodyStructure) -> v1::BodyStructure {
        let mut numbers: Vec<u32> = change.vertices.iter().map(|vertex| self.numbers[&vertex.id]).collect();
        numbers.sort_unstable();
        let vertices = || numbers.iter().map(|number| &self.vertices[*number as usize]);
        let is_plain = vertices().all(|vertex| vertex.material == 0);
        v1::BodyStructure {
            node_count: self.vertices.len() as u32,
            node_rest_m: vertices().flat_map(|vertex| vertex.rest_m).collect(),
            vertex_materials: vertices().filter(|_| !is_plain).map(|vertex| u32::from(vertex.material)).collect(),
            quad_ids: change.quads.iter().map(|quad| quad.id).collect(),
            quad_vertices: change.quads.iter().flat_map(|quad| quad.vertices.map(|id| self.numbers[&id])).collect(),
            node_ids: numbers,
            ..v1::BodyStructure::default()
        }
    }

    fn displacements_m(&self, nodes_m: &[f32], adapted: &[AdaptedVertex]) -> Vec<[f32; 3]> {
        let (nodes_m, _) = nodes_m.as_chunks::<3>();
        let moved_m =
            |vertex: &Vertex| weighted(&self.elements[vertex.element as usize], &vertex.weights, |node| nodes_m[node]);
        let mut moved_m: Vec<_> = self.vertices.iter().map(moved_m).collect();
        for vertex in adapted {
            let at = &mut moved_m[self.numbers[&vertex.id] as usize];
            (0..3).for_each(|axis| at[axis] += vertex.offset_m[axis]);
        }
        moved_m
    }

    fn normals(&self, moved_m: &[[f32; 3]]) -> Bytes {
        let place_m = |number: u32| {
            let (rest_m, moved_m) = (self.vertices[number as usize].rest_m, moved_m[number as usize]);
            [0, 1, 2].map(|axis| rest_m[axis] + moved_m[axis])
        };
        let mut normals = vec![[0.0; 3]; self.vertices.len()];
        for corners in &self.quads {
            let [a, b, c, d] = corners.map(place_m);
            // Half the cross product of the diagonals is the quad's area vector, however it is split.
            let area = cross(difference(c, a), difference(d, b));
            for corner in corners {
                let normal = &mut normals[*corner as usize];
                (0..3).for_each(|axis| normal[axis] += area[axis]);
            }
        }
        normals.into_iter().flat_map(on_octahedron).map(|coordinate| coordinate as u8).collect()
    }
}

/// The entry with this index, which is made where there is none.
fn entry<T: Clone + Default>(items: &mut Vec<T>, index: u32) -> &mut T {
    let index = index as usize;
    if items.len() <= index {
        items.resize(index + 1, T::default());
    }
    &mut items[index]
}

/// Fraction of corner `c`, at `(c & 1, c >> 1 & 1, c >> 2)`, in a point of an element.
fn corner_weight(corner: usize, local: [f32; 3]) -> f32 {
    (0..3).map(|axis| if corner >> axis & 1 == 1 { local[axis] } else { 1.0 - local[axis] }).product()
}

fn weighted<const N: usize>(nodes: &[u32; 8], weights: &[f32; 8], at_node: impl Fn(usize) -> [f32; N]) -> [f32; N] {
    let mut sum = [0.0; N];
    for (node, weight) in nodes.iter().zip(weights) {
        let value = at_node(*node as usize);
        for axis in 0..N {
            sum[axis] += weight * value[axis];
        }
    }
    sum
}

fn difference(to: [f32; 3], from: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|axis| to[axis] - from[axis])
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A direction as two numbers of eight bits (Meyer et al. 2010, "On floating-point normal vectors"): its place on the octahedron
/// |x| + |y| + |z| = 1, whose lower half is folded outwards. Nothing for no direction.
fn on_octahedron([x, y, z]: [f32; 3]) -> [i8; 2] {
    let length = x.abs() + y.abs() + z.abs();
    if length == 0.0 {
        return [0, 0];
    }
    let (x, y) = (x / length, y / length);
    let folded = if z < 0.0 { [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)] } else { [x, y] };
    folded.map(|coordinate| (127.0 * coordinate).round() as i8)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// As docs/reference/protocol.md says.
    fn from_octahedron([x, y]: [i8; 2]) -> [f32; 3] {
        let (mut x, mut y) = (f32::from(x) / 127.0, f32::from(y) / 127.0);
        let z = 1.0 - x.abs() - y.abs();
        if z < 0.0 {
            let sign = |value: f32| if value < 0.0 { -1.0 } else { 1.0 };
            (x, y) = ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y));
        }
        let length = (x * x + y * y + z * z).sqrt();
        [x / length, y / length, z / length]
    }

    proptest! {
        #[test]
        fn a_normal_comes_back_within_a_degree(x in -1.0_f32..1.0, y in -1.0_f32..1.0, z in -1.0_f32..1.0) {
            let length = (x * x + y * y + z * z).sqrt();
            prop_assume!(length > 0.1);
            let back = from_octahedron(on_octahedron([x, y, z]));
            let cosine = (x * back[0] + y * back[1] + z * back[2]) / length;
            prop_assert!(cosine > 1_f32.to_radians().cos(), "{back:?}");
        }
    }
}
