//! The last guards before the device: how much, how fast, since when, how long since.

use nalgebra::Vector3;

/// Share of a model's greatest age at which its force begins to fade.
const FADE_FROM: f64 = 0.5;

/// Longest step that the slew limit counts, s: a servo that was away for longer does not make up for it at once.
const MAX_SLEW_STEP_S: f64 = 2e-3;

/// Share of the force that is rendered from a model of an age: all of it at first, nothing from `max_age_s` on.
#[must_use]
pub fn fresh_share(age_s: f64, max_age_s: f64) -> f64 {
    let left = (max_age_s - age_s) / (max_age_s * (1.0 - FADE_FROM));
    if left.is_finite() { left.clamp(0.0, 1.0) } else { 0.0 }
}

/// The force with at most this norm and the same direction.
#[must_use]
pub fn clamped(force_n: Vector3<f64>, most_n: f64) -> Vector3<f64> {
    force_n * (most_n / force_n.norm().max(most_n).max(f64::MIN_POSITIVE))
}

/// Lets force in over a time, and out over another.
#[derive(Clone, Copy, Debug)]
pub struct Ramp {
    rise_s: f64,
    fall_s: f64,
    level: f64,
}

impl Ramp {
    /// Begins with nothing.
    #[must_use]
    pub fn new(rise_s: f64, fall_s: f64) -> Self {
        Self { rise_s, fall_s, level: 0.0 }
    }

    /// Moves on towards a share of the force; returns the share that is let in.
    pub fn toward(&mut self, dt_s: f64, share: f64) -> f64 {
        let [least, most] = [self.level - dt_s / self.fall_s, self.level + dt_s / self.rise_s];
        self.level = share.clamp(least, most);
        self.level
    }
}

/// Follows a force no faster than a rate.
#[derive(Clone, Copy, Debug)]
pub struct Slew {
    most_n_per_s: f64,
    force_n: Vector3<f64>,
}

impl Slew {
    /// Begins at no force.
    #[must_use]
    pub fn new(most_n_per_s: f64) -> Self {
        Self { most_n_per_s, force_n: Vector3::zeros() }
    }

    /// The force that is nearest to the wanted one after a step.
    pub fn toward(&mut self, dt_s: f64, wanted_n: Vector3<f64>) -> Vector3<f64> {
        self.force_n += clamped(wanted_n - self.force_n, self.most_n_per_s * dt_s.min(MAX_SLEW_STEP_S));
        self.force_n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_fades_with_age() {
        let shares = [0.0, 0.05, 0.075, 0.1, 9.0, f64::NAN].map(|age_s| fresh_share(age_s, 0.1));
        for (share, expected) in shares.into_iter().zip([1.0, 1.0, 0.5, 0.0, 0.0, 0.0]) {
            assert!((share - expected).abs() < 1e-12, "{shares:?}");
        }
        assert_eq!(fresh_share(0.0, 0.0), 0.0, "a server that allows no age");
    }

    #[test]
    fn a_clamped_force_keeps_its_direction() {
        let clamped_n = clamped(Vector3::new(30.0, -40.0, 0.0), 5.0);
        assert!((clamped_n - Vector3::new(3.0, -4.0, 0.0)).norm() < 1e-12);
        assert_eq!(clamped(Vector3::x(), 5.0), Vector3::x());
        assert_eq!(clamped(Vector3::zeros(), 0.0), Vector3::zeros());
    }

    #[test]
    fn a_ramp_rises_and_falls_in_its_times() {
        let mut ramp = Ramp::new(0.5, 0.05);
        let level = (0..250).map(|_| ramp.toward(1e-3, 1.0)).last().unwrap();
        assert!((level - 0.5).abs() < 1e-9);
        assert!((0..25).map(|_| ramp.toward(1e-3, 0.0)).last().unwrap() < 1e-9);
    }

    #[test]
    fn a_jump_is_followed_at_the_rate() {
        let mut slew = Slew::new(100.0);
        let first = slew.toward(1e-3, Vector3::new(3.0, 4.0, 0.0));
        assert!((first - Vector3::new(0.06, 0.08, 0.0)).norm() < 1e-12);
        assert!((0..60).map(|_| slew.toward(1e-3, Vector3::x())).last().unwrap() == Vector3::x());
    }
}
