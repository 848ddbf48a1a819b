//! Scenes: [`mod@file`] reads them with the meshes, label maps and edges that they name, [`catalog`] has those
//! that come with the program, [`mod@examine`] says what is wrong with them, [`dial`] sets them between fast and exact by what was measured.
//!
//! The only crate of the server that knows file formats. Deliberately absent: sessions, time, the network.

mod builtin;
pub mod catalog;
pub mod cost;
pub mod dial;
mod edge_file;
pub mod error;
pub mod examine;
pub mod file;
mod kind;
mod label_map;
mod label_map_file;
mod label_surface;
mod mesh_faults;
mod mesh_file;
mod nifti;
mod nrrd;

pub use error::ReadError;
