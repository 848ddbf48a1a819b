//! The virtual coupling: a spring and a damper between the hand and the tool.
//!
//! The tool has no mass. It is where the coupling and the contact are in balance, and that is where the server is told
//! it is; so in steady contact the hand feels the force that the server computes, whatever the coupling's stiffness. The
//! equation is solved implicitly, so neither stiff contact nor a long step makes the tool swing.

use kerf_script::Pose;
use nalgebra::{Cholesky, Matrix3, Vector3};

use super::Hand;
use super::model::Reaction;

/// Steps of Newton's method: one is exact where no bound of the model begins or ends to act.
const ITERATIONS: usize = 2;

/// Stiffness and damping of the coupling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// N s/m.
    pub damping_n_s_per_m: f64,
}

/// The tool at the end of the coupling.
#[derive(Clone, Copy, Debug, Default)]
pub struct Coupling {
    /// `None` before the first step: it begins in the hand.
    tool_m: Option<Vector3<f64>>,
    velocity_m_per_s: Vector3<f64>,
}

impl Coupling {
    /// Where the tool is.
    #[must_use]
    pub fn tool(&self, hand: &Hand) -> Pose {
        Pose { position_m: self.tool_m.unwrap_or(hand.pose.position_m), ..hand.pose }
    }

    /// How fast it went there in the last step, m/s.
    #[must_use]
    pub fn velocity_m_per_s(&self) -> &Vector3<f64> {
        &self.velocity_m_per_s
    }

    /// Moves the tool with the hand, against the contact; returns the force on the hand, N.
    pub fn advance(
        &mut self,
        dt_s: f64,
        hand: &Hand,
        gains: Gains,
        reaction: impl Fn(&Pose) -> Reaction,
    ) -> Vector3<f64> {
        let from = self.tool(hand);
        let Gains { stiffness_n_per_m, damping_n_s_per_m } = gains;
        let force_on_hand = |tool_m: &Vector3<f64>| {
            let tool_m_per_s = (tool_m - from.position_m) / dt_s;
            stiffness_n_per_m * (tool_m - hand.pose.position_m)
                + damping_n_s_per_m * (tool_m_per_s - hand.velocity_m_per_s)
        };
        let mut tool = from;
        for _ in 0..ITERATIONS {
            let contact = reaction(&tool);
            let drag_n = contact.damping_n_s_per_m * ((tool.position_m - from.position_m) / dt_s);
            let unbalanced_n = contact.force_n - drag_n - force_on_hand(&tool.position_m);
            let own = Matrix3::from_diagonal_element(stiffness_n_per_m + damping_n_s_per_m / dt_s);
            let tangent = own + contact.stiffness_n_per_m + contact.damping_n_s_per_m / dt_s;
            // A model that is not positive pushes the tool on as it leaves; its force counts, its slope does not.
            let solver = Cholesky::new(tangent).or_else(|| Cholesky::new(own));
            tool.position_m += solver.map_or_else(Vector3::zeros, |solver| solver.solve(&unbalanced_n));
        }
        self.tool_m = Some(tool.position_m);
        self.velocity_m_per_s = (tool.position_m - from.position_m) / dt_s;
        force_on_hand(&tool.position_m)
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::LocalModel;
    use super::super::model::tests::{at, floor};
    use super::*;

    const GAINS: Gains = Gains { stiffness_n_per_m: 500.0, damping_n_s_per_m: 2.0 };

    fn settle(coupling: &mut Coupling, hand: &Hand, model: &LocalModel) -> Vector3<f64> {
        (0..500).fold(Vector3::zeros(), |_, _| coupling.advance(1e-3, hand, GAINS, |pose| model.reaction(pose)))
    }

    #[test]
    fn at_rest_the_two_springs_are_in_series() {
        let hand = Hand { pose: at(0.0, -4e-3, 0.0), velocity_m_per_s: Vector3::zeros() };
        let mut coupling = Coupling::default();
        let force_n = settle(&mut coupling, &hand, &floor());
        // 1 N + 500 N/m * 4 mm, halved by a coupling as stiff as the contact.
        assert!((force_n.y - 1.5).abs() < 1e-9, "{force_n}");
        assert!((coupling.tool(&hand).position_m.y + 1e-3).abs() < 1e-9);
    }

    #[test]
    fn free_motion_is_free_and_the_tool_is_in_the_hand() {
        let mut coupling = Coupling::default();
        for i in 0..200 {
            let hand = Hand { pose: at(2e-4 * f64::from(i), 0.0, 0.0), velocity_m_per_s: Vector3::new(0.2, 0.0, 0.0) };
            let force_n = coupling.advance(1e-3, &hand, GAINS, |_| Reaction::default());
            assert!(force_n.norm() < 1e-9, "{force_n}");
            let behind_m = (coupling.tool(&hand).position_m - hand.pose.position_m).norm();
            assert!(behind_m < 2e-4 * (-f64::from(i) / 10.0).exp() + 1e-12, "{behind_m} m after {i} steps");
        }
    }

    #[test]
    fn a_model_of_negative_stiffness_does_not_throw_the_tool() {
        let model = LocalModel { stiffness_n_per_m: Matrix3::from_diagonal_element(-1e6), ..floor() };
        let hand = Hand { pose: at(0.0, -1e-3, 0.0), velocity_m_per_s: Vector3::zeros() };
        let mut coupling = Coupling::default();
        settle(&mut coupling, &hand, &model);
        assert!((coupling.tool(&hand).position_m).norm() < 20.0);
    }
}
