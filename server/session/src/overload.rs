//! Whether a session keeps its rate: the share of late steps over some seconds.

/// Time that is looked at together, ns: long enough that a machine's hiccup is not an overload.
const WINDOW_NS: u64 = 5_000_000_000;
/// Share of late steps beyond which a session is overloaded: poses follow the wall clock and steps no longer do.
const MAX_LATE_SHARE: f64 = 0.02;

/// Counts a session's steps window by window.
#[derive(Clone, Debug, Default)]
pub(crate) struct OverloadWatch {
    /// When the window began; with the first step.
    since_ns: Option<u64>,
    steps: u32,
    late: u32,
}

impl OverloadWatch {
    /// A step has ended. At the end of a window with too many late steps: their share.
    pub fn step_ended(&mut self, ended_ns: u64, is_late: bool) -> Option<f64> {
        let since_ns = *self.since_ns.get_or_insert(ended_ns);
        self.steps += 1;
        self.late += u32::from(is_late);
        if ended_ns.saturating_sub(since_ns) < WINDOW_NS {
            return None;
        }
        let late_share = f64::from(self.late) / f64::from(self.steps);
        *self = Self::default();
        (late_share > MAX_LATE_SHARE).then_some(late_share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shares told over `steps` steps, one in 10 ms, of which every `nth` is late.
    fn told(steps: u32, nth: u32) -> Vec<f64> {
        let mut watch = OverloadWatch::default();
        (1..=steps).filter_map(|step| watch.step_ended(u64::from(step) * 10_000_000, step % nth == 0)).collect()
    }

    #[test]
    fn a_window_with_too_many_late_steps_is_told_once() {
        assert_eq!(told(1002, 1), [1.0, 1.0]);
        assert!(told(500, 1).is_empty());
        assert!(told(10_000, 100).is_empty(), "one in a hundred is the machine's");
    }
}
