//! The surface of a world as it is now, for a file.

use std::collections::BTreeSet;

use kerf_physics::World;
use kerf_physics::surface::delta::{BodyStructure, BoundVertex};

use crate::glb::{Face, Mesh, Triangle};

/// The deformed surface of every object.
pub fn of(world: &mut World) -> Mesh {
    let mut mesh = Mesh::default();
    let mut displacements_m = Vec::new();
    for (object, body) in world.keyframe().bodies.iter().enumerate() {
        displacements_m.clear();
        world.node_displacements_m(object, &mut displacements_m);
        append(&mut mesh, body, &displacements_m);
    }
    mesh
}

fn append(mesh: &mut Mesh, body: &BodyStructure, displacements_m: &[f32]) {
    let first = mesh.positions_m.len() as u32;
    mesh.positions_m.extend(body.vertices.iter().map(|vertex| position_m(body, displacements_m, vertex)));
    let index = |id: u32| body.vertices.binary_search_by_key(&id, |v| v.id).expect("a quad's vertices exist") as u32;
    // A parted link has two quads, whose ids differ in the last bit; a boundary link has one.
    let ids: BTreeSet<u32> = body.quads.iter().map(|quad| quad.id).collect();
    for quad in &body.quads {
        let face = if ids.contains(&(quad.id ^ 1)) { Face::Cut } else { Face::Skin };
        let [a, b, c, d] = quad.vertices.map(|id| first + index(id));
        mesh.triangles.extend([[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face }));
    }
}

/// Where a vertex is: its place in its element, between the element's nodes where they are.
fn position_m(body: &BodyStructure, displacements_m: &[f32], vertex: &BoundVertex) -> [f32; 3] {
    let element = body.elements.binary_search_by_key(&vertex.element, |e| e.id).expect("a vertex's element exists");
    let mut position_m = [0.0; 3];
    for (corner, node) in body.elements[element].nodes.iter().enumerate() {
        let slot = body.nodes.binary_search_by_key(node, |n| n.id).expect("an element's nodes exist");
        let weight: f32 = (0..3)
            .map(|axis| if corner >> axis & 1 == 1 { vertex.local[axis] } else { 1.0 - vertex.local[axis] })
            .product();
        for axis in 0..3 {
            let displacement_m = displacements_m[*node as usize * 3 + axis];
            position_m[axis] += weight * (body.nodes[slot].rest_m[axis] + displacement_m);
        }
    }
    position_m
}

#[cfg(test)]
mod tests {
    use kerf_physics::surface::delta::{BoundQuad, LatticeElement, LatticeNode};

    use super::*;

    #[test]
    fn vertices_follow_their_nodes_and_pairs_of_quads_are_cuts() {
        let corner = |c: u32| [c & 1, c >> 1 & 1, c >> 2].map(|v| v as f32);
        let vertex = |id, local| BoundVertex { id, element: 7, local };
        let quad = |id| BoundQuad { id, vertices: [2, 4, 6, 8] };
        let body = BodyStructure {
            nodes: (0..8).map(|id| LatticeNode { id, rest_m: corner(id) }).collect(),
            elements: vec![LatticeElement { id: 7, nodes: std::array::from_fn(|n| n as u32) }],
            vertices: [2, 4, 6, 8].map(|id| vertex(id, [0.25, 0.5, 1.0])).to_vec(),
            quads: vec![quad(10), quad(11), quad(13)],
            node_count: 8,
            ..BodyStructure::default()
        };
        let mut mesh = Mesh::default();
        let lifted: Vec<f32> = (0..8).flat_map(|_| [0.0, 2.0, 0.0]).collect();
        append(&mut mesh, &body, &lifted);
        assert_eq!(mesh.positions_m[3], [0.25, 2.5, 1.0]);
        let cuts = mesh.triangles.iter().filter(|t| t.face == Face::Cut).count();
        assert_eq!((mesh.triangles.len(), cuts), (6, 4));
    }
}
