//! A rhythm for devices that have none of their own.

use std::sync::atomic::{AtomicBool, Ordering};

use kerf_load::clock;
use kerf_load::pacer::Schedule;
use nalgebra::Vector3;

use super::{DeviceState, Servo};

/// Longest time that a simulated device lives through at once, s: a machine that was asleep does not fling it.
const MAX_STEP_S: f64 = 0.05;

/// Calls the servo at a rate, by absolute deadlines, until `stop` is set or there is no state any more; `step` moves
/// the device on by a time against a force.
pub fn run(
    servo: &mut dyn Servo,
    stop: &AtomicBool,
    rate_hz: f64,
    mut step: impl FnMut(f64, &Vector3<f64>) -> Option<DeviceState>,
) {
    let mut last_ns = clock::now_ns();
    let mut schedule = Schedule::new(last_ns, rate_hz);
    let mut force_n = Vector3::zeros();
    while !stop.load(Ordering::Relaxed) {
        clock::sleep_until_ns(schedule.deadline_ns());
        let now_ns = clock::now_ns();
        schedule.take(now_ns);
        let elapsed_s = now_ns.saturating_sub(last_ns) as f64 * 1e-9;
        let Some(state) = step(elapsed_s.min(MAX_STEP_S), &force_n) else { return };
        force_n = servo.tick(now_ns, &state);
        last_ns = now_ns;
    }
}
