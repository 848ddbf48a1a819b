//! Composite finite elements: material, element matrices, rotations and forces.

pub mod anisotropic;
pub mod block;
pub mod composite;
mod corotation;
pub mod ground;
pub mod held;
pub mod homogenise;
pub mod lanes;
pub mod material;
pub mod matrices;
pub mod packed;
mod relaxation;
mod rotation;
pub mod viscosity;
