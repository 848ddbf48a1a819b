//! Loads other than gravity.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ShapeDesc;

/// A load other than gravity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum LoadDesc {
    /// Force per area on the boundary faces of voxels whose outward face normal is `face` and whose
    /// centre lies in `region`.
    Traction {
        /// Which voxels.
        region: ShapeDesc,
        /// Which of their faces.
        face: Face,
        /// Traction, Pa, scene frame, dead (it does not turn with the face).
        traction_pa: [f64; 3],
    },
    /// Force per volume on the voxels in `region`.
    BodyForce {
        /// Which voxels.
        region: ShapeDesc,
        /// Force density, N/m^3, scene frame.
        force_n_per_m3: [f64; 3],
    },
}

/// A face of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Face {
    /// -x.
    MinX,
    /// +x.
    MaxX,
    /// -y.
    MinY,
    /// +y.
    MaxY,
    /// -z.
    MinZ,
    /// +z.
    MaxZ,
}

impl Face {
    /// The axis of the face's normal and which way it points.
    #[must_use]
    pub fn axis_and_step(self) -> (usize, i32) {
        match self {
            Face::MinX => (0, -1),
            Face::MaxX => (0, 1),
            Face::MinY => (1, -1),
            Face::MaxY => (1, 1),
            Face::MinZ => (2, -1),
            Face::MaxZ => (2, 1),
        }
    }
}
