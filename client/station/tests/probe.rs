//! A servo that keeps what it saw.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use kerf_station::device::{Device, DeviceError, DeviceState, Servo};
use nalgebra::Vector3;

/// A servo that answers with a function and keeps what it saw.
struct Probe<F> {
    answer: F,
    seen: Vec<(u64, DeviceState)>,
}

impl<F: FnMut(&DeviceState) -> Vector3<f64> + Send> Servo for Probe<F> {
    fn tick(&mut self, now_ns: u64, state: &DeviceState) -> Vector3<f64> {
        self.seen.push((now_ns, *state));
        (self.answer)(state)
    }
}

/// Runs a device until `until` says so, at most 3 s; what the servo saw and how it ended.
pub fn run_until(
    device: &mut dyn Device,
    answer: impl FnMut(&DeviceState) -> Vector3<f64> + Send,
    until: impl Fn() -> bool,
) -> (Vec<(u64, DeviceState)>, Result<(), DeviceError>) {
    let stop = AtomicBool::new(false);
    let mut probe = Probe { answer, seen: Vec::new() };
    let outcome = thread::scope(|scope| {
        let running = scope.spawn(|| device.run(&mut probe, &stop));
        let begun = Instant::now();
        while !until() && !running.is_finished() && begun.elapsed() < Duration::from_secs(3) {
            thread::sleep(Duration::from_millis(1));
        }
        stop.store(true, Ordering::Relaxed);
        running.join().expect("a device does not panic")
    });
    (probe.seen, outcome)
}

/// Pushes up by 1 N.
pub fn push(_: &DeviceState) -> Vector3<f64> {
    Vector3::y()
}
