//! What it costs the session's thread to be recorded: processor time of the same steps with and without.

use kerf_scenes::catalog;

use super::virtual_session::{S, VirtualSession, thread_ns};
use crate::limits::SessionLimits;

/// Ratios are the least of so many runs: others use the machine too.
const RUNS: usize = 3;

/// Who looks on.
#[derive(Clone, Copy, PartialEq)]
enum Onlooker {
    Nobody,
    Viewer,
    Recorder,
    /// Nobody, and a journal is written, with a state to go on from.
    Journal,
}

/// Processor time a step, us, of the session's own thread in a cut through the liver at a rate.
fn step_us(rate_hz: f64, onlooker: Onlooker) -> f64 {
    // The first ones contour the surface, once.
    const STEPS: std::ops::Range<u64> = 20..220;
    let mut desc = catalog::builtin("liver").unwrap().into_scene().desc;
    desc.rate_hz = rate_hz;
    let mut session = match onlooker {
        Onlooker::Journal => VirtualSession::journaled(desc, None).unwrap(),
        _ => VirtualSession::new(desc, SessionLimits::default()),
    };
    // As long as steps of a second in all, which ask a journal for a state.
    session.step_ns = S / (STEPS.end - STEPS.start);
    let mut pictures = match onlooker {
        Onlooker::Nobody | Onlooker::Journal => None,
        Onlooker::Viewer => Some(session.view()),
        Onlooker::Recorder => Some(session.watch_for_the_record()),
    };
    if onlooker != Onlooker::Recorder {
        session.stop_tape();
    }
    let driver = session.drive();
    let mut began_ns = 0;
    for seq in 1..=STEPS.end {
        if seq == STEPS.start {
            began_ns = thread_ns() - session.showing_ns;
        }
        // From over the liver into it.
        session.submit(driver, seq, 0.15 - 3e-4 * seq as f64).unwrap();
        session.run((S as f64 / rate_hz) as u64);
        while pictures.as_mut().is_some_and(|pictures| pictures.try_next().is_some()) {}
    }
    let took_ns = thread_ns() - session.showing_ns - began_ns;
    assert!(session.status().topology_version > 0, "it is cut");
    took_ns as f64 * 1e-3 / (STEPS.end - STEPS.start) as f64
}

#[test]
#[ignore = "a measurement for docs/reference/server.md"]
fn what_recording_costs_the_liver() {
    for rate_hz in [60.0, 1000.0] {
        let mut least = [f64::INFINITY; 4];
        for _ in 0..RUNS {
            let onlookers = [Onlooker::Nobody, Onlooker::Viewer, Onlooker::Recorder, Onlooker::Journal];
            for (least_us, onlooker) in least.iter_mut().zip(onlookers) {
                *least_us = least_us.min(step_us(rate_hz, onlooker));
            }
        }
        let [alone_us, viewed_us, recorded_us, journaled_us] = least;
        println!(
            "{rate_hz} Hz: {alone_us:.0} us alone, {viewed_us:.0} us viewed, {recorded_us:.0} us recorded, \
             {journaled_us:.0} us journaled"
        );
        assert!(journaled_us < 1.1 * alone_us, "a journal costs next to nothing");
        assert!(recorded_us < 1.15 * viewed_us, "it costs little more than a viewer");
    }
}
