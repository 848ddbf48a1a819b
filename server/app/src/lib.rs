//! What `kerf-server` is made of.

pub mod glb;
