//! The surface hash that replicas check themselves by, as `kerf/v1/view.proto` specifies it.
//!
//! An object's hash is the sum of the hashes of its items: vertices, the weights of those beside what is held, and
//! quads. So it follows a patch at a cost in proportion to the patch. It guards against faults, not against somebody who seeks
//! collisions.

use std::collections::BTreeMap;

use super::delta::{BodyStructure, BoundQuad, BoundVertex, HeldVertex};
use super::{QuadId, VertexId};

/// Materials are below it, so that no vertex has the words of a quad.
const QUAD: u32 = 1 << 16;
/// Tells weights from vertices and quads.
const HELD: u32 = 1 << 17;

/// Hash of one object's surface; that of an empty one by default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectHash {
    sum: u64,
    /// What each item adds to the sum, to take it back when it changes.
    vertices: BTreeMap<VertexId, u64>,
    held: BTreeMap<VertexId, u64>,
    quads: BTreeMap<QuadId, u64>,
}

impl ObjectHash {
    /// Follows a change of structure.
    pub fn follow(&mut self, change: &BodyStructure) {
        for vertex in &change.vertices {
            exchange(&mut self.sum, &mut self.vertices, vertex.id, vertex_hash(vertex));
            // It has the weights that come with it, or none.
            self.sum = self.sum.wrapping_sub(self.held.remove(&vertex.id).unwrap_or(0));
        }
        for held in &change.held {
            exchange(&mut self.sum, &mut self.held, held.id, held_hash(held));
        }
        for quad in &change.quads {
            exchange(&mut self.sum, &mut self.quads, quad.id, quad_hash(quad));
        }
    }
}

/// Hash of the surface of every object, in the order of the scene.
pub fn surface_hash<'a>(objects: impl Iterator<Item = &'a ObjectHash>) -> u64 {
    sequence_hash(objects.map(|object| object.sum))
}

fn exchange(sum: &mut u64, terms: &mut BTreeMap<u32, u64>, id: u32, term: u64) {
    let before = terms.insert(id, term).unwrap_or(0);
    *sum = sum.wrapping_sub(before).wrapping_add(term);
}

fn vertex_hash(vertex: &BoundVertex) -> u64 {
    let [u, v, w] = vertex.local.map(f32::to_bits);
    sequence_hash([pair(vertex.id, vertex.element), pair(u, v), pair(vertex.material.into(), w)])
}

fn held_hash(held: &HeldVertex) -> u64 {
    let [a, b, c, d, e, f, g, h] = held.weights.map(f32::to_bits);
    sequence_hash([pair(held.id, a), pair(b, c), pair(d, e), pair(f, g), pair(HELD, h)])
}

fn quad_hash(quad: &BoundQuad) -> u64 {
    let [a, b, c, d] = quad.vertices;
    sequence_hash([pair(quad.id, a), pair(b, c), pair(QUAD, d)])
}

fn pair(high: u32, low: u32) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}

fn sequence_hash(words: impl IntoIterator<Item = u64>) -> u64 {
    words.into_iter().fold(0, |hash, word| mix(hash ^ word))
}

/// A step of SplitMix64 (Steele et al. 2014): every bit of the result depends on every bit of `x`,
/// without which the sum would let changes of two items cancel.
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}
