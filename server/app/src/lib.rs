//! The Kerf server as a library, so that tests run it in their own process: one module per subcommand,
//! and what `serve` is made of.
//!
//! Services are thin: they turn messages into calls of `kerf-session` and back. Deliberately absent:
//! physics, pacing, queues of state.

/// The version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

mod agones;
pub mod allocate;
mod book;
pub mod check;
pub mod config;
mod convert;
mod embedded;
mod encode;
mod export;
mod grpc;
mod incoming;
pub mod journal;
mod large_messages;
pub mod machine;
pub mod metrics;
mod pace;
mod places;
mod print_config;
mod progress;
pub mod recording;
pub mod remote;
pub mod replay;
pub mod scene_args;
mod scene_list;
pub mod scenes;
pub mod schema;
pub mod script;
pub mod security;
pub mod serve;
mod shutdown;
pub mod simulate;

/// Structure and states as viewers get them over the wire, and steps as they are asked for.
pub mod wire {
    pub use crate::convert::stepping::steps;
    pub use crate::convert::view::{keyframe, patch};
    pub use crate::encode::{EncodedState, Encoder, Encoding, HeldReference};
}
mod status;
mod storage;
mod telemetry;
pub mod top;
pub mod traces;
pub mod tradeoff;
mod traffic;
mod viewer;
#[cfg(test)]
mod virtual_world;
mod watchdog;
