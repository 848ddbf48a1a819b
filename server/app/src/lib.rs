//! The Kerf server as a library, so that tests run it in their own process.
//!
//! Services are thin: they turn messages into calls of `kerf-session` and back. Deliberately absent:
//! physics, pacing, queues of state.

pub mod config;
mod convert;
mod grpc;
mod incoming;
mod scenes;
pub mod serve;
mod shutdown;
mod status;
mod telemetry;
