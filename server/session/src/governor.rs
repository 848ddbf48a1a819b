//! Gives up accuracy while a session misses its deadlines, within the bounds that its scene states, and
//! takes it back when there is time to spare.
//!
//! What it changes is the relative tolerance of the velocity solve: the one setting of the dial that a
//! world can change between two steps, and the one whose cost rises when tools press and cut. It is
//! told how long steps took and never asks, so its behaviour is tested without a clock; what it
//! decides is an input of the step, recorded and replayed as tools' motions are.

use kerf_physics::SceneDesc;

/// Steps are judged by windows of this length, s: long enough that a stall of the machine is not taken for
/// a scene that costs too much, short enough that a hand hardly feels the wait.
const WINDOW_S: f64 = 0.1;
/// Fraction of the late steps in a window from which on effort is reduced.
const LATE_SHARE: f64 = 0.1;
/// Fraction of the period that the steps of a window may take on average for effort to be raised: a rung of
/// tolerance costs up to a third of a step.
const IDLE_SHARE: f64 = 0.6;
/// Windows in a row with time to spare before effort is raised: what is given back too early is missed
/// again at once.
const IDLE_WINDOWS: u32 = 10;
/// Factor between two rungs of the tolerance.
const RUNG: f64 = 3.162_277_660_168_379_5;

/// The governor of one session.
#[derive(Clone, Debug)]
pub(crate) struct Governor {
    /// The scene's own tolerance: full effort.
    least_tolerance: f64,
    most_tolerance: f64,
    tolerance: f64,
    period_ns: f64,
    steps_per_window: u32,
    window: Window,
    idle_windows: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Window {
    steps: u32,
    late: u32,
    elapsed_ns: u64,
}

impl Governor {
    /// The governor that a scene asks for; `None` if it asks for none.
    pub fn of(desc: &SceneDesc) -> Option<Self> {
        let most_tolerance = desc.governor?.max_relative_tolerance;
        let tolerance = desc.relative_tolerance();
        Some(Self {
            least_tolerance: tolerance,
            most_tolerance,
            tolerance,
            period_ns: 1e9 / desc.rate_hz,
            steps_per_window: (WINDOW_S * desc.rate_hz).round().max(1.0) as u32,
            window: Window::default(),
            idle_windows: 0,
        })
    }

    /// Takes in a step; returns the relative tolerance from the next step on if it changes.
    pub fn step_ended(&mut self, elapsed_ns: u64, is_late: bool) -> Option<f64> {
        self.window.steps += 1;
        self.window.late += u32::from(is_late);
        self.window.elapsed_ns += elapsed_ns;
        if self.window.steps < self.steps_per_window {
            return None;
        }
        let Window { steps, late, elapsed_ns } = std::mem::take(&mut self.window);
        let is_idle = late == 0 && elapsed_ns as f64 <= IDLE_SHARE * self.period_ns * f64::from(steps);
        self.idle_windows = if is_idle { self.idle_windows + 1 } else { 0 };
        let wanted = if f64::from(late) > LATE_SHARE * f64::from(steps) {
            self.tolerance * RUNG
        } else if self.idle_windows >= IDLE_WINDOWS {
            self.idle_windows = 0;
            self.tolerance / RUNG
        } else {
            self.tolerance
        };
        let tolerance = wanted.clamp(self.least_tolerance, self.most_tolerance);
        (tolerance != self.tolerance).then(|| {
            self.tolerance = tolerance;
            tolerance
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::scene::GovernorDesc;
    use kerf_scenes::catalog;

    const MS: u64 = 1_000_000;

    fn governor() -> Governor {
        let mut desc = catalog::builtin("liver").unwrap().desc;
        desc.governor = Some(GovernorDesc { max_relative_tolerance: 0.1 });
        Governor::of(&desc).unwrap()
    }

    /// Tolerances that windows of steps of these durations lead to; a step longer than the period is late.
    fn tolerances(governor: &mut Governor, windows: u32, step_ns: u64) -> Vec<f64> {
        let steps = windows * governor.steps_per_window;
        (0..steps).filter_map(|_| governor.step_ended(step_ns, step_ns > MS)).collect()
    }

    #[test]
    fn effort_falls_rung_by_rung_to_the_bound_and_comes_back_slowly() {
        let mut governor = governor();
        let fallen = tolerances(&mut governor, 10, 2 * MS);
        assert_eq!(fallen.len(), 4, "1e-3 to 0.1 in rungs of sqrt 10: {fallen:?}");
        assert_eq!(fallen.last(), Some(&0.1));
        assert!(fallen.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(tolerances(&mut governor, IDLE_WINDOWS - 1, MS / 2), [0.0; 0]);
        let raised = tolerances(&mut governor, 5 * IDLE_WINDOWS, MS / 2);
        assert_eq!((raised.len(), raised.last()), (4, Some(&1e-3)));
    }

    #[test]
    fn a_single_stall_and_steps_that_just_fit_change_nothing() {
        let mut governor = governor();
        assert_eq!(governor.step_ended(50 * MS, true), None);
        assert_eq!(tolerances(&mut governor, 5, MS / 2), [0.0; 0]);
        assert_eq!(tolerances(&mut governor, 100, 9 * MS / 10), [0.0; 0]);
    }

    #[test]
    fn a_scene_that_states_no_bounds_has_no_governor() {
        assert!(Governor::of(&catalog::builtin("liver").unwrap().desc).is_none());
    }
}
