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
    /// Version it leads to: `from_version + 1`.
    pub to_version: u64,
    /// One entry per object of the scene.
    pub bodies: Vec<BodyStructure>,
    /// Hash of the surface after it.
    pub surface_hash: u64,
}
