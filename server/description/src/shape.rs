//! Solid shapes: formulas, meshes and label maps.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Triangle meshes by the `file` their shape names, or by the key of [`ShapeDesc::mesh`].
pub type Meshes = std::collections::BTreeMap<String, TriangleMesh>;

/// A triangle mesh as read from a file, before scaling.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions in the file's units.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// What of the file is no part of it.
    pub strays: Strays,
}

/// Pieces of a segmentation that are too small to be meant, which are left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Strays {
    /// How many.
    pub pieces: usize,
    /// Voxels of the file in all of them.
    pub voxels: usize,
}

/// A solid shape, scene frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum ShapeDesc {
    /// Axis-aligned box.
    Box {
        /// Lower corner, m.
        min_m: [f64; 3],
        /// Upper corner, m.
        max_m: [f64; 3],
    },
    /// Sphere.
    Sphere {
        /// Centre, m.
        center_m: [f64; 3],
        /// Radius, m.
        radius_m: f64,
    },
    /// Axis-aligned ellipsoid.
    Ellipsoid {
        /// Centre, m.
        center_m: [f64; 3],
        /// Semi-axes, m.
        semi_axes_m: [f64; 3],
    },
    /// Capsule: all points within `radius_m` of a segment.
    Capsule {
        /// One end of the segment, m.
        from_m: [f64; 3],
        /// The other end, m.
        to_m: [f64; 3],
        /// Radius, m.
        radius_m: f64,
    },
    /// Smooth union of shapes, less what others take away.
    SmoothUnion {
        /// Distance over which surfaces blend, m; 0: sharp edges.
        blend_m: f64,
        /// What is united; no meshes, no unions.
        parts: Vec<ShapeDesc>,
        /// What is taken away from the union, with the same blend; no meshes, no unions.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        without: Vec<ShapeDesc>,
    },
    /// A closed mesh from an OBJ, STL, PLY, VTK (`.vtu`, `.vtp`) or Gmsh (`.msh`) file; of cells with a volume their
    /// boundary.
    Mesh {
        /// Path, relative to the scene file.
        file: String,
        /// Metres per unit of the file.
        scale_m_per_unit: f64,
        /// Scene position of the file's origin, m. Default: the scene's origin.
        #[serde(default)]
        offset_m: [f64; 3],
    },
    /// What has some labels in a label map, a NIfTI-1 file (`.nii`, `.nii.gz`) whose voxels are placed by
    /// its sform, else its qform. The patient lies on the back, seen from the feet: of the file's axes
    /// right is -x, anterior +y (up), superior -z.
    LabelMap {
        /// Path, relative to the scene file.
        file: String,
        /// Labels, 1 to 65,535, that belong to the shape. Default: all but 0. As shapes of an object's
        /// regions, single labels give each its material.
        #[serde(default)]
        labels: Vec<u16>,
        /// Size in the scene over the size in the file. Default 1.
        #[serde(default = "default_scale")]
        scale: f64,
        /// Scene position of the file's origin, m. Default: the scene's origin.
        #[serde(default)]
        offset_m: [f64; 3],
    },
}

fn default_scale() -> f64 {
    1.0
}

/// A mesh among a scene's [`Meshes`], and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedMesh {
    /// Its key.
    pub key: String,
    /// Metres per unit of the mesh.
    pub scale_m_per_unit: f64,
    /// Scene position of the mesh's origin, m.
    pub offset_m: [f64; 3],
}

impl ShapeDesc {
    /// The mesh that the shape is; `None` for a formula. The surface of labels is a mesh in metres, by the
    /// key `file#[labels]`.
    #[must_use]
    pub fn mesh(&self) -> Option<PlacedMesh> {
        match self {
            Self::Mesh { file, scale_m_per_unit, offset_m } => {
                Some(PlacedMesh { key: file.clone(), scale_m_per_unit: *scale_m_per_unit, offset_m: *offset_m })
            }
            Self::LabelMap { file, labels, scale, offset_m } => {
                let key = format!("{file}#{labels:?}");
                Some(PlacedMesh { key, scale_m_per_unit: *scale, offset_m: *offset_m })
            }
            _ => None,
        }
    }
}
