//! Coulomb friction in a contact, of tools on tissue and of tissue on tissue.

use super::Misjudged;
use crate::Vec3;
use serde::{Deserialize, Serialize};

/// What sticks to a tool creeps along it at no more than this, m/s: a hundredth of the speed of a slow stroke. Half
/// of it makes the friction twice as stiff in the solve and the creep under a tool at rest half as fast; what
/// slides does not know of it.
const CREEP_ON_TOOLS_M_PER_S: f64 = 1e-3;
/// What tissue holds on tissue creeps at no more than this, m/s: what lies on something for a minute moves by 6 mm at
/// most, under nearly all the force that it can bear. Sensitivity as above.
const CREEP_IN_TISSUE_M_PER_S: f64 = 1e-4;

/// Fraction of the friction limit by which a stuck contact may exceed it before it slides: ten times the tolerance of the
/// usual solve. At zero rounding decides, and costs solves.
const STICK_SLACK: f64 = 1e-3;

/// What friction does during one solve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Regime {
    /// The ends stick: friction in proportion to the sliding speed, up to the limit at the speed of creep.
    Stick,
    /// The point slides along this unit vector, so fast: friction is at its limit along it, and turns with the velocity
    /// as that turns.
    Slide(Vec3, f64),
}

/// Coulomb friction on the point of a contact, against its sliding past what presses on it. A law with a jump at rest
/// would not be solved by a step: what sticks creeps in proportion to the force.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Friction {
    /// Largest friction, N: the coefficient times the normal force at the beginning of the step.
    pub limit_n: f64,
    /// Sliding velocity at the end of the step, m/s; before the solve as if velocities stayed.
    pub sliding_m_per_s: Vec3,
    /// Whether it sticks or slides.
    pub regime: Regime,
    /// Friction that the last solve applied to the point, N.
    pub force_n: Vec3,
    predicted_m_per_s: Vec3,
    creep_m_per_s: f64,
}

impl Friction {
    /// Friction of up to `limit_n` of a tool on a point that slides past it at `sliding_m_per_s` now. `None` where
    /// nothing presses.
    #[must_use]
    pub fn on_tool(limit_n: f64, sliding_m_per_s: Vec3) -> Option<Self> {
        Self::new(limit_n, CREEP_ON_TOOLS_M_PER_S, sliding_m_per_s)
    }

    /// The same of tissue on tissue.
    #[must_use]
    pub fn in_tissue(limit_n: f64, sliding_m_per_s: Vec3) -> Option<Self> {
        Self::new(limit_n, CREEP_IN_TISSUE_M_PER_S, sliding_m_per_s)
    }

    fn new(limit_n: f64, creep_m_per_s: f64, sliding_m_per_s: Vec3) -> Option<Self> {
        let speed = sliding_m_per_s.norm();
        let regime = if speed > creep_m_per_s { Regime::Slide(sliding_m_per_s / speed, speed) } else { Regime::Stick };
        let predicted_m_per_s = sliding_m_per_s;
        let force_n = Vec3::zeros();
        (limit_n > 0.0).then_some(Self { limit_n, sliding_m_per_s, regime, force_n, predicted_m_per_s, creep_m_per_s })
    }

    /// Force over velocity across the way that the point slides, N s/m; over all sliding velocity while it sticks.
    pub(super) fn drag_n_s_per_m(&self) -> f64 {
        match self.regime {
            Regime::Stick => self.limit_n / self.creep_m_per_s,
            Regime::Slide(_, speed_m_per_s) => self.limit_n / speed_m_per_s,
        }
    }

    /// The way that it slides, along which there is no drag.
    pub(super) fn way(&self) -> Option<Vec3> {
        if let Regime::Slide(along, _) = self.regime { Some(along) } else { None }
    }

    /// Force on a point that slides so, N: of the law `-limit v / |v|` what is linear about the speed of the regime.
    fn force_at_n(&self, sliding_m_per_s: &Vec3) -> Vec3 {
        let drag_n_s_per_m = self.drag_n_s_per_m();
        match self.regime {
            Regime::Stick => sliding_m_per_s * -drag_n_s_per_m,
            Regime::Slide(along, _) => {
                let across = sliding_m_per_s - along * sliding_m_per_s.dot(&along);
                along * -self.limit_n - across * drag_n_s_per_m
            }
        }
    }

    /// Momentum that it adds to the right side at the point, N s.
    pub(super) fn impulse(&self, dt_s: f64) -> Vec3 {
        self.force_at_n(&self.predicted_m_per_s) * dt_s
    }

    /// Takes the solution's change of the sliding velocity; returns how wrong the regime was.
    pub(super) fn settle(&mut self, dt_s: f64, change_m_per_s: Vec3) -> Misjudged {
        self.sliding_m_per_s = self.predicted_m_per_s + change_m_per_s;
        let speed = self.sliding_m_per_s.norm();
        self.force_n = self.force_at_n(&self.sliding_m_per_s);
        let next = match self.regime {
            Regime::Stick if speed > self.creep_m_per_s * (1.0 + STICK_SLACK) => {
                Regime::Slide(self.sliding_m_per_s / speed, speed)
            }
            Regime::Slide(along, _) if self.sliding_m_per_s.dot(&along) < 0.0 => Regime::Stick,
            regime => regime,
        };
        if std::mem::replace(&mut self.regime, next) == next {
            return Misjudged::default();
        }
        let wrong_n = match next {
            Regime::Slide(along, _) => self.force_n + along * self.limit_n,
            Regime::Stick => self.force_n,
        };
        Misjudged::by(dt_s * wrong_n.norm())
    }
}
