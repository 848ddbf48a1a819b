//! The work of a step, counted.
//!
//! How long a step takes depends on the machine, how much it does not: how many elements it goes through and how often. So
//! a step is bounded by its work, which is an input and leads to the same bits in a replay. Whoever knows the time finds
//! out what a unit takes here.
//!
//! A unit is a tenth of what one composite element costs in one iteration of a solve, the cycle that preconditions it
//! included. The other costs are measured against it, on the built-in liver in a session at 1 kHz, 500 and 250 Hz, by least
//! squares over steps (an iteration takes 200 to 300 us there): no result depends on them while work is unbounded. Where one is wrong by a half, time per unit differs by a tenth between
//! steps that press and steps that cut, and a budget holds its time as much less exactly.

use crate::solve::pcg::Effort;

/// Work of an iteration, by element.
const ITERATION: u64 = 10;
/// Of beginning a solve, by element: springs on every level, the first residual.
const SOLVE: u64 = 7;
/// Of what a step does whatever its solves take, by element: rotations, forces, energies, right side, contacts.
const STEP: u64 = 22;
/// Of measuring a field of a contact's model against the matrix of now, by element.
const FIELD: u64 = 6;
/// Of a station at the end of a cut at which the energy release rate is taken.
const LOOK: u64 = 80;
/// Of a link that parts.
const PARTED_LINK: u64 = 1500;

/// What a step has done, and may do.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct WorkMeter {
    /// Absent: all that it takes.
    budget: Option<u64>,
    /// Relative residual that solves may end at once the budget is used up.
    relative_residual: f64,
    done: u64,
}

impl WorkMeter {
    /// Begins a step.
    pub(crate) fn begin(budget: Option<u64>, relative_residual: f64) -> Self {
        Self { budget, relative_residual, done: 0 }
    }

    /// Counts what a step of so many elements does in any case.
    pub(crate) fn add_step(&mut self, elements: usize) {
        self.done += STEP * elements as u64;
    }

    /// Counts a solve of so many elements.
    pub(crate) fn add_solve(&mut self, elements: usize, iterations: u32) {
        self.done += (SOLVE + ITERATION * u64::from(iterations)) * elements as u64;
    }

    /// Counts looks at fields of a contact's model.
    pub(crate) fn add_fields(&mut self, elements: usize, fields: u32, iterations: u32) {
        self.done += (FIELD * u64::from(fields) + ITERATION * u64::from(iterations)) * elements as u64;
    }

    /// Counts what fracture and the topology that follows it took.
    pub(crate) fn add_fracture(&mut self, looks: u32, parted_links: u32) {
        self.done += LOOK * u64::from(looks) + PARTED_LINK * u64::from(parted_links);
    }

    /// Work by element of so many that the budget leaves; `None` where there is none.
    fn left(&self, elements: usize) -> Option<u64> {
        Some(self.budget?.saturating_sub(self.done) / elements.max(1) as u64)
    }

    /// What a solve of so many elements may take; `None` where there is no budget.
    pub(crate) fn effort(&self, elements: usize) -> Option<Effort> {
        let iterations = to_u32(self.left(elements)? / ITERATION);
        Some(Effort { iterations, relative_residual: self.relative_residual })
    }

    /// Of so many fields and iterations those that the budget leaves, on so many elements; one of each at least, so that a
    /// model comes to an end. A field takes an iteration or so.
    pub(crate) fn share_of_model(&self, elements: usize, (fields, iterations): (u32, u32)) -> (u32, u32) {
        let Some(left) = self.left(elements) else { return (fields, iterations) };
        let fields = fields.min(to_u32(left / (FIELD + ITERATION)).max(1));
        let of_iterations = left.saturating_sub(FIELD * u64::from(fields)) / ITERATION;
        (fields, iterations.min(to_u32(of_iterations).max(1)))
    }

    /// Whether the budget is used up.
    pub(crate) fn is_spent(&self) -> bool {
        self.budget.is_some_and(|budget| self.done >= budget)
    }

    /// Units so far.
    pub(crate) fn done(&self) -> u64 {
        self.done
    }
}

fn to_u32(count: u64) -> u32 {
    count.try_into().unwrap_or(u32::MAX)
}
