//! The surface hash of the core and the one that replicas compute from the wire are the same.

use kerf_physics::hash::StateHasher;
use kerf_physics::surface::delta::{BoundQuad, BoundVertex, hash_body};
use kerf_proto::v1;
use kerf_replica::{Replica, ReplicaError};

fn vertices() -> Vec<BoundVertex> {
    [
        (3, 0, [0.0, -0.0, 1.0]),
        (900, 1, [0.1, 0.25, 0.7]),
        (4_000_000_000, 1, [1.0, 0.5, 1e-30]),
        (4_294_967_295, 0, [0.5; 3]),
    ]
    .map(|(id, element, local)| BoundVertex { id, element, local })
    .to_vec()
}

fn quads() -> Vec<BoundQuad> {
    vec![
        BoundQuad { id: 1, vertices: [3, 900, 4_000_000_000, 4_294_967_295] },
        BoundQuad { id: 4_294_967_294, vertices: [4_294_967_295, 4_000_000_000, 900, 3] },
    ]
}

fn body_on_the_wire() -> v1::BodyStructure {
    v1::BodyStructure {
        node_count: 8,
        node_ids: (0..8).collect(),
        node_rest_m: vec![0.0; 24],
        element_ids: vec![0, 1],
        element_nodes: (0..8).chain(0..8).collect(),
        vertex_ids: vertices().iter().map(|vertex| vertex.id).collect(),
        vertex_elements: vertices().iter().map(|vertex| vertex.element).collect(),
        vertex_local: vertices().iter().flat_map(|vertex| vertex.local).collect(),
        quad_ids: quads().iter().map(|quad| quad.id).collect(),
        quad_vertices: quads().iter().flat_map(|quad| quad.vertices).collect(),
        ..Default::default()
    }
}

#[test]
fn replica_and_core_compute_the_same_surface_hash() {
    let mut hasher = StateHasher::default();
    for _body in 0..2 {
        hash_body(&mut hasher, vertices().into_iter(), quads().into_iter());
    }
    let mut keyframe =
        v1::Keyframe { topology_version: 0, bodies: vec![body_on_the_wire(); 2], surface_hash: hasher.finish() };
    assert_eq!(Replica::default().apply_keyframe(&keyframe), Ok(()));

    keyframe.surface_hash ^= 1;
    let refused = Replica::default().apply_keyframe(&keyframe);
    assert!(matches!(refused, Err(ReplicaError::HashMismatch { .. })));
}
