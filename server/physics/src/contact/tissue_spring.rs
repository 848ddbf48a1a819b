//! The unilateral spring between a point of one surface and another surface, with Coulomb friction.
//!
//! Both ends are points of tissue and the force on them is equal and opposite, along the line between
//! them: linear and angular momentum stay what they are.

use super::{ContactWeights, Misjudged, Mode, Solution};
use crate::Vec3;
use crate::solve::spring::PointSpring;

/// Sliding speed below which friction holds, m/s: what is held creeps by at most a tenth of a millimetre
/// per second.
const STICK_SPEED_M_PER_S: f64 = 1e-4;
/// Share of the friction limit by which a stuck contact may exceed it before it slides.
const STICK_SLACK: f64 = 1e-3;

/// One end of a spring.
#[derive(Clone, Copy, Debug, Default)]
pub struct SpringEnd {
    /// Index of the body.
    pub body: u32,
    /// The point's weights; those of the surface are negative, so that the ends add up to what the one
    /// moves relative to the other.
    pub weights: ContactWeights,
}

/// What friction does during one solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Grip {
    /// The ends stick: friction in proportion to the sliding speed, up to the limit at
    /// `STICK_SPEED_M_PER_S`.
    Stick,
    /// The one end slides along this unit vector: friction is at its limit.
    Slide(Vec3),
}

/// Coulomb friction in a contact.
#[derive(Clone, Copy, Debug)]
pub struct Friction {
    /// Largest friction, N: the coefficient times the normal force of the step before.
    pub limit_n: f64,
    /// Sliding velocity at the end of the step, m/s; before the solve as if velocities stayed.
    pub sliding_m_per_s: Vec3,
    /// What it does.
    pub grip: Grip,
    /// Friction that the last solve applied to the point, N.
    pub force_n: Vec3,
    predicted_m_per_s: Vec3,
}

impl Friction {
    /// Friction up to `limit_n` between ends that slide at `sliding_m_per_s` now.
    #[must_use]
    pub fn new(limit_n: f64, sliding_m_per_s: Vec3) -> Self {
        let speed = sliding_m_per_s.norm();
        let grip = if speed > STICK_SPEED_M_PER_S { Grip::Slide(sliding_m_per_s / speed) } else { Grip::Stick };
        let predicted_m_per_s = sliding_m_per_s;
        Self { limit_n, sliding_m_per_s, grip, force_n: Vec3::zeros(), predicted_m_per_s }
    }

    fn drag_n_s_per_m(&self) -> f64 {
        if self.grip == Grip::Stick { self.limit_n / STICK_SPEED_M_PER_S } else { 0.0 }
    }

    fn impulse(&self, dt_s: f64) -> Vec3 {
        match self.grip {
            Grip::Stick => self.predicted_m_per_s * (-dt_s * self.drag_n_s_per_m()),
            Grip::Slide(along) => along * (-dt_s * self.limit_n),
        }
    }

    fn settle(&mut self, dt_s: f64, change_m_per_s: Vec3) -> Misjudged {
        self.sliding_m_per_s = self.predicted_m_per_s + change_m_per_s;
        let speed = self.sliding_m_per_s.norm();
        let next = match self.grip {
            Grip::Stick => {
                self.force_n = self.sliding_m_per_s * -self.drag_n_s_per_m();
                let slides = speed > STICK_SPEED_M_PER_S * (1.0 + STICK_SLACK);
                if slides { Grip::Slide(self.sliding_m_per_s / speed) } else { Grip::Stick }
            }
            Grip::Slide(along) => {
                self.force_n = along * -self.limit_n;
                if self.sliding_m_per_s.dot(&along) < 0.0 { Grip::Stick } else { self.grip }
            }
        };
        if std::mem::replace(&mut self.grip, next) == next {
            return Misjudged::default();
        }
        let wrong_n = match next {
            Grip::Slide(along) => self.force_n + along * self.limit_n,
            Grip::Stick => self.force_n,
        };
        Misjudged::by(dt_s * wrong_n.norm())
    }
}

/// A spring between a point and a surface.
#[derive(Clone, Copy, Debug)]
pub struct TissueSpring {
    /// The point, and the surface under it.
    pub ends: [SpringEnd; 2],
    /// The patch of the first end's body that the point is the middle of.
    pub patch: u32,
    /// Unit normal out of the surface: the force on the point is along it.
    pub normal: Vec3,
    /// Stiffness, N/m.
    pub stiffness_n_per_m: f64,
    /// Share of the spring in its compliance and that of the tissue behind it.
    pub share_of_compliance: f64,
    /// Depth of the point under the surface at the beginning of the step, m.
    pub depth_before_m: f64,
    /// The same at the end of the step if the tissue kept its velocity, m.
    pub depth_predicted_m: f64,
    /// The same at the end of the step, after the solve, m.
    pub depth_m: f64,
    /// Depth at which it may stay off without another solve, m.
    pub slack_m: f64,
    /// Normal force that the last solve applied, N.
    pub force_n: f64,
    /// What it does now: it is off or a spring.
    pub mode: Mode,
    /// Present where both surfaces have a coefficient of friction, and have touched.
    pub friction: Option<Friction>,
}

impl TissueSpring {
    /// Sum over the ends of a nodal vector of their bodies: what the point has more of than the surface.
    #[must_use]
    pub fn relative<'a>(&self, values: impl Fn(u32) -> &'a [[f64; 3]]) -> Vec3 {
        self.ends.iter().map(|end| end.weights.sum(values(end.body))).sum()
    }

    /// Whether its ends are in different bodies.
    #[must_use]
    pub fn joins_bodies(&self) -> bool {
        self.ends[0].body != self.ends[1].body
    }

    /// Momentum that it adds to the right side at the point, N s.
    #[must_use]
    pub fn impulse(&self, dt_s: f64) -> Vec3 {
        match self.mode {
            Mode::Off => Vec3::zeros(),
            Mode::Spring | Mode::Yield => {
                let normal = self.normal * (dt_s * self.stiffness_n_per_m * self.depth_predicted_m);
                normal + self.friction.map_or(Vec3::zeros(), |f| f.impulse(dt_s))
            }
        }
    }

    /// Nodes of a body that the spring acts on and their weights.
    pub fn weights_in(&self, body: u32) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.ends.iter().filter(move |end| end.body == body).flat_map(|end| end.weights.iter())
    }

    /// Its share of the matrix of a body.
    #[must_use]
    pub fn point_spring(&self, body: u32, dt_s: f64) -> PointSpring {
        let drag = self.friction.map_or(0.0, |f| dt_s * f.drag_n_s_per_m());
        let normal = dt_s * dt_s * self.stiffness_n_per_m - drag;
        let mut spring = PointSpring::new(self.weights_in(body), self.normal.into(), normal);
        if drag > 0.0 {
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            axes.into_iter().for_each(|axis| spring.add_direction(axis, drag));
        }
        spring
    }

    /// Takes the solution's relative change of velocity; returns how wrong its modes were.
    pub fn settle(&mut self, dt_s: f64, change_m_per_s: Vec3, solution: Solution) -> Misjudged {
        let along = change_m_per_s.dot(&self.normal);
        self.depth_m = self.depth_predicted_m - dt_s * along;
        let (next, force_n) = match self.mode {
            Mode::Off => (if self.depth_m > self.slack_m { Mode::Spring } else { Mode::Off }, 0.0),
            mode => {
                let next = if self.depth_m < 0.0 { Mode::Off } else { mode };
                (next, self.stiffness_n_per_m * self.depth_m)
            }
        };
        self.force_n = force_n;
        let mut wrong = Misjudged::default();
        if let (Some(friction), true) = (&mut self.friction, solution == Solution::Final && self.mode != Mode::Off) {
            wrong += friction.settle(dt_s, change_m_per_s - self.normal * along);
        }
        if next != self.mode {
            // What holds up nothing yet is deeper than it will be: the tissue gives way as the spring comes on.
            let share = if next == Mode::Off { 1.0 } else { self.share_of_compliance };
            wrong += Misjudged::by(share * dt_s * self.stiffness_n_per_m * self.depth_m);
        }
        if solution != Solution::Glance {
            self.mode = next;
        }
        wrong
    }

    /// Energy stored at the end of the step, J.
    #[must_use]
    pub fn stored_j(&self) -> f64 {
        0.5 * self.force_n * self.depth_m
    }

    /// Work that the bodies did on the spring in the step, J.
    #[must_use]
    pub fn work_j(&self) -> f64 {
        self.force_n * (self.depth_m - self.depth_before_m)
    }

    /// What friction dissipated in the step, J.
    #[must_use]
    pub fn friction_j(&self, dt_s: f64) -> f64 {
        let acts = self.friction.filter(|_| self.force_n != 0.0);
        acts.map_or(0.0, |f| -dt_s * f.force_n.dot(&f.sliding_m_per_s))
    }
}
