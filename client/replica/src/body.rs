//! One object: its lattice, the surface bound to it, and where the nodes are.

use std::collections::BTreeMap;

use kerf_proto::{MAX_MESSAGE_BYTES, v1};

use crate::error::{FieldError, Problem};
use crate::hash;

/// Most node slots of an object: a state has to carry 12 bytes for each.
const MAX_NODES: u32 = (MAX_MESSAGE_BYTES / 12) as u32;

/// A surface vertex bound to an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Element it moves with.
    pub element: u32,
    /// Trilinear coordinates in the element; corner `c` is at `(c & 1, c >> 1 & 1, c >> 2)`.
    pub local: [f32; 3],
}

/// One object. Every vertex refers to an element, every element to nodes, every quad to vertices
/// that exist: checked when they come in, relied on when positions are evaluated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Body {
    /// Rest position by slot, m, scene frame; `None` for a slot without a node.
    rest_m: Vec<Option<[f32; 3]>>,
    /// Displacement by slot, m, scene frame.
    displacement_m: Vec<[f32; 3]>,
    /// Offset of the vertices that are adapted to a blade, m, scene frame.
    adapted_m: BTreeMap<u32, [f32; 3]>,
    elements: BTreeMap<u32, [u32; 8]>,
    vertices: BTreeMap<u32, Vertex>,
    /// Weights of the nodes' displacements for vertices beside what is held.
    held: BTreeMap<u32, [f32; 8]>,
    quads: BTreeMap<u32, [u32; 4]>,
    /// Sum of the hashes of the vertices and quads, kept as they come.
    hash_sum: u64,
}

impl Body {
    /// Surface vertices by id.
    #[must_use]
    pub fn vertices(&self) -> &BTreeMap<u32, Vertex> {
        &self.vertices
    }

    /// Vertex ids of each quad by id, counter-clockwise seen from outside.
    #[must_use]
    pub fn quads(&self) -> &BTreeMap<u32, [u32; 4]> {
        &self.quads
    }

    /// Number of node slots.
    #[must_use]
    pub fn node_slots(&self) -> usize {
        self.rest_m.len()
    }

    /// Where a vertex is at rest, m, scene frame.
    #[must_use]
    pub fn rest_position_m(&self, vertex: &Vertex) -> [f32; 3] {
        self.interpolate(vertex, |node| self.rest_m[node].unwrap_or_default())
    }

    /// Where a vertex is shown now, m, scene frame: where its element has it, and its adapted offset.
    #[must_use]
    pub fn position_m(&self, id: u32, vertex: &Vertex) -> [f32; 3] {
        let position_m = match self.held.get(&id) {
            None => self.interpolate(vertex, |node| {
                let (rest_m, moved_m) = (self.rest_m[node].unwrap_or_default(), self.displacement_m[node]);
                [0, 1, 2].map(|axis| rest_m[axis] + moved_m[axis])
            }),
            Some(weights) => {
                let rest_m = self.rest_position_m(vertex);
                let moved_m = self.weighted(vertex, *weights, |node| self.displacement_m[node]);
                [0, 1, 2].map(|axis| rest_m[axis] + moved_m[axis])
            }
        };
        let offset_m = self.adapted_m.get(&id).copied().unwrap_or_default();
        [position_m[0] + offset_m[0], position_m[1] + offset_m[1], position_m[2] + offset_m[2]]
    }

    /// Offsets of the vertices that are adapted to a blade, m, scene frame, by id.
    #[must_use]
    pub fn adapted_offsets_m(&self) -> &BTreeMap<u32, [f32; 3]> {
        &self.adapted_m
    }

    fn interpolate(&self, vertex: &Vertex, at_node: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
        self.weighted(vertex, std::array::from_fn(|corner| corner_weight(corner, vertex.local)), at_node)
    }

    fn weighted(&self, vertex: &Vertex, weights: [f32; 8], at_node: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (&node, weight) in self.elements[&vertex.element].iter().zip(weights) {
            let value = at_node(node as usize);
            for axis in 0..3 {
                sum[axis] += weight * value[axis];
            }
        }
        sum
    }

    /// Sum of the hashes of the vertices and quads.
    pub(crate) fn hash_sum(&self) -> u64 {
        self.hash_sum
    }

    /// Applies what a keyframe (to an empty body) or a patch says of this object. After an error
    /// the body is not to be used.
    pub(crate) fn change(&mut self, change: &v1::BodyStructure) -> Result<(), FieldError> {
        self.upsert_nodes(change)?;
        self.upsert_elements(change)?;
        self.upsert_vertices(change)?;
        self.upsert_held(change)?;
        self.upsert_quads(change)
    }

    pub(crate) fn check_state(&self, state: &v1::BodyState) -> Result<(), FieldError> {
        let field = "node_displacements_m";
        check_length(field, 3 * self.rest_m.len(), &state.node_displacements_m)?;
        check_finite(field, &state.node_displacements_m)?;
        check_finite("adapted_offsets_m", &state.adapted_offsets_m)?;
        let unknown_id = adapted(state)?.map(|(id, _)| id).find(|id| !self.vertices.contains_key(id));
        unknown_id.map_or(Ok(()), |id| Err(unknown("adapted_vertex_ids", id)))
    }

    /// Takes over a state that [`Body::check_state`] has found valid.
    pub(crate) fn displace(&mut self, state: &v1::BodyState) {
        let (nodes, _) = state.node_displacements_m.as_chunks::<3>();
        self.displacement_m.copy_from_slice(nodes);
        self.adapted_m.clear();
        self.adapted_m.extend(adapted(state).into_iter().flatten());
    }

    fn upsert_nodes(&mut self, change: &v1::BodyStructure) -> Result<(), FieldError> {
        // Slots are never taken away: elements that nothing uses any more still refer to them.
        let min = self.rest_m.len() as u32;
        if !(min..=MAX_NODES).contains(&change.node_count) {
            let problem = Problem::Range { min, max: MAX_NODES, got: change.node_count };
            return Err(FieldError { field: "node_count", problem });
        }
        check_finite("node_rest_m", &change.node_rest_m)?;
        let nodes = zip_ids::<f32, 3>("node_ids", &change.node_ids, "node_rest_m", &change.node_rest_m)?;
        self.rest_m.resize(change.node_count as usize, None);
        self.displacement_m.resize(change.node_count as usize, [0.0; 3]);
        for (id, rest_m) in nodes {
            *self.rest_m.get_mut(id as usize).ok_or_else(|| unknown("node_ids", id))? = Some(rest_m);
        }
        Ok(())
    }

    fn upsert_elements(&mut self, change: &v1::BodyStructure) -> Result<(), FieldError> {
        let elements = zip_ids::<u32, 8>("element_ids", &change.element_ids, "element_nodes", &change.element_nodes)?;
        for (id, nodes) in elements {
            let missing = nodes.iter().find(|&&node| !matches!(self.rest_m.get(node as usize), Some(Some(_))));
            if let Some(&node) = missing {
                return Err(unknown("element_nodes", node));
            }
            self.elements.insert(id, nodes);
        }
        Ok(())
    }

    fn upsert_vertices(&mut self, change: &v1::BodyStructure) -> Result<(), FieldError> {
        check_finite("vertex_local", &change.vertex_local)?;
        check_length("vertex_elements", change.vertex_ids.len(), &change.vertex_elements)?;
        let locals = zip_ids::<f32, 3>("vertex_ids", &change.vertex_ids, "vertex_local", &change.vertex_local)?;
        for ((id, local), &element) in locals.zip(&change.vertex_elements) {
            if !self.elements.contains_key(&element) {
                return Err(unknown("vertex_elements", element));
            }
            let vertex = Vertex { element, local };
            self.held.remove(&id);
            let of = |vertex: Vertex| hash::of_vertex(id, vertex.element, vertex.local);
            let before = self.vertices.insert(id, vertex).map_or(0, of);
            self.exchange_hash(before, of(vertex));
        }
        Ok(())
    }

    fn upsert_held(&mut self, change: &v1::BodyStructure) -> Result<(), FieldError> {
        let (ids, weights) = (&change.held_vertex_ids, &change.held_vertex_weights);
        check_finite("held_vertex_weights", weights)?;
        for (id, weights) in zip_ids::<f32, 8>("held_vertex_ids", ids, "held_vertex_weights", weights)? {
            if !self.vertices.contains_key(&id) {
                return Err(unknown("held_vertex_ids", id));
            }
            self.held.insert(id, weights);
        }
        Ok(())
    }

    fn upsert_quads(&mut self, change: &v1::BodyStructure) -> Result<(), FieldError> {
        let quads = zip_ids::<u32, 4>("quad_ids", &change.quad_ids, "quad_vertices", &change.quad_vertices)?;
        for (id, corners) in quads {
            if let Some(&vertex) = corners.iter().find(|vertex| !self.vertices.contains_key(vertex)) {
                return Err(unknown("quad_vertices", vertex));
            }
            let before = self.quads.insert(id, corners).map_or(0, |before| hash::of_quad(id, before));
            self.exchange_hash(before, hash::of_quad(id, corners));
        }
        Ok(())
    }

    fn exchange_hash(&mut self, before: u64, after: u64) {
        self.hash_sum = self.hash_sum.wrapping_sub(before).wrapping_add(after);
    }
}

/// The vertices of a state that are adapted, and their offsets.
fn adapted(state: &v1::BodyState) -> Result<impl Iterator<Item = (u32, [f32; 3])> + '_, FieldError> {
    zip_ids("adapted_vertex_ids", &state.adapted_vertex_ids, "adapted_offsets_m", &state.adapted_offsets_m)
}

/// Fraction of corner `c`, at `(c & 1, c >> 1 & 1, c >> 2)`, in a point of an element.
fn corner_weight(corner: usize, local: [f32; 3]) -> f32 {
    (0..3).map(|axis| if corner >> axis & 1 == 1 { local[axis] } else { 1.0 - local[axis] }).product()
}

fn unknown(field: &'static str, id: u32) -> FieldError {
    FieldError { field, problem: Problem::UnknownId { id } }
}

fn check_length<T>(field: &'static str, expected: usize, values: &[T]) -> Result<(), FieldError> {
    if values.len() == expected {
        Ok(())
    } else {
        Err(FieldError { field, problem: Problem::Length { expected, got: values.len() } })
    }
}

fn check_finite(field: &'static str, values: &[f32]) -> Result<(), FieldError> {
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(index) => Err(FieldError { field, problem: Problem::NotFinite { index } }),
    }
}

fn check_ascending(field: &'static str, ids: &[u32]) -> Result<(), FieldError> {
    match ids.windows(2).position(|pair| pair[0] >= pair[1]) {
        None => Ok(()),
        Some(before) => {
            let index = before + 1;
            Err(FieldError { field, problem: Problem::NotAscending { index, id: ids[index] } })
        }
    }
}

/// Pairs ascending ids with the `N` values that each of them has.
fn zip_ids<'a, T: Copy, const N: usize>(
    id_field: &'static str,
    ids: &'a [u32],
    value_field: &'static str,
    values: &'a [T],
) -> Result<impl Iterator<Item = (u32, [T; N])> + 'a, FieldError> {
    check_ascending(id_field, ids)?;
    check_length(value_field, N * ids.len(), values)?;
    let (chunks, _) = values.as_chunks::<N>();
    Ok(ids.iter().copied().zip(chunks.iter().copied()))
}
