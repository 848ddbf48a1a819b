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

    /// A light hand that wanders, and a contact that pushes it along wherever it goes, at random hard but no harder than the
    /// brake can take: the most that was given out over any stretch of time, and in a single step, J.
    fn given_by_an_adversary(seed: u64, limits: PassivityLimits) -> (f64, f64) {
        const DT_S: f64 = 1e-3;
        let mut state = seed;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            2.0 * ((state >> 11) as f64 / (1u64 << 53) as f64) - 1.0
        };
        let mut passivity = Passivity::new(limits);
        let (mut hand_m, mut v_m_per_s, mut wanted_n) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        let (mut given_j, mut most_j, mut most_in_step_j) = (0.0f64, 0.0f64, 0.0f64);
        for step in 0..5000 {
            if step % 100 == 0 {
                wanted_n = Vector3::from_fn(|_, _| random());
            }
            passivity.observe(&hand_m, 0.0);
            let push_n_s_per_m = 0.8 * LIMITS.max_damping_n_s_per_m * random().abs();
            let force_n = passivity.control(DT_S, v_m_per_s * push_n_s_per_m, &v_m_per_s);
            passivity.rendered(hand_m, force_n);
            v_m_per_s += (force_n + wanted_n - 2.0 * v_m_per_s) * (DT_S / 0.1);
            hand_m += DT_S * v_m_per_s;
            let step_j = force_n.dot(&v_m_per_s) * DT_S;
            given_j = (given_j + step_j).max(0.0);
            most_j = most_j.max(given_j);
            most_in_step_j = most_in_step_j.max(step_j);
        }
        (most_j, most_in_step_j)
    }

    #[test]
    fn no_contact_gets_more_out_of_the_station_than_the_margin_and_what_two_steps_give() {
        let mut worst: f64 = 0.0;
        for seed in 0..200 {
            let (most_j, in_step_j) = given_by_an_adversary(seed, LIMITS);
            worst = worst.max((most_j - LIMITS.margin_j) / in_step_j);
            assert!(most_j <= LIMITS.margin_j + 2.0 * in_step_j, "seed {seed}: {most_j} J, {in_step_j} J in one step");
        }
        let (unbraked_j, _) = given_by_an_adversary(0, PassivityLimits { max_damping_n_s_per_m: 0.0, ..LIMITS });
        println!("beyond the margin at most {worst:.2} of a step; without a brake {unbraked_j:.3} J");
        assert!(
            unbraked_j > 10.0 * LIMITS.margin_j,
            "the contact gives nothing out that had to be braked: {unbraked_j} J"
        );
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
