//! Cuts: the force-capped front against Griffith's balance.

pub mod rig;
pub mod steady;
pub mod stroke;
pub mod variations;
