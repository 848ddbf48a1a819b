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
    /// Index into the object's material list, as [`crate::Voxel::material`].
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

/// Why a patch does not go on from what it is put to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// It begins at another version.
    #[error("a patch of version {from} follows version {have}")]
    Version {
        /// Version that the structure has.
        have: u64,
        /// Version that the patch applies to.
        from: u64,
    },
    /// It is of a scene with another number of objects.
    #[error("a patch of {got} objects follows the structure of {have}")]
    Objects {
        /// Objects of the structure.
        have: usize,
        /// Objects of the patch.
        got: usize,
    },
}

impl BodyStructure {
    /// Follows a change: what comes anew replaces what was known by its id, all else is added.
    fn follow(&mut self, change: &Self) {
        merge(&mut self.nodes, &change.nodes, |node| node.id);
        merge(&mut self.elements, &change.elements, |element| element.id);
        merge(&mut self.vertices, &change.vertices, |vertex| vertex.id);
        // A vertex that comes anew has the weights that come with it, or none.
        self.held.retain(|held| change.vertices.binary_search_by_key(&held.id, |vertex| vertex.id).is_err());
        merge(&mut self.held, &change.held, |held| held.id);
        merge(&mut self.quads, &change.quads, |quad| quad.id);
        self.node_count = change.node_count;
    }
}

impl Keyframe {
    /// Follows a patch to the version that it leads to: the keyframe is then as one taken there.
    ///
    /// # Errors
    /// The patch is not one of this version and scene; nothing is changed.
    pub fn follow(&mut self, patch: &TopologyPatch) -> Result<(), Unfit> {
        follow_all(&mut self.bodies, &mut self.topology_version, patch)?;
        self.surface_hash = patch.surface_hash;
        Ok(())
    }
}

impl TopologyPatch {
    /// Goes on with the patch that begins where this one leads to: it then says what both say one after the other.
    ///
    /// # Errors
    /// The patch begins elsewhere or is of another scene; nothing is changed.
    pub fn append(&mut self, next: &Self) -> Result<(), Unfit> {
        follow_all(&mut self.bodies, &mut self.to_version, next)?;
        self.surface_hash = next.surface_hash;
        Ok(())
    }
}

/// Takes the structures of a scene's objects from `version` to where `patch` leads.
fn follow_all(bodies: &mut [BodyStructure], version: &mut u64, patch: &TopologyPatch) -> Result<(), Unfit> {
    if patch.from_version != *version {
        return Err(Unfit::Version { have: *version, from: patch.from_version });
    }
    if patch.bodies.len() != bodies.len() {
        return Err(Unfit::Objects { have: bodies.len(), got: patch.bodies.len() });
    }
    bodies.iter_mut().zip(&patch.bodies).for_each(|(body, change)| body.follow(change));
    *version = patch.to_version;
    Ok(())
}

/// Replaces and adds entries; both lists ascend by id.
fn merge<T: Copy>(entries: &mut Vec<T>, changes: &[T], id: impl Fn(&T) -> u32) {
    if changes.is_empty() {
        return;
    }
    let mut merged = Vec::with_capacity(entries.len() + changes.len());
    let mut rest = entries.as_slice();
    for change in changes {
        let (before, from) = rest.split_at(rest.partition_point(|entry| id(entry) < id(change)));
        merged.extend_from_slice(before);
        merged.push(*change);
        rest = &from[from.partition_point(|entry| id(entry) == id(change))..];
    }
    merged.extend_from_slice(rest);
    *entries = merged;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_replace_and_add_by_id() {
        let mut entries = vec![(1, 'a'), (3, 'a'), (5, 'a')];
        merge(&mut entries, &[(0, 'b'), (3, 'b'), (4, 'b'), (9, 'b')], |(id, _)| *id);
        assert_eq!(entries, [(0, 'b'), (1, 'a'), (3, 'b'), (4, 'b'), (5, 'a'), (9, 'b')]);
    }

    #[test]
    fn weights_beside_what_is_held_go_with_the_newest_word_on_their_vertex() {
        let vertex = |id| BoundVertex { id, element: 0, local: [0.5; 3], material: 0 };
        let held = |id, weight| HeldVertex { id, weights: [weight; 8] };
        let body = |vertices: &[u32], held: &[HeldVertex]| {
            let vertices = vertices.iter().map(|id| vertex(*id)).collect();
            BodyStructure { vertices, held: held.to_vec(), ..BodyStructure::default() }
        };
        let mut followed = body(&[1, 2, 3], &[held(1, 0.1), held(2, 0.1), held(3, 0.1)]);
        followed.follow(&body(&[2, 3, 4], &[held(2, 0.05), held(4, 0.1)]));
        assert_eq!(followed.held, [held(1, 0.1), held(2, 0.05), held(4, 0.1)]);
    }

    #[test]
    fn a_patch_that_does_not_fit_changes_nothing() {
        let keyframe =
            || Keyframe { topology_version: 3, bodies: vec![BodyStructure::default()], ..Keyframe::default() };
        let patch = |from_version, objects| TopologyPatch {
            from_version,
            to_version: from_version + 1,
            bodies: vec![BodyStructure { node_count: 9, ..BodyStructure::default() }; objects],
            surface_hash: 1,
        };
        for (unfit, why) in [
            (patch(4, 1), Unfit::Version { have: 3, from: 4 }),
            (patch(2, 1), Unfit::Version { have: 3, from: 2 }),
            (patch(3, 2), Unfit::Objects { have: 1, got: 2 }),
        ] {
            let mut followed = keyframe();
            assert_eq!(followed.follow(&unfit), Err(why));
            assert_eq!(followed, keyframe());
        }
        let mut first = patch(3, 1);
        assert_eq!(first.append(&patch(5, 1)), Err(Unfit::Version { have: 4, from: 5 }));
        assert_eq!(first, patch(3, 1));
    }
}
