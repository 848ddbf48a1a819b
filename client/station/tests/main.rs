//! Whole stations.

mod allocation;
mod faults;
mod openhaptics;
mod server;
