//! Composite finite elements: material, element matrices, rotations and forces.

pub mod composite;
pub mod corotation;
pub mod lanes;
pub mod material;
pub mod packed;
