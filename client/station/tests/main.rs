//! Whole stations.

mod allocation;
mod faults;
mod haply;
mod openhaptics;
mod probe;
mod server;
