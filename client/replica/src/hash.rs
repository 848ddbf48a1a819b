//! The surface hash, as `kerf/v1/view.proto` specifies it.

use kerf_proto::v1;

/// The hash that a keyframe of these bodies states. Entries that have no counterpart in the arrays
/// beside them are left out.
#[must_use]
pub fn surface_hash(bodies: &[v1::BodyStructure]) -> u64 {
    of_objects(bodies.iter().map(object))
}

fn object(body: &v1::BodyStructure) -> u64 {
    let (locals, _) = body.vertex_local.as_chunks::<3>();
    let (corners, _) = body.quad_vertices.as_chunks::<4>();
    let bound = body.vertex_elements.iter().zip(locals);
    let vertices = body.vertex_ids.iter().zip(bound).map(|(&id, (&element, &local))| of_vertex(id, element, local));
    let quads = body.quad_ids.iter().zip(corners).map(|(&id, &corners)| of_quad(id, corners));
    vertices.chain(quads).fold(0, u64::wrapping_add)
}

/// Of the sums over each object's vertices and quads.
pub(crate) fn of_objects(sums: impl Iterator<Item = u64>) -> u64 {
    sums.fold(0, fold_in)
}

pub(crate) fn of_vertex(id: u32, element: u32, local: [f32; 3]) -> u64 {
    let [u, v, w] = local.map(f32::to_bits);
    of_item(0, id, [element, u, v, w])
}

pub(crate) fn of_quad(id: u32, corners: [u32; 4]) -> u64 {
    of_item(1, id, corners)
}

fn of_item(kind: u64, id: u32, values: [u32; 4]) -> u64 {
    let [a, b, c, d] = values.map(u64::from);
    let first = fold_in(0, u64::from(id) << 32 | a);
    fold_in(fold_in(first, b << 32 | c), kind << 32 | d)
}

fn fold_in(hash: u64, word: u64) -> u64 {
    let mut x = (hash ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
