//! What leaves for the viewers: the lattice (nodes, elements) and the surface bound to it.
//!
//! A keyframe binds surface vertices to elements and elements to nodes; per step only node
//! displacements go out, and the offsets of the few vertices that are adapted to a blade; when links part
//! a patch says what changed in the structure.

use super::{Quad, QuadId, VertexId};

/// A surface vertex bound to a composite element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundVertex {
    /// Stable id.
    pub id: VertexId,
    /// Element it moves with.
    pub element: u32,
    /// Trilinear coordinates in the element, 0..=1 inside it; corner `c` of the element has
    /// coordinates `(c & 1, c >> 1 & 1, c >> 2)`.
    pub local: [f32; 3],
    /// Index into the object's material list, as [`crate::grid::Voxel::material`].
    pub material: u16,
}

/// Weights of a vertex beside what is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldVertex {
    /// Vertex id.
    pub id: VertexId,
    /// How much the displacement of each corner of its element counts in its own: less than one in all.
    pub weights: [f32; 8],
}

/// An element's nodes, corner `c` at `(c & 1, c >> 1 & 1, c >> 2)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LatticeElement {
    /// Element id.
    pub id: u32,
    /// Node ids.
    pub nodes: [u32; 8],
}

/// A node at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatticeNode {
    /// Node id; also the index of its displacement in [`crate::World::node_displacements_m`].
    pub id: u32,
    /// Reference position, m.
    pub rest_m: [f32; 3],
}

/// A quad and its id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoundQuad {
    /// Stable id.
    pub id: QuadId,
    /// Vertex ids, counter-clockwise seen from outside.
    pub vertices: Quad,
}

/// Structure of one object: the whole of it in a keyframe, what changed in a patch. Vertices and
/// quads never go away.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyStructure {
    /// New or changed nodes, ids ascending.
    pub nodes: Vec<LatticeNode>,
    /// New or changed elements, ids ascending.
    pub elements: Vec<LatticeElement>,
    /// New or changed vertices, ids ascending.
    pub vertices: Vec<BoundVertex>,
    /// Those of the vertices that do not move with their elements alone, ids ascending.
    pub held: Vec<HeldVertex>,
    /// New or changed quads, ids ascending.
    pub quads: Vec<BoundQuad>,
    /// Number of node slots: length of the displacement array over three.
    pub node_count: u32,
}

/// Structure of every object at one topology version.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Keyframe {
    /// Topology version it describes.
    pub topology_version: u64,
    /// One entry per object of the scene.
    pub bodies: Vec<BodyStructure>,
    /// Hash of the surface, to check a replica by; see [`super::hash`].
    pub surface_hash: u64,
}

/// A vertex that is not where its element has it: the surface is adapted to a blade there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdaptedVertex {
    /// Vertex id.
    pub id: VertexId,
    /// From the element's place for it to where it is shown, m, scene frame.
    pub offset_m: [f32; 3],
    /// It is on a blade; others follow those that are.
    pub on_blade: bool,
}

/// What changed from one topology version to the next.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TopologyPatch {
    /// Version it applies to.
    pub from_version: u64,
    /// Version it leads to: `from_version + 1`, unless others were appended.
    pub to_version: u64,
    /// One entry per object of the scene.
    pub bodies: Vec<BodyStructure>,
    /// Hash of the surface after it.
    pub surface_hash: u64,
}

impl TopologyPatch {
    /// Goes on with the patch that begins where this one leads to.
    pub fn append(&mut self, next: &Self) {
        debug_assert_eq!(self.to_version, next.from_version);
        self.to_version = next.to_version;
        self.surface_hash = next.surface_hash;
        for (body, next) in self.bodies.iter_mut().zip(&next.bodies) {
            body.node_count = next.node_count;
            upsert(&mut body.nodes, &next.nodes, |node| node.id);
            upsert(&mut body.elements, &next.elements, |element| element.id);
            upsert(&mut body.vertices, &next.vertices, |vertex| vertex.id);
            // A vertex that comes anew has the weights that come with it, or none.
            body.held.retain(|held| next.vertices.binary_search_by_key(&held.id, |vertex| vertex.id).is_err());
            upsert(&mut body.held, &next.held, |held| held.id);
            upsert(&mut body.quads, &next.quads, |quad| quad.id);
        }
    }
}

/// Replaces the items whose ids come anew and adds the others; ids stay ascending.
fn upsert<T: Copy>(items: &mut Vec<T>, new: &[T], id: impl Fn(&T) -> u32) {
    // Of two with one id the later one comes last.
    items.extend_from_slice(new);
    items.sort_by_key(&id);
    let mut kept = 0;
    for index in 0..items.len() {
        if items.get(index + 1).is_none_or(|next| id(next) != id(&items[index])) {
            items[kept] = items[index];
            kept += 1;
        }
    }
    items.truncate(kept);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_patches_in_one_say_what_both_say_one_after_the_other() {
        let node = |id, x| LatticeNode { id, rest_m: [x, 0.0, 0.0] };
        let patch = |from_version, nodes: &[LatticeNode]| {
            let body = BodyStructure { nodes: nodes.to_vec(), node_count: 9, ..BodyStructure::default() };
            let surface_hash = from_version;
            TopologyPatch { from_version, to_version: from_version + 1, bodies: vec![body], surface_hash }
        };
        let mut both = patch(3, &[node(2, 0.1), node(5, 0.2), node(7, 0.3)]);
        both.append(&patch(4, &[node(1, 0.4), node(5, 0.5), node(8, 0.6)]));
        let nodes = [node(1, 0.4), node(2, 0.1), node(5, 0.5), node(7, 0.3), node(8, 0.6)];
        assert_eq!(both, TopologyPatch { from_version: 3, to_version: 5, surface_hash: 4, ..patch(4, &nodes) });
    }

    #[test]
    fn weights_beside_what_is_held_go_with_the_newest_word_on_their_vertex() {
        let vertex = |id| BoundVertex { id, element: 0, local: [0.5; 3], material: 0 };
        let held = |id, weight| HeldVertex { id, weights: [weight; 8] };
        let patch = |from_version, vertices: &[u32], held: &[HeldVertex]| {
            let vertices = vertices.iter().map(|id| vertex(*id)).collect();
            let body = BodyStructure { vertices, held: held.to_vec(), ..BodyStructure::default() };
            TopologyPatch { from_version, to_version: from_version + 1, bodies: vec![body], surface_hash: 0 }
        };
        let mut both = patch(0, &[1, 2, 3], &[held(1, 0.1), held(2, 0.1), held(3, 0.1)]);
        both.append(&patch(1, &[2, 3, 4], &[held(2, 0.05), held(4, 0.1)]));
        assert_eq!(both.bodies[0].held, [held(1, 0.1), held(2, 0.05), held(4, 0.1)]);
    }
}
