//! What a body is made of and what acts on it: nothing of this changes.

use super::loads::{FaceLoad, Hold, VoxelLoad};
use super::material::Material;
use crate::Vec3;
use crate::fem::composite::CompositeTables;
use crate::scene::{ElementKind, FractureRule};
use std::sync::Arc;

/// The constant part of a body, as the scene gave it. A body shares it with the snapshots of it.
pub struct Description {
    /// Name in the scene.
    pub name: String,
    /// Materials, by a voxel's material index.
    pub materials: Vec<Material>,
    /// What decides where a blade parts it.
    pub fracture_rule: FractureRule,
    /// Which element a composite cell gets.
    pub(super) element_kind: ElementKind,
    /// Gravity, m/s^2, scene frame.
    pub(super) gravity_m_per_s2: Vec3,
    /// Whether each voxel is held, by voxel.
    pub(super) holds: Vec<Hold>,
    /// Forces at the centres of voxels other than gravity, by voxel, ascending.
    pub(super) voxel_loads: Vec<VoxelLoad>,
    /// Tractions on faces of voxels, by voxel, ascending.
    pub(super) face_loads: Vec<FaceLoad>,
    /// Integrals over a cell of one voxel.
    pub(super) single_voxel: CompositeTables,
    /// Integrals over a cell's voxels, by log2 of an element's size in cells of the lattice.
    pub(super) tables: Vec<CompositeTables>,
}

impl Description {
    /// Of a body that was read from a file, until it is completed.
    pub(super) fn absent() -> Arc<Self> {
        Arc::new(Self {
            name: String::new(),
            materials: Vec::new(),
            fracture_rule: FractureRule::default(),
            element_kind: ElementKind::default(),
            gravity_m_per_s2: Vec3::zeros(),
            holds: Vec::new(),
            voxel_loads: Vec::new(),
            face_loads: Vec::new(),
            single_voxel: CompositeTables::new(0, 1.0),
            tables: Vec::new(),
        })
    }
}
