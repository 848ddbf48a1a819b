//! What it costs the session's thread to be recorded: processor time of the same steps with and without.

use kerf_scenes::catalog;
use rustix::time::{ClockId, clock_gettime};

use super::virtual_session::{S, VirtualSession};
use crate::limits::SessionLimits;

/// Ratios are the least of so many runs: others use the machine too.
const RUNS: usize = 5;

fn thread_ns() -> i64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

/// Processor time a step, us, of a cut through the liver at a rate.
fn step_us(rate_hz: f64, is_recorded: bool) -> f64 {
    const STEPS: u64 = 240;
    let mut desc = catalog::builtin("liver").unwrap().desc;
    desc.rate_hz = rate_hz;
    let mut session = VirtualSession::new(desc, SessionLimits::default());
    let mut pictures = is_recorded.then(|| session.watch_for_the_record());
    if !is_recorded {
        session.stop_tape();
    }
    let driver = session.drive();
    let began_ns = thread_ns();
    for seq in 1..=STEPS {
        // From over the liver into it.
        session.submit(driver, seq, 0.15 - 2.5e-4 * seq as f64).unwrap();
        session.run((S as f64 / rate_hz) as u64);
        while pictures.as_mut().is_some_and(|pictures| pictures.try_next().is_some()) {}
    }
    let took_ns = thread_ns() - began_ns;
    assert!(session.status().topology_version > 0, "it is cut");
    took_ns as f64 * 1e-3 / STEPS as f64
}

#[test]
#[ignore = "a measurement for docs/server.md"]
fn what_recording_costs_the_liver() {
    for rate_hz in [60.0, 1000.0] {
        let mut least = [f64::INFINITY; 2];
        for _ in 0..RUNS {
            for (least_us, is_recorded) in least.iter_mut().zip([false, true]) {
                *least_us = least_us.min(step_us(rate_hz, is_recorded));
            }
        }
        let [without_us, with_us] = least;
        println!("{rate_hz} Hz: {without_us:.0} us without, {with_us:.0} us with: x {:.3}", with_us / without_us);
        assert!(with_us < 1.5 * without_us);
    }
}
