//! Whether a session keeps its rate: the share of late steps over some seconds of simulated time.

/// Simulated time that is looked at together, s: long enough that a machine's hiccup is not an overload.
const WINDOW_S: f64 = 5.0;
/// Share of late steps beyond which a session is overloaded: poses follow the wall clock and steps no longer do.
const MAX_LATE_SHARE: f64 = 0.02;

/// Counts a session's steps window by window.
#[derive(Clone, Debug)]
pub(crate) struct OverloadWatch {
    window_steps: u32,
    steps: u32,
    late: u32,
}

impl OverloadWatch {
    /// For a session that takes so many steps per simulated second.
    pub fn new(rate_hz: f64) -> Self {
        Self { window_steps: (WINDOW_S * rate_hz).ceil() as u32, steps: 0, late: 0 }
    }

    /// A step has ended. At the end of a window with too many late steps: their share.
    pub fn step_ended(&mut self, is_late: bool) -> Option<f64> {
        self.steps += 1;
        self.late += u32::from(is_late);
        if self.steps < self.window_steps {
            return None;
        }
        let late_share = f64::from(self.late) / f64::from(self.steps);
        (self.steps, self.late) = (0, 0);
        (late_share > MAX_LATE_SHARE).then_some(late_share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shares told over `steps` steps at 100 Hz of which every `nth` is late.
    fn told(steps: u32, nth: u32) -> Vec<f64> {
        let mut watch = OverloadWatch::new(100.0);
        (1..=steps).filter_map(|step| watch.step_ended(step % nth == 0)).collect()
    }

    #[test]
    fn a_window_with_too_many_late_steps_is_told_once() {
        assert_eq!(told(1000, 10), [0.1, 0.1]);
        assert!(told(499, 10).is_empty());
        assert!(told(10_000, 100).is_empty(), "one in a hundred is the machine's");
    }
}
