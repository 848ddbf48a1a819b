//! Contact of tools with tissue and of tissue with tissue: broad phase, narrow phase and the springs they
//! lead to.

pub mod broad;
pub mod candidates;
pub mod flank;
pub mod friction;
pub mod grip;
pub mod narrow;
pub mod palpation;
pub mod patch_hash;
pub mod press;
pub mod tissue_spring;

use crate::Vec3;

/// Nodes that share a contact point, and their weights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactWeights {
    entries: [(u32, f64); 16],
    count: usize,
}

impl ContactWeights {
    /// Adds `weight` at `node`.
    pub fn add(&mut self, node: u32, weight: f64) {
        match self.entries[..self.count].iter_mut().find(|e| e.0 == node) {
            Some(entry) => entry.1 += weight,
            None => {
                self.entries[self.count] = (node, weight);
                self.count += 1;
            }
        }
    }

    /// Nodes and weights.
    pub fn iter(&self) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.entries[..self.count].iter().copied()
    }

    /// Weighted sum of a nodal vector.
    #[must_use]
    pub fn sum(&self, values: &[[f64; 3]]) -> Vec3 {
        self.iter().map(|(node, w)| Vec3::from(values[node as usize]) * w).sum()
    }
}

/// What a contact does during one solve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Mode {
    /// Apart: no force.
    #[default]
    Off,
    /// A spring.
    Spring,
    /// Its force is capped: constant, no stiffness.
    Yield,
}

/// How good the solution is that contacts take their modes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solution {
    /// On the way: it tells what presses from what does not, and what has a limit waits for the end. It is only asked
    /// how wrong the modes are.
    Glance,
    /// The same, and the modes change.
    Rough,
    /// Solved to the tolerance.
    Final,
}

/// What contacts did in a solve against what its solution says that they should have done: the sum of the squares of
/// the impulses that are wrong, N^2 s^2. Like a residual, it need not be zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Misjudged(f64);

impl Misjudged {
    /// One contact, by an impulse, N s.
    #[must_use]
    pub fn by(impulse_n_s: f64) -> Self {
        Self(impulse_n_s * impulse_n_s)
    }

    /// A contact that holds or gives: its force is what the solve is for.
    #[must_use]
    pub fn beyond_doubt() -> Self {
        Self(f64::INFINITY)
    }

    /// Norm of the impulses, N s.
    #[must_use]
    pub fn norm_n_s(self) -> f64 {
        self.0.sqrt()
    }
}

impl std::ops::AddAssign for Misjudged {
    fn add_assign(&mut self, other: Self) {
        self.0 += other.0;
    }
}

/// A unilateral spring between a point of a tool and a material point. The gap is positive where the
/// tool has gone past the material point along `direction`; the force on the tissue is along it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Contact {
    /// The material point.
    pub weights: ContactWeights,
    /// Unit direction of the force on the tissue, scene frame.
    pub direction: Vec3,
    /// The tool's point at t + dt, m.
    pub tool_point_m: Vec3,
    /// The tool's point at t, m.
    pub tool_point_before_m: Vec3,
    /// Stiffness, N/m.
    pub stiffness_n_per_m: f64,
    /// Gap at the beginning of the step, m.
    pub gap_before_m: f64,
    /// Gap at the end of the step if the tissue kept its velocity, m.
    pub gap_predicted_m: f64,
    /// Gap at the end of the step, after the solve, m.
    pub gap_m: f64,
    /// Force along `direction` that the last solve applied, N: a mode that changes after it counts in
    /// the next one.
    pub force_n: f64,
    /// Force at which the spring gives, N; infinite: never.
    pub limit_n: f64,
    /// Force that is left after it has given, N.
    pub yield_n: f64,
    /// Gap by which the mode may be wrong at the end of the step without another solve, m.
    pub slack_m: f64,
    /// Whether the spring also pulls.
    pub bilateral: bool,
    /// What it does now.
    pub mode: Mode,
}

impl Contact {
    /// Momentum that the contact adds to the right side along `direction`, N s.
    #[must_use]
    pub fn impulse(&self, dt_s: f64) -> f64 {
        match self.mode {
            Mode::Off => 0.0,
            Mode::Spring => dt_s * self.stiffness_n_per_m * self.gap_predicted_m,
            Mode::Yield => dt_s * self.yield_n,
        }
    }

    /// Gap and force of the solution's change of velocity.
    pub fn take_solution(&mut self, dt_s: f64, velocity_change: &[[f64; 3]]) {
        self.gap_m = self.gap_predicted_m - dt_s * self.weights.sum(velocity_change).dot(&self.direction);
        self.force_n = match self.mode {
            Mode::Off => 0.0,
            Mode::Spring => self.stiffness_n_per_m * self.gap_m,
            Mode::Yield => self.yield_n,
        };
    }

    /// Takes the solution's change of velocity and what it says of the mode; returns how wrong the mode was.
    pub fn settle(&mut self, dt_s: f64, velocity_change: &[[f64; 3]], solution: Solution) -> Misjudged {
        if solution != Solution::Final && self.limit_n.is_finite() {
            return Misjudged::default();
        }
        self.take_solution(dt_s, velocity_change);
        let force = self.stiffness_n_per_m * self.gap_m;
        let next = match self.mode {
            Mode::Off if self.gap_m > self.slack_m || self.bilateral => Mode::Spring,
            Mode::Spring if self.gap_m < -self.slack_m && !self.bilateral => Mode::Off,
            Mode::Spring if force > self.limit_n => Mode::Yield,
            Mode::Yield if force < self.yield_n => Mode::Spring,
            mode => mode,
        };
        if solution == Solution::Glance {
            return if next == self.mode { Misjudged::default() } else { Misjudged::by(dt_s * force) };
        }
        if next == Mode::Yield {
            // Given once, it gives at the lower force from now on.
            self.limit_n = self.yield_n;
        }
        if std::mem::replace(&mut self.mode, next) == next {
            Misjudged::default()
        } else if self.limit_n.is_finite() {
            Misjudged::beyond_doubt()
        } else {
            Misjudged::by(dt_s * force)
        }
    }
}
