//! Contact of tools with tissue and of tissue with tissue: broad phase, narrow phase and the constraint that both
//! lead to, a spring with two ends and Coulomb friction.

pub mod broad;
pub mod candidates;
pub mod ends;
pub mod flank;
pub mod friction;
pub mod grasp;
pub mod narrow;
pub mod palpation;
pub mod press;
mod solution;

pub use ends::{TissueEnds, ToolEnds};
pub use friction::Friction;
pub use solution::{Misjudged, Solution};

use crate::Vec3;
use crate::body::{Body, PointWeights};
use crate::grid::MaterialPoint;
use crate::solve::spring::PointSpring;
use serde::{Deserialize, Serialize};

/// Speed at which what is found deeper than the last step left it comes out, voxels per second. A contact that pushed at
/// once for the whole depth would make energy of it. With half of this speed it takes twice the time to its force.
pub(crate) const COMES_OUT_VOXELS_PER_S: f64 = 1.0;

/// What is no deeper than this many voxels is on the surface: a hand that puts a blade onto the tissue is. No surface is
/// more exact. With none, scripts that begin at the surface wait for ever; with twice as much a probe that comes in so
/// deep is pushed out by as much at once.
pub(crate) const ON_SURFACE_VOXELS: f64 = 0.5;

/// Depth to which so much energy presses a spring, m; 0 where it is less than none.
pub(crate) fn pressed_m(stiffness_n_per_m: f64, held_j: f64) -> f64 {
    (2.0 * held_j.max(0.0) / stiffness_n_per_m).sqrt()
}

/// Nodes that share a contact point, and their weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ContactWeights {
    entries: [(u32, f64); 16],
    count: usize,
    /// What is held contributes this to the point's position, m.
    fixed_m: Vec3,
}

impl ContactWeights {
    /// Those of a material point, times `factor`.
    #[must_use]
    pub fn of(body: &Body, point: &MaterialPoint, factor: f64) -> Self {
        let mut weights = Self::default();
        weights.add_point(&body.weights(point), factor);
        weights
    }

    /// Adds those of a point, times `factor`.
    pub fn add_point(&mut self, point: &PointWeights, factor: f64) {
        point.iter().for_each(|(node, n)| self.add(node, factor * n));
        self.fixed_m += point.fixed_m * factor;
    }

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

    /// Whether it may be of a mesh of so many nodes: what was read from a file may not.
    #[must_use]
    pub fn fits(&self, nodes: usize) -> bool {
        self.count <= self.entries.len() && self.iter().all(|(node, _)| (node as usize) < nodes)
    }

    /// Where the point is at these positions of the nodes, m.
    #[must_use]
    pub fn place_m(&self, position_m: &[[f64; 3]]) -> Vec3 {
        self.sum(position_m) + self.fixed_m
    }

    /// Weighted sum of a nodal vector: of velocities, say.
    #[must_use]
    pub fn sum(&self, values: &[[f64; 3]]) -> Vec3 {
        self.iter().map(|(node, w)| Vec3::from(values[node as usize]) * w).sum()
    }
}

/// What a contact does during one solve; of two the lesser has let go of more.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
pub enum Mode {
    /// Apart: no force.
    #[default]
    Off,
    /// Its force is capped: constant, no stiffness.
    Yield,
    /// A spring.
    Spring,
}

/// A unilateral spring between a point of tissue and what presses on it, of a tool or of tissue. The gap is positive
/// where that has gone past the point along `direction`; the force on the point is along it, and equal and
/// opposite on what presses.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Contact<E = ToolEnds> {
    /// What it is between.
    pub ends: E,
    /// Unit direction of the force on the point, scene frame.
    pub direction: Vec3,
    /// Stiffness, N/m.
    pub stiffness_n_per_m: f64,
    /// The spring's compliance over that of spring and tissue behind it: what gives way as it comes on.
    pub share_of_compliance: f64,
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
    /// Energy at the end of the step beyond half of force times gap, J: of a law that is not linear, whose tangent the
    /// spring is. It counts while the spring pushes.
    pub more_stored_j: f64,
    /// Gap up to which it may stay off at the end of the step without another solve, m.
    pub slack_m: f64,
    /// Gap below zero up to which it may stay on so, m.
    pub pull_slack_m: f64,
    /// Whether the spring also pulls.
    pub bilateral: bool,
    /// What it does now.
    pub mode: Mode,
    /// Present where the ends rub, and have touched. It acts while the contact does.
    pub friction: Option<Friction>,
}

/// A contact between tissue and tissue.
pub type TissueContact = Contact<TissueEnds>;

impl<E: Default> Default for Contact<E> {
    /// A contact that is off, never gives, and whose tissue gives nothing.
    fn default() -> Self {
        Self {
            ends: E::default(),
            direction: Vec3::zeros(),
            stiffness_n_per_m: 0.0,
            share_of_compliance: 1.0,
            gap_before_m: 0.0,
            gap_predicted_m: 0.0,
            gap_m: 0.0,
            force_n: 0.0,
            limit_n: f64::INFINITY,
            yield_n: 0.0,
            more_stored_j: 0.0,
            slack_m: 0.0,
            pull_slack_m: 0.0,
            bilateral: false,
            mode: Mode::Off,
            friction: None,
        }
    }
}

impl<E> Contact<E> {
    /// Momentum that the contact adds to the right side at its point, N s.
    #[must_use]
    pub fn impulse(&self, dt_s: f64) -> Vec3 {
        let along = match self.mode {
            Mode::Off => return Vec3::zeros(),
            Mode::Spring => dt_s * self.stiffness_n_per_m * self.gap_predicted_m,
            Mode::Yield => dt_s * self.yield_n,
        };
        self.direction * along + self.friction.map_or(Vec3::zeros(), |friction| friction.impulse(dt_s))
    }

    /// Its part of the matrix at a point with these weights.
    #[must_use]
    pub fn point_spring(&self, weights: impl Iterator<Item = (u32, f64)>, dt_s: f64) -> PointSpring {
        let mut spring = PointSpring::new(weights, [0.0; 3], 0.0);
        self.add_to(&mut spring, dt_s);
        spring
    }

    fn add_to(&self, spring: &mut PointSpring, dt_s: f64) {
        // Friction drags every way but along the normal, and along the way of what slides.
        let drag = self.friction.map_or(0.0, |friction| dt_s * friction.drag_n_s_per_m());
        spring.add_direction(self.direction.into(), dt_s * dt_s * self.stiffness_n_per_m - drag);
        if drag > 0.0 {
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            axes.into_iter().for_each(|axis| spring.add_direction(axis, drag));
            if let Some(way) = self.friction.and_then(|friction| friction.way()) {
                spring.add_direction(way.into(), -drag);
            }
        }
    }

    /// Gap and force where the point's velocity has changed by so much against that of what presses.
    pub fn take_solution(&mut self, dt_s: f64, change_m_per_s: &Vec3) {
        self.gap_m = self.gap_predicted_m - dt_s * change_m_per_s.dot(&self.direction);
        self.force_n = match self.mode {
            Mode::Off => 0.0,
            Mode::Spring => self.stiffness_n_per_m * self.gap_m,
            Mode::Yield => self.yield_n,
        };
    }

    /// Takes the solution's change of velocity and what it says of the mode; returns how wrong the mode was.
    pub fn settle(&mut self, dt_s: f64, change_m_per_s: &Vec3, solution: Solution) -> Misjudged {
        if !solution.is_solved() && self.limit_n.is_finite() {
            return Misjudged::default();
        }
        self.take_solution(dt_s, change_m_per_s);
        let next = self.mode_found();
        let mut wrong = Misjudged::default();
        if let (Some(friction), true) = (&mut self.friction, solution.is_solved() && self.mode != Mode::Off) {
            let along = self.direction * change_m_per_s.dot(&self.direction);
            wrong += friction.settle(dt_s, change_m_per_s - along);
        }
        if next != self.mode {
            wrong += self.misjudged(dt_s, next);
        }
        let may_change = match solution {
            Solution::Trial => false,
            Solution::Rough | Solution::Final => true,
            Solution::LettingGo => next < self.mode,
        };
        if may_change && next != self.mode {
            self.change_to(next);
        }
        wrong
    }

    /// The mode that the solution taken says it should have had.
    fn mode_found(&self) -> Mode {
        let force_n = self.stiffness_n_per_m * self.gap_m;
        match self.mode {
            Mode::Off if self.gap_m > self.slack_m || self.bilateral => Mode::Spring,
            Mode::Spring | Mode::Yield if self.gap_m < -self.pull_slack_m && !self.bilateral => Mode::Off,
            Mode::Spring if force_n > self.limit_n => Mode::Yield,
            Mode::Yield if force_n < self.yield_n => Mode::Spring,
            mode => mode,
        }
    }

    /// By how much it was wrong if `next` is the mode that it should have had.
    fn misjudged(&self, dt_s: f64, next: Mode) -> Misjudged {
        let impulse_n_s = dt_s * self.stiffness_n_per_m * self.gap_m;
        let wrong = match next {
            Mode::Off => Misjudged::too_much(dt_s * self.force_n),
            Mode::Yield => Misjudged::too_much(impulse_n_s - dt_s * self.limit_n),
            // What holds up nothing yet is deeper than it will be: the tissue gives way as the spring comes on.
            Mode::Spring if self.mode == Mode::Off => Misjudged::by(self.share_of_compliance * impulse_n_s),
            Mode::Spring => Misjudged::by(impulse_n_s - dt_s * self.yield_n),
        };
        // What gives for the first time lets go of more than it was wrong by. Then its force goes on as it is.
        if self.is_yet_to_give() { wrong.beyond_doubt() } else { wrong }
    }

    /// Whether it gives at a limit, and falls to a lower force as it does.
    pub fn is_yet_to_give(&self) -> bool {
        self.limit_n.is_finite() && self.limit_n > self.yield_n
    }

    fn change_to(&mut self, next: Mode) {
        if next == Mode::Yield {
            // Given once, it gives at the lower force from now on.
            self.limit_n = self.yield_n;
        }
        self.mode = next;
    }

    /// Force on the point that the last solve applied, friction included, N, scene frame.
    #[must_use]
    pub fn applied_n(&self) -> Vec3 {
        self.direction * self.force_n + self.acting_friction().map_or(Vec3::zeros(), |friction| friction.force_n)
    }

    fn acting_friction(&self) -> Option<Friction> {
        self.friction.filter(|_| self.force_n != 0.0)
    }

    /// Goes on as it is between ends that stay where they are: nothing slides, nothing is done.
    pub fn come_to_rest(&mut self) {
        (self.gap_before_m, self.gap_predicted_m) = (self.gap_m, self.gap_m);
        self.friction = None;
    }

    /// How far it is compressed at the end of the step, m.
    #[must_use]
    pub fn compressed_m(&self) -> f64 {
        if self.force_n == 0.0 { 0.0 } else { self.force_n / self.stiffness_n_per_m }
    }

    /// Energy stored at the end of the step, J, where it never gives.
    #[must_use]
    pub fn stored_j(&self) -> f64 {
        0.5 * self.force_n * self.gap_m + if self.force_n == 0.0 { 0.0 } else { self.more_stored_j }
    }

    /// Work done on the spring in the step, J.
    #[must_use]
    pub fn work_j(&self) -> f64 {
        self.force_n * (self.gap_m - self.gap_before_m)
    }

    /// What friction dissipated in the step, J.
    #[must_use]
    pub fn friction_j(&self, dt_s: f64) -> f64 {
        self.acting_friction().map_or(0.0, |friction| -dt_s * friction.force_n.dot(&friction.sliding_m_per_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A contact of 100 N/m that gives at 2 N and then at 1 N, in a mode and at a gap.
    fn contact(mode: Mode, gap_m: f64) -> Contact {
        Contact {
            direction: Vec3::x(),
            stiffness_n_per_m: 100.0,
            limit_n: 2.0,
            yield_n: 1.0,
            gap_predicted_m: gap_m,
            mode,
            ..Contact::default()
        }
    }

    fn settled(mut contact: Contact, solution: Solution) -> (Mode, Misjudged) {
        let wrong = contact.settle(1.0, &Vec3::zeros(), solution);
        (contact.mode, wrong)
    }

    #[test]
    fn what_has_given_lets_go_rather_than_pull() {
        for solution in [Solution::Final, Solution::LettingGo] {
            let (mode, wrong) = settled(contact(Mode::Yield, -0.03), solution);
            assert_eq!(mode, Mode::Off, "{solution:?}");
            assert!(wrong.exceeds(f64::MAX) && wrong.too_much_n_s() == 1.0, "it pushed by 1 N: {wrong:?}");
        }
        assert_eq!(settled(contact(Mode::Yield, 0.005), Solution::Final).0, Mode::Spring);
    }

    #[test]
    fn what_has_given_goes_on_giving_at_the_same_force_and_is_off_by_no_more_than_it_is() {
        for (mode, gap_m, next) in [(Mode::Spring, 0.0101, Mode::Yield), (Mode::Yield, 0.0099, Mode::Spring)] {
            let given = Contact { limit_n: 1.0, ..contact(mode, gap_m) };
            let (found, wrong) = settled(given, Solution::Final);
            assert_eq!(found, next);
            assert!(!wrong.exceeds(0.011) && wrong.exceeds(0.009), "by 0.01 N: {wrong:?}");
        }
        let (_, wrong) = settled(contact(Mode::Spring, 0.0201), Solution::Final);
        assert!(wrong.exceeds(f64::MAX), "it falls from 2 N to 1: {wrong:?}");
    }

    #[test]
    fn a_contact_that_may_only_let_go_does_not_come_on() {
        let cases = [
            // Mode and gap before; mode after, and what it did too much, N s.
            (Mode::Off, 0.01, Mode::Off, 0.0),
            (Mode::Yield, 0.005, Mode::Yield, 0.0),
            (Mode::Spring, 0.03, Mode::Yield, 1.0),
            (Mode::Spring, -0.03, Mode::Off, 3.0),
        ];
        for (before, gap_m, after, too_much_n_s) in cases {
            let (mode, wrong) = settled(contact(before, gap_m), Solution::LettingGo);
            assert_eq!((mode, wrong.exceeds(f64::MAX)), (after, true), "{before:?} at {gap_m} m");
            assert!((wrong.too_much_n_s() - too_much_n_s).abs() < 1e-12, "{before:?} at {gap_m} m: {wrong:?}");
        }
    }
}
