//! How stiff a blade feels: presses on layers and blocks, and what theory says of them.

pub mod block;
pub mod layer;
pub mod strip;
