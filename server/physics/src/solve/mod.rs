//! The implicit velocity solve: matrix-free operators on every level of the hierarchy, a multigrid
//! preconditioner over them, and preconditioned conjugate gradients.

pub mod assembly;
pub mod coarsest;
mod cycle_level;
mod diagonal;
mod lag;
mod lists;
pub mod multigrid;
pub mod operator;
pub mod pcg;
mod rows;
pub mod spring;
pub mod vectors;
