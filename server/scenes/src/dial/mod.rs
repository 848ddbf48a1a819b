//! The dial from fast to exact: settings of effort, and what each was measured to cost and to err.

mod choice;
pub mod front;
mod setting;

pub use choice::{Choice, DialError, Fronts};
pub use front::{Front, FrontError, FrontPoint};
pub use setting::{FinerRegions, Setting};
