//! Whole stations.

mod allocation;
mod doctor;
mod faults;
mod haply;
mod openhaptics;
mod probe;
mod server;
