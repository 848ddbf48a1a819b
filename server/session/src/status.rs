//! What a session is doing and how it is doing.

use std::sync::Arc;

use hdrhistogram::Histogram;
use kerf_physics::step_io::{EnergyStep, StepOutput};
use kerf_physics::{Stage, Vec3};

use crate::pacer::Pace;

/// What a session is doing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// It steps.
    #[default]
    Running,
    /// It stands until it is resumed.
    Paused,
    /// A step panicked; it stands until it is reset.
    Failed {
        /// What the panic said.
        message: Arc<str>,
    },
    /// It is about to end.
    Closing,
}

impl Phase {
    /// What the panic said, if one failed the session.
    #[must_use]
    pub fn failure(&self) -> Option<&str> {
        match self {
            Self::Failed { message } => Some(message),
            Self::Running | Self::Paused | Self::Closing => None,
        }
    }
}

/// A session's description of itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SessionStatus {
    /// What it is doing.
    pub phase: Phase,
    /// Steps taken.
    pub step: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Rises each time links part.
    pub topology_version: u64,
    /// Steps that ended after their deadline, since the session began or was reset.
    pub late_steps: u64,
    /// Relative residual that solves end at: the scene's tolerance, or what bounded work has left lately.
    pub relative_tolerance: f64,
    /// Times that the session gave lost time up, since it began or was reset.
    pub reanchors: u64,
    /// Energy booked since the scene was at rest: sums of works, levels as they are.
    pub energy: EnergyStep,
    /// Displacement of each tracked point, m.
    pub tracked_displacement_m: Vec<Vec3>,
    /// Hash of positions, velocities, fronts and topology.
    pub state_hash: u64,
}

/// Durations of steps, summed up between two states that viewers see.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepTimes {
    /// Steps summed up.
    pub steps: u32,
    /// Time per stage, ns, indexed by `Stage as usize`. What is done for viewers, beside the steps, is in it too: contouring
    /// and adapting the surface.
    pub stage_ns: [u64; Stage::ALL.len()],
    /// Time of all steps, ns.
    pub total_ns: u64,
    /// Time of the longest step, ns.
    pub max_ns: u64,
    /// Solver iterations of all steps.
    pub solver_iterations: u64,
}

impl StepTimes {
    /// Adds a step that took `elapsed_ns` by the session's clock.
    pub(crate) fn add(&mut self, output: &StepOutput, elapsed_ns: u64) {
        self.steps += 1;
        for (sum, stage_ns) in self.stage_ns.iter_mut().zip(output.profile.stage_ns) {
            *sum += stage_ns.unwrap_or(0);
        }
        self.total_ns += elapsed_ns;
        self.max_ns = self.max_ns.max(elapsed_ns);
        self.solver_iterations += u64::from(output.solve.iterations);
    }

    /// Adds the steps that came after these.
    pub(crate) fn join(&mut self, next: &Self) {
        self.steps += next.steps;
        self.stage_ns.iter_mut().zip(next.stage_ns).for_each(|(sum, next_ns)| *sum += next_ns);
        self.total_ns += next.total_ns;
        self.max_ns = self.max_ns.max(next.max_ns);
        self.solver_iterations += next.solver_iterations;
    }
}

/// Longest step that is told apart; longer ones count as this.
const MAX_STEP_NS: u64 = 60_000_000_000;
/// Two digits: quantiles are exact to 1 %, in a fixed 30 kB.
const STEP_DIGITS: u8 = 2;

/// Steps of one kind: how long they took, and how many were late.
#[derive(Clone, Debug, PartialEq)]
pub struct StepTally {
    /// Durations by the session's clock, ns.
    pub duration_ns: Histogram<u64>,
    /// Of these steps, those that ended after their deadline.
    pub late: u64,
}

impl Default for StepTally {
    fn default() -> Self {
        let duration_ns = Histogram::new_with_bounds(1, MAX_STEP_NS, STEP_DIGITS)
            .expect("the bounds are constants that the histogram takes");
        Self { duration_ns, late: 0 }
    }
}

impl StepTally {
    fn add(&mut self, elapsed_ns: u64, pace: Pace) {
        self.duration_ns.saturating_record(elapsed_ns);
        self.late += u64::from(pace != Pace::InTime);
    }
}

/// The steps since the scene was at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepTallies {
    /// All of them.
    pub all: StepTally,
    /// Those in which an edge was cutting.
    pub cutting: StepTally,
}

impl StepTallies {
    /// Adds a step that took `elapsed_ns` by the session's clock.
    pub(crate) fn add(&mut self, output: &StepOutput, elapsed_ns: u64, pace: Pace) {
        self.all.add(elapsed_ns, pace);
        if output.tools.iter().any(|tool| tool.cutting_length_m > 0.0) {
            self.cutting.add(elapsed_ns, pace);
        }
    }
}

#[cfg(test)]
mod tests {
    use kerf_physics::step_io::ToolOutput;

    use super::*;

    #[test]
    fn steps_that_cut_are_tallied_apart() {
        let mut tallies = StepTallies::default();
        let step = |cutting_length_m| {
            let tools = vec![ToolOutput::default(), ToolOutput { cutting_length_m, ..ToolOutput::default() }];
            StepOutput { tools, ..StepOutput::default() }
        };
        tallies.add(&step(0.0), 1000, Pace::Late { lag_ns: 500 });
        tallies.add(&step(0.01), 5000, Pace::Reanchored { lag_ns: 1 << 40 });
        tallies.add(&step(0.01), 7000, Pace::InTime);
        assert_eq!((tallies.all.duration_ns.len(), tallies.all.late), (3, 2));
        assert_eq!((tallies.cutting.duration_ns.len(), tallies.cutting.late), (2, 1));
        assert!(tallies.cutting.duration_ns.min() > tallies.all.duration_ns.min());
    }
}
