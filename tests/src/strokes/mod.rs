//! Random strokes by the thousand through a model, and what must hold after each of them: nothing is rolled
//! back, no voxel is lost, the surface stays closed and keeps its volume, no dust, every joule booked.

pub mod bodies;
pub mod campaign;
mod hand;
mod inspect;
pub mod memory;
pub mod model;
pub mod report;
