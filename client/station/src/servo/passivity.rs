//! The passivity observer and controller: the station never gives back more than it was given.
//!
//! The observer sums up the work of the hand on what was rendered (E += -f . dx). Where that falls below zero, delay or
//! a wrong model is making energy, and the controller brakes the hand (f -= alpha v) just so much that the balance comes
//! back, no harder than the device bears (Hannaford and Ryu, 2002). A cut takes work for good; if that counted as
//! credit, a station could shake for seconds before anything was done. So the balance never stands above what the
//! contact's springs can still give back, and a small margin.

use nalgebra::Vector3;

/// Slower than this nothing is braked: the noise of an encoder, m/s.
const REST_M_PER_S: f64 = 1e-3;

/// What the controller may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassivityLimits {
    /// Greatest damping that it adds, N s/m.
    pub max_damping_n_s_per_m: f64,
    /// Credit beside what the springs hold, J.
    pub margin_j: f64,
    /// Greatest debt that it remembers, J: one that was never paid back would make the device sticky.
    pub max_debt_j: f64,
}

/// The balance.
#[derive(Clone, Copy, Debug)]
pub struct Passivity {
    limits: PassivityLimits,
    energy_j: f64,
    /// Where the hand was, and the force on it since.
    before: Option<(Vector3<f64>, Vector3<f64>)>,
    generated_j: f64,
}

impl Passivity {
    /// Begins with nothing.
    #[must_use]
    pub fn new(limits: PassivityLimits) -> Self {
        Self { limits, energy_j: 0.0, before: None, generated_j: 0.0 }
    }

    /// The hand has moved to here against the force that was rendered; the contact's springs can give back
    /// `stored_j` now.
    pub fn observe(&mut self, hand_m: &Vector3<f64>, stored_j: f64) {
        let Some((from_m, force_n)) = self.before else { return };
        let energy_j = self.energy_j - force_n.dot(&(hand_m - from_m));
        self.energy_j = energy_j.clamp(-self.limits.max_debt_j, stored_j + self.limits.margin_j);
        self.generated_j = self.generated_j.max(-energy_j);
    }

    /// The force with what brakes the hand added to it.
    #[must_use]
    pub fn control(&self, dt_s: f64, force_n: Vector3<f64>, velocity_m_per_s: &Vector3<f64>) -> Vector3<f64> {
        let speed_m_per_s = velocity_m_per_s.norm();
        if self.energy_j >= 0.0 || speed_m_per_s < REST_M_PER_S {
            return force_n;
        }
        let needed_n_s_per_m = -self.energy_j / (speed_m_per_s * speed_m_per_s * dt_s);
        force_n - velocity_m_per_s * needed_n_s_per_m.min(self.limits.max_damping_n_s_per_m)
    }

    /// This is what is rendered from here on.
    pub fn rendered(&mut self, hand_m: Vector3<f64>, force_n: Vector3<f64>) {
        self.before = Some((hand_m, force_n));
    }

    /// Greatest debt so far, J.
    #[must_use]
    pub fn generated_j(&self) -> f64 {
        self.generated_j
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: PassivityLimits = PassivityLimits { max_damping_n_s_per_m: 5.0, margin_j: 1e-3, max_debt_j: 0.05 };

    /// A force of 1 N that pushes the hand along at 0.1 m/s: it gives 0.1 mJ a step.
    fn pushed_along(steps: usize) -> (Passivity, Vector3<f64>) {
        let mut passivity = Passivity::new(LIMITS);
        let mut force = Vector3::x();
        for step in 0..steps {
            let hand_m = Vector3::x() * (1e-4 * step as f64);
            passivity.observe(&hand_m, 0.0);
            force = passivity.control(1e-3, Vector3::x(), &(Vector3::x() * 0.1));
            passivity.rendered(hand_m, force);
        }
        (passivity, force)
    }

    #[test]
    fn a_source_of_energy_is_braked_as_hard_as_the_device_bears() {
        let (passivity, force) = pushed_along(20);
        assert!((force.x - 0.5).abs() < 1e-12, "1 N less 5 N s/m at 0.1 m/s, {force}");
        assert!(passivity.energy_j < 0.0 && passivity.generated_j() > 5e-4);
    }

    #[test]
    fn a_hand_at_rest_is_not_braked_whatever_the_debt() {
        let (passivity, _) = pushed_along(20);
        for v_m_per_s in [0.0, 5e-4, -5e-4] {
            assert_eq!(passivity.control(1e-3, Vector3::x(), &(Vector3::x() * v_m_per_s)), Vector3::x());
        }
    }

    #[test]
    fn a_debt_is_forgotten_beyond_its_bound() {
        let (passivity, _) = pushed_along(2000);
        assert_eq!(passivity.energy_j, -LIMITS.max_debt_j);
    }

    #[test]
    fn what_was_put_in_is_given_back_without_braking() {
        let mut passivity = Passivity::new(LIMITS);
        // In and out of a spring of 500 N/m.
        for step in 0..=200 {
            let depth_m = 5e-3 * (std::f64::consts::PI * f64::from(step) / 200.0).sin();
            let (hand_m, force_n) = (Vector3::y() * -depth_m, Vector3::y() * (500.0 * depth_m));
            passivity.observe(&hand_m, 0.5 * 500.0 * depth_m * depth_m);
            // A held force gives back up to f dx more than the spring it samples: that is real, and below the margin.
            passivity.energy_j += 1e-5;
            assert_eq!(passivity.control(1e-3, force_n, &(Vector3::y() * 0.1)), force_n, "step {step}");
            passivity.rendered(hand_m, force_n);
        }
    }

    #[test]
    fn the_work_of_a_cut_is_no_credit_for_later() {
        let mut passivity = Passivity::new(LIMITS);
        for step in 0..100 {
            let hand_m = Vector3::y() * (-1e-3 * f64::from(step));
            passivity.observe(&hand_m, 0.0);
            passivity.rendered(hand_m, Vector3::y());
        }
        assert!((passivity.energy_j - 1e-3).abs() < 1e-12, "0.1 J were spent, {} J are kept", passivity.energy_j);
    }
}
