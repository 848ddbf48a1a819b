//! Haptic devices behind one trait.
//!
//! The device owns the rhythm: it calls the [`Servo`] once a period and renders what that answers. So a vendor's
//! scheduler, a service that answers one message with another, and a thread of our own are all the same to the servo.
//! All quantities are in the device's own frame, SI units; [`crate::config::MappingConfig`] says how that lies in the scene.

#[cfg(unix)]
pub mod gamepad;
pub mod haply;
#[cfg(unix)]
pub mod mouse;
pub mod openhaptics;
pub(crate) mod paced;
pub mod recorded;
pub mod simulated;

use std::sync::atomic::AtomicBool;

use nalgebra::{UnitQuaternion, Vector3};

use crate::config::{DeviceConfig, DeviceKind};

/// Opens a device.
///
/// # Errors
/// What was tried, how it failed and what to do.
pub fn open(config: &DeviceConfig) -> Result<Box<dyn Device>, DeviceError> {
    Ok(match &config.kind {
        DeviceKind::Simulated(simulated) => Box::new(simulated::Simulated::new(simulated)),
        DeviceKind::OpenHaptics(openhaptics) => Box::new(openhaptics::OpenHaptics::open(openhaptics)?),
        DeviceKind::Haply(haply) => Box::new(haply::Haply::open(haply)?),
        #[cfg(unix)]
        DeviceKind::Gamepad(gamepad) => Box::new(gamepad::Gamepad::open(gamepad)?),
        #[cfg(unix)]
        DeviceKind::Mouse(mouse) => Box::new(mouse::Mouse::open(mouse)?),
        DeviceKind::Recorded(recorded) => Box::new(recorded::Recorded::open(recorded, &config.tools)?),
    })
}

/// What a device bears that no force moves: its tool is where it is, so nothing limits it.
fn unmoved(name: String, reach_m: f64) -> DeviceInfo {
    DeviceInfo {
        name,
        rate_hz: 1000.0,
        peak_force_n: 1e3,
        max_stiffness_n_per_m: 1e9,
        max_damping_n_s_per_m: 0.0,
        apparent_mass_kg: 1e9,
        workspace_m: [Vector3::repeat(-reach_m), Vector3::repeat(reach_m)],
    }
}

/// Opens a file that answers at once, with or without something to read.
#[cfg(unix)]
fn nonblocking(path: &std::path::Path, also_write: bool) -> std::io::Result<std::fs::File> {
    use std::os::unix::fs::OpenOptionsExt;
    std::fs::OpenOptions::new().read(true).write(also_write).custom_flags(libc::O_NONBLOCK).open(path)
}

/// A haptic device.
pub trait Device: Send {
    /// What it is and what it bears.
    fn info(&self) -> &DeviceInfo;

    /// Calls the servo once a period until `stop` is set. No force is left on the device when this returns, whatever
    /// the reason.
    ///
    /// # Errors
    /// The device is gone or refuses to go on.
    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError>;
}

/// What a device calls once a period, from whatever thread. It neither waits nor allocates nor panics.
pub trait Servo: Send {
    /// The force to be rendered, N, in the device's frame, until the next call; `now_ns` is the monotonic clock of
    /// [`kerf_load::clock`].
    fn tick(&mut self, now_ns: u64, state: &DeviceState) -> Vector3<f64>;
}

/// What a device is and what it bears.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceInfo {
    /// For people: model and serial number, as far as they are known.
    pub name: String,
    /// Calls of the servo a second that it aims at, Hz.
    pub rate_hz: f64,
    /// Greatest force for a moment, N.
    pub peak_force_n: f64,
    /// Greatest stiffness that it renders without buzzing, N/m.
    pub max_stiffness_n_per_m: f64,
    /// Greatest damping that it renders without buzzing, N s/m.
    pub max_damping_n_s_per_m: f64,
    /// Mass that the hand feels at its tip, kg.
    pub apparent_mass_kg: f64,
    /// Corners of the box that its tip reaches, m.
    pub workspace_m: [Vector3<f64>; 2],
}

/// Where a device is now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeviceState {
    /// Of its tip, m.
    pub position_m: Vector3<f64>,
    /// Of its stylus.
    pub orientation: UnitQuaternion<f64>,
    /// Of its tip, m/s.
    pub velocity_m_per_s: Vector3<f64>,
    /// Bit i: button i is down.
    pub buttons: u32,
    /// Why its pose is not to be believed or no force is to be rendered now, as "not calibrated"; `None`: all is well.
    pub hold: Option<&'static str>,
}

/// A device failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{device}: {what}; {remedy}")]
pub struct DeviceError {
    /// Which.
    pub device: String,
    /// What was tried and how it failed.
    pub what: String,
    /// What to do about it.
    pub remedy: String,
}
