//! Composite finite elements: material, element matrices, rotations and forces.

pub mod anisotropic;
pub mod composite;
pub mod corotation;
pub mod homogenise;
pub mod lanes;
pub mod material;
pub mod packed;
pub mod viscosity;
