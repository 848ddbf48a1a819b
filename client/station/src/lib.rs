//! A haptic station: poses of a device go to a session, forces are rendered here at the device's rate.
//!
//! Three kinds of threads. The *servo* is called by the device, a thousand times a second, and never waits: it reads
//! the newest contact from a slot and leaves its poses in another. The *link* exchanges both with the server. The
//! *monitor* tells people what is going on.
//!
//! Deliberately absent: torques. No device that is supported renders them.

pub mod config;
pub mod device;
pub mod doctor;
pub mod experiment;
pub mod link;
pub mod log;
pub mod mapping;
pub mod monitor;
pub mod run_report;
pub mod servo;
pub mod station;
#[cfg(feature = "virtual-time")]
pub mod virtual_time;
