//! The physics of one Kerf scene: composite-FEM tissue, tools, fracture and the surface that is seen.
//!
//! Deliberately absent: I/O, clocks, async, hash order and threads of its own. Input comes in as
//! values ([`StepInputs`]), time through [`StageClock`], threads as [`Workers`]; the same scene and
//! the same inputs give the same bits.
//!
//! Conventions: SI units; scene frame right-handed, +y up, +z toward the user; `f64` for state,
//! forces and residuals, `f32` inside preconditioners and in what leaves for the wire.

pub mod body;
mod boundary;
mod contact;
pub mod energy_terms;
pub mod fault;
mod fem;
mod fracture;
pub mod grid;
mod hash;
mod ledger;
mod math;
mod params;
pub mod scene;
mod solve;
pub mod stage;
pub mod step_io;
pub mod surface;
pub mod tool;
mod view;
pub mod workers;
pub mod world;

pub use hash::StateHasher;
pub use math::{Mat3, Quat, Vec3};
pub use params::StepParams;
pub use scene::{Scene, SceneDesc, SceneError};
pub use stage::{NoClock, Stage, StageClock, StepProfile};
pub use step_io::{StepInputs, StepOutput, ToolInput};
pub use workers::Workers;
pub use world::World;

#[cfg(test)]
extern crate self as kerf_physics;
#[cfg(test)]
#[path = "../tests/main.rs"]
mod tests;
