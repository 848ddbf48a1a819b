//! Sessions of Kerf: where scenes come from and what runs them.

pub mod catalog;
mod mesh_file;
