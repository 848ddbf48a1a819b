//! The dial from fast to exact: settings of effort, and what each was measured to cost and to err.

mod choice;
pub mod pareto;
mod setting;

pub use choice::{Choice, DialError, ParetoFronts};
pub use pareto::{ParetoError, ParetoFront, ParetoPoint};
pub use setting::{FinerRegions, Setting};
