//! Phantom Omni, 3D Systems Touch and their kin, through the vendor's library OpenHaptics.
//!
//! The library is loaded when a device is opened, so the station needs nothing of the vendor's to be built. The order of
//! calls is the vendor's: a device is taken hold of, its encoders are reset where that is its way of calibration, its
//! callback is scheduled, its motors are enabled, all with a scheduler that stands; then the scheduler runs.

mod abi;
mod callback;
mod driver;

use std::ffi::{CString, c_ulong};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use nalgebra::Vector3;

use self::abi::{error, get};
use self::callback::Shared;
use self::driver::{Attempts, Driver};
use super::{Device, DeviceError, DeviceInfo, Servo};
use crate::config::OpenHapticsConfig;

/// Names that the default device goes by; `None` is the library's own default.
const DEFAULT_NAMES: [Option<&str>; 3] = [None, Some("Default Device"), Some("Default PHANToM")];
/// How often a device that is said to be in use is asked for, and the time in between.
const TRIES: usize = 4;
const RETRY_AFTER: Duration = Duration::from_millis(100);
/// How often the thread that runs a device looks after it.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Longest time without a call from the scheduler.
const SILENCE: Duration = Duration::from_secs(1);
/// Of the Omni, for what a device does not answer: N, N/m, N s/m, Hz, kg.
const OMNI_FORCE_N: f64 = 3.3;
const OMNI_STIFFNESS_N_PER_M: f64 = 500.0;
const OMNI_DAMPING_N_S_PER_M: f64 = 5.0;
const OMNI_RATE_HZ: f64 = 1000.0;
const OMNI_MASS_KG: f64 = 0.045;
const OMNI_WORKSPACE_MM: [f64; 6] = [-80.0, -60.0, -35.0, 80.0, 60.0, 35.0];

/// A device of the vendor's.
pub struct OpenHaptics {
    info: DeviceInfo,
    identity: Identity,
    /// The scheduler has its address; it lives until the device is unscheduled.
    shared: Box<Shared>,
    task: c_ulong,
}

/// What a device says of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Identity {
    /// The library's file or name.
    pub library: String,
    /// The library's version.
    pub version: String,
    /// The driver's version.
    pub driver_version: String,
    /// The device's model.
    pub model: String,
    /// The device's serial number.
    pub serial_number: String,
    /// What it did not answer, so that the Omni's values are taken.
    pub unanswered: Vec<&'static str>,
}

/// Loads the library; the file or name that it was found by.
///
/// # Errors
/// What was tried, what each answered and what to do.
pub fn load(config: &OpenHapticsConfig) -> Result<String, DeviceError> {
    let driver = Driver::load(config.library.as_deref()).map_err(|attempts| no_library(&attempts))?;
    Ok(driver.path.display().to_string())
}

impl OpenHaptics {
    /// Loads the library and takes hold of the device.
    ///
    /// # Errors
    /// What was tried, what each answered and what to do.
    pub fn open(config: &OpenHapticsConfig) -> Result<Self, DeviceError> {
        let driver = Driver::load(config.library.as_deref()).map_err(|attempts| no_library(&attempts))?;
        let (opened, found) = driver.while_stopped(|hd| {
            let handle = init(driver, config.name.as_deref())?;
            if !driver.register(handle) {
                hd.disable_device(handle);
                return Err(DeviceError {
                    device: format!("OpenHaptics device {}", quoted(config.name.as_deref())),
                    what: "there are more than eight devices".into(),
                    remedy: "take some out of the configuration".into(),
                });
            }
            hd.make_current(handle);
            let (info, identity, style) = query(driver);
            if style & abi::STYLE_ENCODER_RESET != 0 && hd.check_calibration() != abi::CALIBRATION_OK {
                hd.update_calibration(abi::STYLE_ENCODER_RESET);
            }
            let shared = Box::new(Shared::new(driver, handle, style, info.peak_force_n));
            let task = hd.schedule(callback::callback, (&raw const *shared).cast_mut().cast());
            hd.enable(abi::FORCE_OUTPUT);
            Ok((Self { info, identity, shared, task }, driver.take_error(handle)))
        })?;
        match found {
            Some(found) => Err(opened.failed(&driver.hd.describe(&found), remedy(found.code))),
            None => Ok(opened),
        }
    }

    /// What it says of itself.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    fn failed(&self, what: &str, remedy: &str) -> DeviceError {
        DeviceError { device: self.info.name.clone(), what: what.into(), remedy: remedy.into() }
    }

    /// Looks after the device until it is to stop or has failed.
    fn watch(&self, stop: &AtomicBool) -> Result<(), DeviceError> {
        let mut seen = (self.shared.ticks.load(Ordering::Relaxed), Instant::now());
        while !stop.load(Ordering::Relaxed) {
            thread::sleep(LOOK_EVERY);
            if let Some(found) = self.shared.fatal() {
                return Err(self.failed(&self.shared.driver.hd.describe(&found), remedy(found.code)));
            }
            if self.shared.has_panicked.load(Ordering::Acquire) {
                return Err(self.failed("the servo panicked", "report this with what was printed before"));
            }
            let ticks = self.shared.ticks.load(Ordering::Relaxed);
            if ticks != seen.0 {
                seen = (ticks, Instant::now());
            } else if seen.1.elapsed() > SILENCE {
                let what = "the library's scheduler has not called for 1 s";
                return Err(self.failed(what, "plug the device out and in, and start the station again"));
            }
        }
        Ok(())
    }
}

impl Device for OpenHaptics {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        let driver = self.shared.driver;
        let seated = self.shared.seat(servo);
        driver.start();
        let outcome = self.watch(stop);
        drop(seated);
        // A device whose servo has left renders nothing from its next frame on. Let that go out.
        let ticks = self.shared.ticks.load(Ordering::Relaxed);
        let left = Instant::now();
        while self.shared.ticks.load(Ordering::Relaxed) < ticks + 2 && left.elapsed() < 4 * LOOK_EVERY {
            thread::sleep(Duration::from_millis(1));
        }
        driver.stop();
        outcome
    }
}

impl Drop for OpenHaptics {
    fn drop(&mut self) {
        let Shared { driver, handle, .. } = *self.shared;
        driver.while_stopped(|hd| {
            hd.unschedule(self.task);
            hd.disable_device(handle);
            driver.deregister(handle);
            driver.drain();
        });
    }
}

/// Takes hold of a device by its name, or of the default one by any of its names.
fn init(driver: &Driver, name: Option<&str>) -> Result<abi::Handle, DeviceError> {
    let names = name.map_or(DEFAULT_NAMES.to_vec(), |name| vec![Some(name)]);
    let mut answers = Vec::new();
    let mut last_code = 0;
    for name in names {
        let Ok(text) = name.map(CString::new).transpose() else {
            answers.push(format!("{name:?}: has a zero in it"));
            continue;
        };
        for attempt in 1..=TRIES {
            driver.drain();
            let handle = driver.hd.init_device(text.as_ref());
            let Some(found) = driver.drain() else {
                if handle != abi::INVALID_HANDLE {
                    return Ok(handle);
                }
                answers.push(format!("{}: no device and no error", quoted(name)));
                break;
            };
            last_code = found.code;
            if found.code != error::ALREADY_INITIATED || attempt == TRIES {
                answers.push(format!("{}: {}, asked {attempt} x", quoted(name), driver.hd.describe(&found)));
                break;
            }
            thread::sleep(RETRY_AFTER);
        }
    }
    Err(DeviceError {
        device: format!("OpenHaptics ({})", driver.path.display()),
        what: format!("no device could be opened; tried {}", answers.join("; ")),
        remedy: remedy(last_code).into(),
    })
}

fn quoted(name: Option<&str>) -> String {
    name.map_or("the default".into(), |name| format!("\"{name}\""))
}

/// Asks the current device what it is and what it bears; where it does not answer, the Omni's values.
fn query(driver: &Driver) -> (DeviceInfo, Identity, u32) {
    let hd = &driver.hd;
    let mut unanswered = Vec::new();
    let mut or_omni = |name: &'static str, value: f64, omni: f64| {
        let is_answered = value.is_finite() && value > 0.0;
        if !is_answered {
            unanswered.push(name);
        }
        if is_answered { value } else { omni }
    };
    let [force_n] = hd.doubles(get::MAX_FORCE);
    let [stiffness_n_per_mm] = hd.doubles(get::MAX_STIFFNESS);
    let [damping_n_s_per_mm] = hd.doubles(get::MAX_DAMPING);
    let peak_force_n = or_omni("greatest force", force_n, OMNI_FORCE_N);
    let max_stiffness_n_per_m = or_omni("greatest stiffness", 1e3 * stiffness_n_per_mm, OMNI_STIFFNESS_N_PER_M);
    let max_damping_n_s_per_m = or_omni("greatest damping", 1e3 * damping_n_s_per_mm, OMNI_DAMPING_N_S_PER_M);
    let rate_hz = or_omni("rate", f64::from(hd.integer(get::UPDATE_RATE)), OMNI_RATE_HZ);
    let box_mm: [f64; 6] = hd.doubles(get::USABLE_WORKSPACE);
    let is_box = (0..3).all(|axis| box_mm[axis] < box_mm[axis + 3]);
    or_omni("workspace", f64::from(u8::from(is_box)), 0.0);
    let box_mm = if is_box { box_mm } else { OMNI_WORKSPACE_MM };
    let corner = |from: usize| Vector3::new(box_mm[from], box_mm[from + 1], box_mm[from + 2]) * 1e-3;
    let text = |what: u32| hd.string(what).unwrap_or_else(|| "unknown".into());
    let style = hd.integer(get::CALIBRATION_STYLE).cast_unsigned();
    let (model, serial_number) = (text(get::MODEL), text(get::SERIAL_NUMBER));
    // What a device does not know is an error on the stack; it is told as unanswered.
    let identity = Identity {
        library: driver.path.display().to_string(),
        version: text(get::VERSION),
        driver_version: text(get::DRIVER_VERSION),
        model: model.clone(),
        serial_number: serial_number.clone(),
        unanswered,
    };
    driver.drain();
    let info = DeviceInfo {
        name: format!("{model} {serial_number}"),
        rate_hz,
        peak_force_n,
        max_stiffness_n_per_m,
        max_damping_n_s_per_m,
        apparent_mass_kg: OMNI_MASS_KG,
        workspace_m: [corner(0), corner(3)],
    };
    (info, identity, style)
}

/// What was looked for and how it failed.
fn no_library(attempts: &Attempts) -> DeviceError {
    let tried: Vec<String> = attempts.iter().map(|(path, answer)| format!("{}: {answer}", path.display())).collect();
    DeviceError {
        device: "OpenHaptics".into(),
        what: format!("the vendor's library could not be loaded; tried {}", tried.join("; ")),
        remedy: "install the vendor's OpenHaptics and the driver of the device, or set `library` to the file".into(),
    }
}

/// What to do about an error of the library's.
fn remedy(code: u32) -> &'static str {
    match code {
        error::ALREADY_INITIATED => "close the other program that uses the device, or plug it out and in",
        error::COMM_ERROR | error::COMM_CONFIG_ERROR => {
            "check the cable and the power, and whether you may open its port; then start the station again"
        }
        error::DEVICE_FAULT => "see whether the vendor's setup tool finds a device, and what name it has there",
        error::INVALID_LICENSE => "install the vendor's licence",
        _ => "look the error up in the vendor's documents, and run `kerf-station doctor`",
    }
}
