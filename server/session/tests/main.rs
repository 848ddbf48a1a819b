//! Sessions, built-in scenes and scene files: one module a subject.

#[path = "../../physics/tests/support/mod.rs"]
mod support;

mod governor;
mod label_map;
mod paper_cuts;
mod paper_models;
mod points;
mod real_tissue;
mod session;
mod two_organs;
mod unwatched;
mod voxel_counts;
