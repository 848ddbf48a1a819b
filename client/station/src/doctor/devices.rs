//! The devices: those that are configured, and what else is there to be configured.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use nalgebra::Vector3;

use super::{Finding, Outcome};
use crate::config::{DeviceConfig, DeviceKind, HaplyConfig, OpenHapticsConfig};
use crate::device::haply::Haply;
use crate::device::openhaptics::{OpenHaptics, load};
use crate::device::{self, Device, DeviceError, DeviceState, Servo};
use crate::station::raise_priority;

/// Share of the rate that a device aims at which is enough.
const ENOUGH_RATE: f64 = 0.9;

/// All of them.
pub fn findings(devices: &[DeviceConfig], run_for: Duration) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (index, config) in devices.iter().enumerate() {
        let subject = format!("devices[{index}]");
        findings.extend(configured(&subject, config, run_for).unwrap_or_else(|error| {
            vec![Finding::other(Outcome::Bad, subject, format!("{}: {}", error.device, error.what), error.remedy)]
        }));
    }
    if !devices.iter().any(|config| matches!(config.kind, DeviceKind::OpenHaptics(_))) {
        findings.push(match load(&OpenHapticsConfig::default()) {
            Ok(library) => Finding::good("OpenHaptics", format!("{library} is there; no device is configured for it")),
            Err(error) => Finding::other(Outcome::Note, "OpenHaptics", error.what, error.remedy),
        });
    }
    if !devices.iter().any(|config| matches!(config.kind, DeviceKind::Haply(_))) {
        findings.push(match Haply::open(&HaplyConfig::default()) {
            Ok(arm) => Finding::good("Haply", format!("{} is there; no device is configured for it", arm.info().name)),
            Err(error) => {
                Finding::other(Outcome::Note, "Haply", format!("{}: {}", error.device, error.what), error.remedy)
            }
        });
    }
    findings
}

/// A device that is configured: what it is, and how it runs.
fn configured(subject: &str, config: &DeviceConfig, run_for: Duration) -> Result<Vec<Finding>, DeviceError> {
    let mut findings = Vec::new();
    let mut opened: Box<dyn Device> = match &config.kind {
        DeviceKind::OpenHaptics(openhaptics) => {
            let device = OpenHaptics::open(openhaptics)?;
            let identity = device.identity();
            findings.push(Finding::good(
                subject,
                format!(
                    "library {} version {}, driver {}",
                    identity.library, identity.version, identity.driver_version
                ),
            ));
            if !identity.unanswered.is_empty() {
                findings.push(Finding::other(
                    Outcome::Note,
                    subject,
                    format!("the device does not tell its {}", identity.unanswered.join(", ")),
                    "the Omni's values are taken; set `servo` of the device where they are too great",
                ));
            }
            Box::new(device)
        }
        DeviceKind::Haply(haply) => {
            let device = Haply::open(haply)?;
            let firmware = device.firmware().unwrap_or("unknown");
            findings.push(Finding::good(subject, format!("service at {}, firmware {firmware}", haply.url)));
            Box::new(device)
        }
        _ => device::open(config)?,
    };
    let info = opened.info().clone();
    let [low, high] = info.workspace_m.map(|corner| corner * 1e3);
    findings.push(Finding::good(
        subject,
        format!(
            "{}: at most {} N, {} N/m, {} N s/m; reaches {:.0} x {:.0} x {:.0} mm",
            info.name,
            info.peak_force_n,
            info.max_stiffness_n_per_m,
            info.max_damping_n_s_per_m,
            high.x - low.x,
            high.y - low.y,
            high.z - low.z
        ),
    ));
    let run = run(opened.as_mut(), run_for)?;
    findings.push(run.rate(subject, info.rate_hz));
    findings.extend(run.state(subject));
    Ok(findings)
}

/// What a servo without force saw.
#[derive(Default)]
struct Run {
    /// Times of the calls, ns.
    at_ns: Vec<u64>,
    last: DeviceState,
}

impl Servo for Run {
    fn tick(&mut self, now_ns: u64, state: &DeviceState) -> Vector3<f64> {
        // A fixed room: nothing is allocated here.
        if self.at_ns.len() < self.at_ns.capacity() {
            self.at_ns.push(now_ns);
        }
        self.last = *state;
        Vector3::zeros()
    }
}

/// Runs a device for a time, or until it ends.
fn run(device: &mut dyn Device, run_for: Duration) -> Result<Run, DeviceError> {
    let room = (run_for.as_secs_f64() * 5000.0) as usize + 1;
    let mut seen = Run { at_ns: Vec::with_capacity(room), ..Run::default() };
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            thread::sleep(run_for);
            stop.store(true, Ordering::Relaxed);
        });
        // As the station does it, on a thread of its own: this one keeps its priority.
        let running = scope.spawn(|| {
            raise_priority();
            device.run(&mut seen, &stop)
        });
        running.join().expect("a device does not panic")
    })?;
    Ok(seen)
}

impl Run {
    /// How often the servo was called.
    fn rate(&self, subject: &str, aim_hz: f64) -> Finding {
        let mut gaps_ns: Vec<u64> = self.at_ns.windows(2).map(|pair| pair[1] - pair[0]).collect();
        gaps_ns.sort_unstable();
        let (Some(first), Some(last), Some(longest_ns)) = (self.at_ns.first(), self.at_ns.last(), gaps_ns.last())
        else {
            let remedy = "plug the device out and in, and look at the vendor's setup tool";
            return Finding::other(Outcome::Bad, subject, "the servo was not called", remedy);
        };
        let rate_hz = gaps_ns.len() as f64 / ((last - first) as f64 * 1e-9);
        let p99_ns = gaps_ns[gaps_ns.len() * 99 / 100];
        let text = format!(
            "the servo was called {rate_hz:.0} times a second, aimed at {aim_hz:.0}; 99 % of the gaps below {:.2} ms, \
             the longest {:.2} ms",
            p99_ns as f64 * 1e-6,
            *longest_ns as f64 * 1e-6
        );
        if rate_hz >= ENOUGH_RATE * aim_hz {
            Finding::good(subject, text)
        } else {
            let remedy = "stop other programs, and allow real-time priority; the servo measures its true period";
            Finding::other(Outcome::Note, subject, text, remedy)
        }
    }

    /// Where the device is, and whether that is to be believed.
    fn state(&self, subject: &str) -> Option<Finding> {
        self.at_ns.first()?;
        let [x, y, z] = (self.last.position_m * 1e3).into();
        Some(match self.last.hold {
            None => {
                Finding::good(subject, format!("tip at {x:.1}, {y:.1}, {z:.1} mm; buttons {:#b}", self.last.buttons))
            }
            Some(hold) => {
                let (what, remedy) = hold.split_once(": ").unwrap_or((hold, "wait, and ask again"));
                Finding::other(Outcome::Bad, subject, what, remedy)
            }
        })
    }
}
