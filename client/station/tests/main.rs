//! Whole stations.

mod allocation;
mod faults;
mod server;
