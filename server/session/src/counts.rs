//! What is counted of all sessions of a server together, for whoever watches it.
//!
//! Sessions' threads add to atomics: none of it waits, allocates or reads a clock. Counts only rise, also over the end of
//! a session, so that whoever looks seldom misses nothing.

use std::array::from_fn;
use std::sync::atomic::{AtomicU64, Ordering};

use kerf_physics::Stage;
use kerf_physics::fault::FaultKind;
use kerf_physics::step_io::{SolveReport, StepOutput};

use crate::pacer::Pace;
use crate::shortfall::falls_short;

/// A number that only rises.
#[derive(Debug, Default)]
pub struct Count(AtomicU64);

impl Count {
    /// Adds so much.
    pub fn add(&self, more: u64) {
        self.0.fetch_add(more, Ordering::Relaxed);
    }

    /// What it has come to.
    #[must_use]
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// A sum of magnitudes, J.
#[derive(Debug, Default)]
pub struct Joules(AtomicU64);

impl Joules {
    /// Adds a magnitude; a number that is none would spoil the sum for ever.
    fn add(&self, energy_j: f64) {
        if energy_j.is_finite() {
            let add = |bits| Some((f64::from_bits(bits) + energy_j.abs()).to_bits());
            let _ = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add);
        }
    }

    /// What it has come to, J.
    #[must_use]
    pub fn get_j(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }
}

/// Durations, by how long they are.
#[derive(Debug)]
pub struct Durations {
    /// By the first of [`Self::BOUNDS_NS`] that is not shorter, and those that are longer than all.
    buckets: [Count; Self::BOUNDS_NS.len() + 1],
    sum_ns: Count,
}

impl Default for Durations {
    fn default() -> Self {
        Self { buckets: from_fn(|_| Count::default()), sum_ns: Count::default() }
    }
}

impl Durations {
    /// Periods of usual step rates, halves and multiples of them, ns: whether a rate is kept shows at a bound.
    pub const BOUNDS_NS: [u64; 16] = [
        100_000,
        250_000,
        500_000,
        1_000_000,
        2_000_000,
        4_000_000,
        8_000_000,
        16_666_667,
        33_333_333,
        66_666_667,
        125_000_000,
        250_000_000,
        500_000_000,
        1_000_000_000,
        2_500_000_000,
        10_000_000_000,
    ];

    fn add(&self, duration_ns: u64) {
        self.buckets[Self::BOUNDS_NS.partition_point(|bound_ns| *bound_ns < duration_ns)].add(1);
        self.sum_ns.add(duration_ns);
    }

    /// How many are within each bound and beyond the one before; the last, how many are beyond all.
    #[must_use]
    pub fn buckets(&self) -> [u64; Self::BOUNDS_NS.len() + 1] {
        from_fn(|index| self.buckets[index].get())
    }

    /// All together, s.
    #[must_use]
    pub fn sum_s(&self) -> f64 {
        self.sum_ns.get() as f64 * 1e-9
    }
}

/// State that was taken back, by what was wrong with it, and steps that panicked.
#[derive(Debug, Default)]
pub struct Faults {
    /// The state of a node.
    pub node_state: Count,
    /// The force on a tool.
    pub tool_wrench: Count,
    /// The energy of a piece.
    pub energy: Count,
    /// A step or a command panicked, and the session failed.
    pub panic: Count,
}

impl Faults {
    fn of(&self, kind: FaultKind) -> &Count {
        match kind {
            FaultKind::NodeState => &self.node_state,
            FaultKind::ToolWrench => &self.tool_wrench,
            FaultKind::Energy => &self.energy,
        }
    }
}

/// What is counted of all sessions of a server since it began.
#[derive(Debug, Default)]
pub struct Counts {
    /// Steps with a deadline, by the session's clock.
    pub paced_steps: Durations,
    /// Steps that a client called for, one after the other: none of them is late.
    pub called_steps: Durations,
    /// How long after their deadlines late steps ended.
    pub lags: Durations,
    /// Times that a session gave up time that it had lost.
    pub reanchors: Count,
    /// Time of each stage of steps, ns, indexed by `Stage as usize`.
    pub stage_ns: [Count; Stage::ALL.len()],
    /// Steps whose work was bounded.
    pub budgeted_steps: Count,
    /// What they might do, in units of work.
    pub budget_units: Count,
    /// What they did.
    pub work_units: Count,
    /// Of these steps, those that the bound cut short.
    pub cut_short_steps: Count,
    /// Steps with a solve that did not get to its tolerance, though it was taken up again.
    pub unconverged_steps: Count,
    /// Steps after which contacts were still to change.
    pub unsettled_steps: Count,
    /// Links that parted.
    pub parted_links: Count,
    /// What was taken back.
    pub faults: Faults,
    /// Energy of steps that the ledger does not explain.
    pub residual: Joules,
    /// Work of tools, to compare it with.
    pub tool_work: Joules,
}

/// A step, as its session has timed it.
pub(crate) struct TimedStep<'a> {
    pub output: &'a StepOutput,
    pub elapsed_ns: u64,
    /// `None`: it had no deadline.
    pub pace: Option<Pace>,
    /// What it might do.
    pub budget_units: Option<u64>,
}

impl Counts {
    pub(crate) fn step_ended(&self, step: &TimedStep<'_>) {
        let TimedStep { output, elapsed_ns, pace, budget_units } = step;
        let steps = if pace.is_some() { &self.paced_steps } else { &self.called_steps };
        steps.add(*elapsed_ns);
        if let Some(lag_ns) = pace.map(Pace::lag_ns).filter(|lag_ns| *lag_ns > 0) {
            self.lags.add(lag_ns);
        }
        self.reanchors.add(u64::from(matches!(pace, Some(Pace::Reanchored { .. }))));
        for (count, stage_ns) in self.stage_ns.iter().zip(output.profile.stage_ns) {
            count.add(stage_ns.unwrap_or(0));
        }
        self.add_solve(&output.solve, *budget_units);
        self.parted_links.add(u64::from(output.fracture.parted_links));
        if let Some(fault) = &output.fault {
            self.faults.of(fault.what).add(1);
        }
        self.residual.add(output.energy.residual_j);
        self.tool_work.add(output.energy.tool_work_j);
    }

    /// A step or a command panicked.
    pub(crate) fn panicked(&self) {
        self.faults.panic.add(1);
    }

    fn add_solve(&self, solve: &SolveReport, budget_units: Option<u64>) {
        if let Some(budget_units) = budget_units {
            self.budgeted_steps.add(1);
            self.budget_units.add(budget_units);
            self.work_units.add(solve.work_units);
            self.cut_short_steps.add(u64::from(solve.is_cut_short));
        }
        self.unconverged_steps.add(u64::from(solve.is_unconverged));
        self.unsettled_steps.add(u64::from(falls_short(solve) && !solve.is_unconverged));
    }
}

#[cfg(test)]
mod tests {
    use kerf_physics::fault::Fault;
    use kerf_physics::step_io::{EnergyStep, FractureStep};

    use super::*;

    const MS: u64 = 1_000_000;

    fn counted(output: StepOutput, pace: Option<Pace>, budget_units: Option<u64>) -> Counts {
        let counts = Counts::default();
        counts.step_ended(&TimedStep { output: &output, elapsed_ns: MS, pace, budget_units });
        counts
    }

    #[test]
    fn a_duration_at_a_bound_is_within_it_and_none_is_beyond_counting() {
        let durations = Durations::default();
        [MS, MS + 1, u64::from(u32::MAX) * 10].into_iter().for_each(|duration_ns| durations.add(duration_ns));
        let buckets = durations.buckets();
        assert_eq!((buckets[3], buckets[4], buckets[16], buckets.iter().sum::<u64>()), (1, 1, 1, 3));
        assert!(Durations::BOUNDS_NS.is_sorted());
    }

    #[test]
    fn steps_that_are_called_for_are_never_late() {
        let of = |counts: &Counts| {
            [&counts.paced_steps, &counts.called_steps, &counts.lags].map(|steps| steps.buckets().iter().sum::<u64>())
        };
        assert_eq!(of(&counted(StepOutput::default(), None, None)), [0, 1, 0]);
        assert_eq!(of(&counted(StepOutput::default(), Some(Pace::InTime), None)), [1, 0, 0]);
        let late = counted(StepOutput::default(), Some(Pace::Reanchored { lag_ns: 150 * MS }), None);
        assert_eq!((of(&late), late.reanchors.get()), ([1, 0, 1], 1));
    }

    #[test]
    fn work_is_counted_where_it_was_bounded_and_says_how_often_the_bound_was_met() {
        let solve = SolveReport { work_units: 70, is_cut_short: true, unsettled_n_s: 0.1, ..SolveReport::default() };
        let output = StepOutput { solve, ..StepOutput::default() };
        let of = |counts: &Counts| {
            [&counts.budgeted_steps, &counts.budget_units, &counts.work_units, &counts.cut_short_steps].map(Count::get)
        };
        let bounded = counted(output.clone(), Some(Pace::InTime), Some(80));
        assert_eq!((of(&bounded), bounded.unsettled_steps.get()), ([1, 80, 70, 1], 0), "that is asked for");
        let free = counted(StepOutput { solve: SolveReport { is_cut_short: false, ..solve }, ..output }, None, None);
        assert_eq!((of(&free), free.unsettled_steps.get()), ([0; 4], 1));
    }

    #[test]
    fn faults_are_told_apart_and_energy_that_is_no_number_spoils_no_sum() {
        let fault = |what| Some(Fault { step: 1, object: "block".into(), what });
        let energy = EnergyStep { residual_j: -0.5, tool_work_j: f64::NAN, ..EnergyStep::default() };
        let fracture = FractureStep { parted_links: 3, ..FractureStep::default() };
        let output = StepOutput { fault: fault(FaultKind::Energy), energy, fracture, ..StepOutput::default() };
        let counts = counted(output, None, None);
        assert_eq!((counts.faults.energy.get(), counts.faults.node_state.get()), (1, 0));
        assert_eq!((counts.residual.get_j(), counts.tool_work.get_j(), counts.parted_links.get()), (0.5, 0.0, 3));
    }
}
