//! What `kerf-load` is made of.

pub mod plot;
