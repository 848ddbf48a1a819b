//! One object: its lattice, the surface bound to it, and where the nodes are.

use std::collections::BTreeMap;

use kerf_proto::integers::{self, Malformed};
use kerf_proto::{MAX_MESSAGE_BYTES, v1};

use crate::error::{FieldError, Problem};
use crate::hash;
use crate::vertex::Vertex;

/// Most node slots of all objects together: 12 bytes for each are still one message.
pub(crate) const MAX_NODES: u32 = (MAX_MESSAGE_BYTES / 12) as u32;

/// One object. Every vertex refers to an element, every element to nodes, every quad to vertices
/// that exist: checked when they come in, relied on when positions are evaluated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Body {
    /// Nodes are the vertices.
    has_plain_vertices: bool,
    /// Rest position by slot, m, scene frame; `None` for a slot without a node.
    rest_m: Vec<Option<[f32; 3]>>,
    /// Displacement by slot, m, scene frame.
    displacement_m: Vec<[f32; 3]>,
    /// Unit of what comes with states, m.
    quantum_m: f64,
    /// What displacements are differences to, in quanta, xyz by slot; as long as the last one that came.
    reference: Vec<i64>,
    /// Offset of the vertices that are adapted to a blade, m, scene frame.
    adapted_m: BTreeMap<u32, [f32; 3]>,
    elements: BTreeMap<u32, [u32; 8]>,
    vertices: BTreeMap<u32, Vertex>,
    /// Weights of the nodes' displacements for vertices beside what is held.
    held: BTreeMap<u32, [f32; 8]>,
    quads: BTreeMap<u32, [u32; 4]>,
    /// Sum of the hashes of the vertices, weights and quads, kept as they come.
    hash_sum: u64,
}

impl Body {
    /// An empty one.
    pub(crate) fn new(has_plain_vertices: bool) -> Self {
        Self { has_plain_vertices, ..Self::default() }
    }

    /// Surface vertices by id.
    #[must_use]
    pub fn vertices(&self) -> &BTreeMap<u32, Vertex> {
        &self.vertices
    }

    /// Weights of the nodes' displacements in those of vertices beside what is held, by id.
    #[must_use]
    pub fn held_weights(&self) -> &BTreeMap<u32, [f32; 8]> {
        &self.held
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
    fn rest_position_m(&self, id: u32, vertex: &Vertex) -> [f32; 3] {
        self.interpolate(id, vertex, |node| self.rest_m[node].unwrap_or_default())
    }

    /// Where a vertex is shown now, m, scene frame: where its element has it, and its adapted offset.
    #[must_use]
    pub fn position_m(&self, id: u32, vertex: &Vertex) -> [f32; 3] {
        let position_m = match (self.held.get(&id), vertex) {
            (Some(weights), Vertex::Bound { element, .. }) => {
                let rest_m = self.rest_position_m(id, vertex);
                let moved_m = self.weighted(*element, *weights, |node| self.displacement_m[node]);
                [0, 1, 2].map(|axis| rest_m[axis] + moved_m[axis])
            }
            _ => self.interpolate(id, vertex, |node| {
                let (rest_m, moved_m) = (self.rest_m[node].unwrap_or_default(), self.displacement_m[node]);
                [0, 1, 2].map(|axis| rest_m[axis] + moved_m[axis])
            }),
        };
        let offset_m = self.adapted_m.get(&id).copied().unwrap_or_default();
        [position_m[0] + offset_m[0], position_m[1] + offset_m[1], position_m[2] + offset_m[2]]
    }

    /// Offsets of the vertices that are adapted to a blade, m, scene frame, by id.
    #[must_use]
    pub fn adapted_offsets_m(&self) -> &BTreeMap<u32, [f32; 3]> {
        &self.adapted_m
    }

    fn interpolate(&self, id: u32, vertex: &Vertex, at_node: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
        match *vertex {
            Vertex::Bound { element, local, .. } => {
                self.weighted(element, std::array::from_fn(|corner| corner_weight(corner, local)), at_node)
            }
            Vertex::Node => at_node(id as usize),
        }
    }

    fn weighted(&self, element: u32, weights: [f32; 8], at_node: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (&node, weight) in self.elements[&element].iter().zip(weights) {
            let value = at_node(node as usize);
            for axis in 0..3 {
                sum[axis] += weight * value[axis];
            }
        }
        sum
    }

    /// Sum of the hashes of the vertices, weights and quads.
    pub(crate) fn hash_sum(&self) -> u64 {
        self.hash_sum
    }

    /// Applies what a keyframe (to an empty body) or a patch says of this object; `room` is for how many node slots. After
    /// an error the body is not to be used.
    pub(crate) fn change(&mut self, change: &v1::BodyStructure, room: u32) -> Result<(), FieldError> {
        self.set_quantum(change)?;
        self.upsert_nodes(change, room)?;
        if self.has_plain_vertices {
            self.vertices.extend(change.node_ids.iter().map(|id| (*id, Vertex::Node)));
        } else {
            self.upsert_elements(change)?;
            self.upsert_vertices(change)?;
            self.upsert_held(change)?;
        }
        self.upsert_quads(change)
    }

    /// Reads a state; `has_reference` says whether it brings one.
    pub(crate) fn read_state(&self, state: &v1::BodyState, has_reference: bool) -> Result<Moved, FieldError> {
        let numbers = 3 * self.rest_m.len();
        let reference = match has_reference {
            true => Some(
                integers::decode(&state.reference, numbers).map_err(|problem| odd("reference", numbers, problem))?,
            ),
            false => None,
        };
        let displacements = integers::decode_exactly(&state.displacements, numbers);
        let mut quanta = displacements.map_err(|problem| odd("displacements", numbers, problem))?;
        for (number, reference) in quanta.iter_mut().zip(reference.as_ref().unwrap_or(&self.reference)) {
            *number = number.wrapping_add(*reference);
        }
        let (nodes, _) = quanta.as_chunks::<3>();
        let displacement_m = nodes.iter().map(|node| node.map(|quanta| self.length_m(quanta))).collect();
        Ok(Moved { reference, displacement_m, adapted_m: self.read_adapted(state)? })
    }

    fn read_adapted(&self, state: &v1::BodyState) -> Result<BTreeMap<u32, [f32; 3]>, FieldError> {
        let most = self.vertices.len();
        let steps = integers::decode(&state.adapted_ids, most).map_err(|problem| odd("adapted_ids", most, problem))?;
        let numbers = 3 * steps.len();
        let offsets = integers::decode_exactly(&state.adapted_offsets, numbers);
        let offsets = offsets.map_err(|problem| odd("adapted_offsets", numbers, problem))?;
        let mut adapted_m = BTreeMap::new();
        let mut id = 0_i64;
        for (index, (step, offset)) in steps.iter().zip(offsets.as_chunks::<3>().0).enumerate() {
            id = id.wrapping_add(*step);
            let known = u32::try_from(id).ok().filter(|id| self.vertices.contains_key(id));
            let id = known.ok_or_else(|| unknown("adapted_ids", id as u32))?;
            if index > 0 && *step <= 0 {
                return Err(FieldError { field: "adapted_ids", problem: Problem::NotAscending { index, id } });
            }
            adapted_m.insert(id, offset.map(|quanta| self.length_m(quanta)));
        }
        Ok(adapted_m)
    }

    fn length_m(&self, quanta: i64) -> f32 {
        (quanta as f64 * self.quantum_m) as f32
    }

    /// Takes over a state that [`Body::read_state`] has read.
    pub(crate) fn displace(&mut self, moved: Moved) {
        if let Some(reference) = moved.reference {
            self.reference = reference;
        }
        self.displacement_m = moved.displacement_m;
        self.adapted_m = moved.adapted_m;
    }

    fn set_quantum(&mut self, change: &v1::BodyStructure) -> Result<(), FieldError> {
        // A patch leaves it as it is.
        if change.quantum_m != 0.0 || self.quantum_m == 0.0 {
            if !change.quantum_m.is_finite() || change.quantum_m <= 0.0 {
                return Err(FieldError { field: "quantum_m", problem: Problem::NotPositive { got: change.quantum_m } });
            }
            self.quantum_m = change.quantum_m;
        }
        Ok(())
    }

    fn upsert_nodes(&mut self, change: &v1::BodyStructure, room: u32) -> Result<(), FieldError> {
        // Slots are never taken away: elements that nothing uses any more still refer to them.
        let min = self.rest_m.len() as u32;
        if !(min..=room).contains(&change.node_count) {
            let problem = Problem::Range { min, max: room, got: change.node_count };
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
        if !change.vertex_materials.is_empty() {
            check_length("vertex_materials", change.vertex_ids.len(), &change.vertex_materials)?;
        }
        let materials = change.vertex_materials.iter().copied().chain(std::iter::repeat(0));
        let locals = zip_ids::<f32, 3>("vertex_ids", &change.vertex_ids, "vertex_local", &change.vertex_local)?;
        for (((id, local), &element), material) in locals.zip(&change.vertex_elements).zip(materials) {
            if !self.elements.contains_key(&element) {
                return Err(unknown("vertex_elements", element));
            }
            let vertex = Vertex::Bound { element, local, material };
            let before = self.vertices.insert(id, vertex).map_or(0, |before| hash::of_vertex(id, before));
            self.exchange_hash(before, hash::of_vertex(id, vertex));
            let held = self.held.remove(&id).map_or(0, |weights| hash::of_held(id, weights));
            self.exchange_hash(held, 0);
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
            let before = self.held.insert(id, weights).map_or(0, |before| hash::of_held(id, before));
            self.exchange_hash(before, hash::of_held(id, weights));
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

/// What a state says of an object.
pub(crate) struct Moved {
    reference: Option<Vec<i64>>,
    displacement_m: Vec<[f32; 3]>,
    adapted_m: BTreeMap<u32, [f32; 3]>,
}

/// Fraction of corner `c`, at `(c & 1, c >> 1 & 1, c >> 2)`, in a point of an element.
fn corner_weight(corner: usize, local: [f32; 3]) -> f32 {
    (0..3).map(|axis| if corner >> axis & 1 == 1 { local[axis] } else { 1.0 - local[axis] }).product()
}

/// Bytes that are not the integers that were expected.
fn odd(field: &'static str, expected: usize, problem: Malformed) -> FieldError {
    let problem = match problem {
        Malformed::Count { got } => Problem::Length { expected, got },
        Malformed::Truncated | Malformed::TooLarge => Problem::Malformed,
    };
    FieldError { field, problem }
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
