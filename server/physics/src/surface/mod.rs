//! The dual-contoured surface: one vertex per connected component of the voxels of a dual cell,
//! one quad per boundary link, two opposite quads per parted link.
//!
//! Ids are a pure function of the lattice, so that a stream does not depend on when a viewer joined.

pub mod delta;

use crate::grid::VoxelId;

/// Id of a surface vertex: `dual cell index * 8 + component`.
pub type VertexId = u32;
/// Id of a quad: `(lower cell index of its link * 3 + axis) * 2 + side`.
pub type QuadId = u32;

/// A vertex of the surface, in the reference configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceVertex {
    /// Reference position, m.
    pub position_m: [f32; 3],
    /// The voxel of its component that is nearest: the vertex moves with that voxel's element.
    pub voxel: VoxelId,
}

/// Four vertices, counter-clockwise seen from outside the material.
pub type Quad = [VertexId; 4];

/// What [`rebuild`](self) changed; an id occurs at most once in each list, ascending.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceChange {
    /// Vertices that are gone.
    pub removed_vertices: Vec<VertexId>,
    /// Vertices that are new or have moved or are bound to another voxel.
    pub upserted_vertices: Vec<VertexId>,
    /// Quads that are gone.
    pub removed_quads: Vec<QuadId>,
    /// Quads that are new or join other vertices.
    pub upserted_quads: Vec<QuadId>,
}
