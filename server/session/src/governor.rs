//! Bounds the work of steps so that a session keeps its deadlines.
//!
//! A step's work is counted in units that do not depend on the machine. The governor is told how long steps took and how
//! much work they did, and finds what a unit takes here; so it never asks the time, and its behaviour is tested without a
//! clock. The budget that it sets is an input of the step, recorded and replayed as tools' motions are. A first touch or a
//! step in which much parts then costs accuracy for some steps, within the bound that the scene states, instead of time.

use kerf_physics::SceneDesc;
use kerf_physics::step_io::SolveReport;

/// Steps of which the time of a unit is taken together. Fewer would follow single steps, more would follow a machine that
/// gets slower too late.
const SAMPLES: usize = 64;
/// Steps from which on a unit is known well enough to begin with, and after which it is found anew.
pub(crate) const FIRST_SAMPLES: usize = 8;
/// Of the samples, in ascending order, the one that counts. A unit of a step that cuts takes longer than one of a step that
/// presses, by a half in the median: the median over all steps would make those late that cut. Single steps that the
/// machine was taken away from are beyond it.
const QUANTILE: f64 = 0.75;
/// Share of the period that a step's work may take. What is left is for inputs, reports, the frame for viewers and for
/// waking up: 0.1 ms of the 1 ms at 1 kHz, and a reserve for what the units do not foretell. With 0.75 three to four times as
/// many steps of the demo's liver were late at 250 Hz.
const SHARE_OF_PERIOD: f64 = 0.65;
/// Share that a step may take however late it begins: lost time is caught up over some steps, not by one that computes
/// next to nothing.
const LEAST_SHARE_OF_PERIOD: f64 = 0.25;
/// Budgets are rounded down to eighths of an octave: small changes of speed are no change of the budget.
const RUNGS_PER_OCTAVE: f64 = 8.0;
/// How long no step may have been cut short before viewers hear that none is, s.
const CALM_S: f64 = 1.0;
/// A residual is told anew from so many times the one that was told last.
const TELLING: f64 = 2.0;

/// The governor of one session.
#[derive(Clone, Debug)]
pub(crate) struct Governor {
    relative_tolerance: f64,
    period_ns: f64,
    /// Share of the period that a step's work may take.
    share: f64,
    /// Nanoseconds per unit of the last steps, a ring.
    unit_ns: Vec<f64>,
    /// Samples that the ring has taken.
    samples: usize,
    /// What a unit is taken to cost, ns; `None` while too few steps have been taken to tell.
    settled_unit_ns: Option<f64>,
    /// Residual that was told last, since steps were last calm; `None`: they are.
    residual: Option<f64>,
    calm_steps: u32,
}

impl Governor {
    /// The governor of a scene.
    pub fn of(desc: &SceneDesc) -> Self {
        Self {
            relative_tolerance: desc.relative_tolerance(),
            period_ns: 1e9 / desc.rate_hz,
            share: SHARE_OF_PERIOD,
            unit_ns: Vec::with_capacity(SAMPLES),
            samples: 0,
            settled_unit_ns: None,
            residual: None,
            calm_steps: 0,
        }
    }

    /// Takes the share of a core that the session has beside others: steps that need more than is there would make those of
    /// all late.
    pub fn take_share(&mut self, of_core: f64) {
        self.share = SHARE_OF_PERIOD.min(of_core);
    }

    /// Work that a step may do which begins so long after it was due: what fits into the time that it has. `None` while too
    /// few have been taken to tell.
    pub fn work_units(&self, behind_ns: u64) -> Option<u64> {
        let left = (self.share - behind_ns as f64 / self.period_ns).max(LEAST_SHARE_OF_PERIOD);
        let share = left.min(self.share);
        self.settled_unit_ns.map(|unit_ns| rung(share * self.period_ns / unit_ns))
    }

    /// Takes in a step; returns the relative residual that solves end at from now on if that changes: the scene's
    /// tolerance, or what cutting short left.
    pub fn step_ended(&mut self, elapsed_ns: u64, solve: &SolveReport) -> Option<f64> {
        if solve.work_units > 0 {
            self.take_sample(elapsed_ns as f64 / solve.work_units as f64);
        }
        self.judge(solve)
    }

    fn take_sample(&mut self, unit_ns: f64) {
        match self.unit_ns.len() < SAMPLES {
            true => self.unit_ns.push(unit_ns),
            false => self.unit_ns[self.samples % SAMPLES] = unit_ns,
        }
        self.samples += 1;
        if self.samples.is_multiple_of(FIRST_SAMPLES) {
            let mut sorted = [0.0; SAMPLES];
            let sorted = &mut sorted[..self.unit_ns.len()];
            sorted.copy_from_slice(&self.unit_ns);
            let counted = (QUANTILE * sorted.len() as f64) as usize;
            self.settled_unit_ns = Some(*sorted.select_nth_unstable_by(counted, f64::total_cmp).1);
        }
    }

    fn judge(&mut self, solve: &SolveReport) -> Option<f64> {
        let calm_steps = (CALM_S * 1e9 / self.period_ns) as u32;
        if solve.is_cut_short && solve.relative_residual > self.relative_tolerance {
            self.calm_steps = 0;
            let told = self.residual.unwrap_or(0.0);
            let left = (solve.relative_residual > TELLING * told).then_some(solve.relative_residual)?;
            self.residual = Some(left);
            return Some(left);
        }
        self.calm_steps = self.calm_steps.saturating_add(1);
        let is_over = self.residual.is_some() && self.calm_steps >= calm_steps;
        is_over.then(|| {
            self.residual = None;
            self.relative_tolerance
        })
    }
}

/// The rung of a budget, at most as large.
fn rung(units: f64) -> u64 {
    let octave = 2f64.powf(units.max(1.0).log2().floor());
    (octave * (1.0 + ((units / octave - 1.0) * RUNGS_PER_OCTAVE).floor() / RUNGS_PER_OCTAVE)) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_scenes::catalog;

    const MS: u64 = 1_000_000;

    fn governor() -> Governor {
        Governor::of(&catalog::builtin("liver").unwrap().desc)
    }

    fn solve(work_units: u64) -> SolveReport {
        SolveReport { work_units, ..SolveReport::default() }
    }

    /// The budget after steps of which a unit takes so long.
    fn settled(governor: &mut Governor, unit_ns: u64) -> u64 {
        (0..SAMPLES).for_each(|_| _ = governor.step_ended(20_000 * unit_ns, &solve(20_000)));
        governor.work_units(0).expect("steps enough to tell")
    }

    #[test]
    fn a_budget_is_what_the_machine_does_in_the_time_of_a_step() {
        let mut governor = governor();
        assert_eq!(governor.work_units(0), None, "nothing is known yet");
        for unit_ns in [10, 40, 160, 40] {
            let takes_ns = settled(&mut governor, unit_ns) * unit_ns;
            let most_ns = (SHARE_OF_PERIOD * MS as f64) as u64;
            assert!(takes_ns <= most_ns && takes_ns > most_ns * 4 / 5, "{takes_ns} ns at {unit_ns} ns a unit");
        }
    }

    #[test]
    fn a_machine_that_is_taken_away_now_and_then_and_small_changes_of_speed_leave_the_budget_as_it_is() {
        let mut governor = governor();
        let before = settled(&mut governor, 40);
        for step in 0..4 * SAMPLES as u64 {
            let stolen_ns = if step % 5 == 0 { 20 * MS } else { 0 };
            governor.step_ended(20_000 * 40 + step % 7 * 1000 + stolen_ns, &solve(20_000));
        }
        assert_eq!(governor.work_units(0), Some(before));
    }

    #[test]
    fn a_machine_that_gets_slower_is_followed_within_a_window_and_not_by_one_step() {
        let mut governor = governor();
        let before = settled(&mut governor, 30);
        let mut steps = 0;
        while governor.work_units(0) == Some(before) {
            governor.step_ended(20_000 * 60, &solve(20_000));
            steps += 1;
        }
        assert!((SAMPLES / 8..SAMPLES / 2).contains(&steps), "{steps} steps");
        assert_eq!(governor.work_units(0), Some(settled(&mut governor, 60)));
    }

    #[test]
    fn a_step_that_begins_late_has_the_time_that_is_left_and_never_none() {
        let mut governor = governor();
        let whole = settled(&mut governor, 40);
        let of = |behind_ns| governor.work_units(behind_ns).unwrap() as f64 / whole as f64;
        // Budgets are rounded, each by an eighth at most.
        let is = |behind_ns, share: f64| (of(behind_ns) * SHARE_OF_PERIOD / share - 1.0).abs() < 0.125;
        assert!(is(MS / 4, SHARE_OF_PERIOD - 0.25), "{}", of(MS / 4));
        assert!(is(10 * MS, LEAST_SHARE_OF_PERIOD), "{}", of(10 * MS));
    }

    #[test]
    fn a_session_among_many_has_its_share_of_a_core() {
        let mut governor = governor();
        let whole = settled(&mut governor, 40);
        let mut of = |of_core, behind_ns| {
            governor.take_share(of_core);
            governor.work_units(behind_ns).unwrap() as f64 / whole as f64
        };
        assert_eq!(of(f64::INFINITY, 0), 1.0);
        assert!((of(0.1, 0) * SHARE_OF_PERIOD / 0.1 - 1.0).abs() < 0.125);
        assert_eq!(of(0.1, 10 * MS), of(0.1, 0), "no less where it begins late");
    }

    #[test]
    fn what_was_cut_short_is_told_as_it_gets_worse_and_once_more_when_it_is_over() {
        let mut governor = governor();
        let cut = |relative_residual| SolveReport { relative_residual, is_cut_short: true, ..solve(20_000) };
        let told: Vec<f64> =
            [0.01, 0.005, 0.019, 0.021].iter().filter_map(|r| governor.step_ended(MS, &cut(*r))).collect();
        assert_eq!(told, [0.01, 0.021]);
        let told: Vec<f64> = (0..3000).filter_map(|_| governor.step_ended(MS / 2, &solve(20_000))).collect();
        assert_eq!(told, [1e-3]);
    }
}
