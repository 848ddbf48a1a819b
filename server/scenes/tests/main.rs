//! Built-in scenes and scene files: one module a subject.

#[path = "../../physics/tests/support/mod.rs"]
mod support;

mod label_map;
mod paper_cuts;
mod real_tissue;
mod two_organs;
mod voxel_counts;
