//! Fracture: the force-capped front along a blade's edge and the links it parts.

pub mod front;
pub mod sweep;
