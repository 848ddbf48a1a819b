//! The surface hash, as `kerf/v1/view.proto` specifies it.

use kerf_proto::v1;

use crate::vertex::Vertex;

/// In the place where a vertex has its material, which is below both.
const QUAD: u32 = 1 << 16;
const HELD: u32 = 1 << 17;

/// The hash that a keyframe of these bodies states. Entries that have no counterpart in the arrays
/// beside them are left out.
#[must_use]
pub fn surface_hash(bodies: &[v1::BodyStructure]) -> u64 {
    of_objects(bodies.iter().map(object))
}

fn object(body: &v1::BodyStructure) -> u64 {
    let (locals, _) = body.vertex_local.as_chunks::<3>();
    let (corners, _) = body.quad_vertices.as_chunks::<4>();
    let (weights, _) = body.held_vertex_weights.as_chunks::<8>();
    // No materials: all 0.
    let materials = body.vertex_materials.iter().copied().chain(std::iter::repeat(0));
    let bound = body.vertex_elements.iter().zip(locals).zip(materials);
    let bound = bound.map(|((&element, &local), material)| Vertex::Bound { element, local, material });
    let vertices = body.vertex_ids.iter().zip(bound).map(|(&id, vertex)| of_vertex(id, vertex));
    let held = body.held_vertex_ids.iter().zip(weights).map(|(&id, &weights)| of_held(id, weights));
    let quads = body.quad_ids.iter().zip(corners).map(|(&id, &corners)| of_quad(id, corners));
    vertices.chain(held).chain(quads).fold(0, u64::wrapping_add)
}

/// Of the sums over each object's items.
pub(crate) fn of_objects(sums: impl Iterator<Item = u64>) -> u64 {
    sums.fold(0, fold_in)
}

/// A plain vertex has none.
pub(crate) fn of_vertex(id: u32, vertex: Vertex) -> u64 {
    let Vertex::Bound { element, local, material } = vertex else { return 0 };
    let [u, v, w] = local.map(f32::to_bits);
    of_words([[id, element], [u, v], [material, w]])
}

/// Of the weights of a vertex beside what is held.
pub(crate) fn of_held(id: u32, weights: [f32; 8]) -> u64 {
    let [a, b, c, d, e, f, g, h] = weights.map(f32::to_bits);
    of_words([[id, a], [b, c], [d, e], [f, g], [HELD, h]])
}

pub(crate) fn of_quad(id: u32, corners: [u32; 4]) -> u64 {
    let [a, b, c, d] = corners;
    of_words([[id, a], [b, c], [QUAD, d]])
}

/// Of words told as their upper and lower halves.
fn of_words<const N: usize>(words: [[u32; 2]; N]) -> u64 {
    words.into_iter().map(|[high, low]| u64::from(high) << 32 | u64::from(low)).fold(0, fold_in)
}

fn fold_in(hash: u64, word: u64) -> u64 {
    let mut x = (hash ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
