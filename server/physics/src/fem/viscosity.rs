//! A Maxwell branch beside an element's elasticity: with it the standard linear solid.
//!
//! In the rest frame of the element, where `u = R^T x - X`, the branch is the spring `s K` in series with a
//! dashpot: its spring is extended by w, `dw/dt = du/dt - w / tau`, its force is `s K w`, its energy
//! `s/2 w^T K w`, its dissipation `s/tau w^T K w`. K is the element's own stiffness, so that every strain
//! relaxes alike: from the modulus `E (1 + s)` of a sudden strain to E. Strain stiffening and Rayleigh
//! damping go with the elastic part alone.
//!
//! Within a step u is taken to move evenly: `w1 = e w0 + g (u1 - u0)` with `a = dt/tau`, `e = exp(-a)`,
//! `g = (1 - e)/a`. That is exact for strain that is held or driven evenly and of second order in dt for
//! the rest, and keeps to the dashpot's force `s tau K du/dt` where `dt >> tau`; the midpoint rule's
//! `g = exp(-a/2)` would lose it. The step applies the force at its end, `s K w1`: it dissipates for every a,
//! since `1 - (1 - g)^2 >= e^2`.

use super::lanes::set_lane;
use super::matrices::GROUND;
use serde::{Deserialize, Serialize};
use wide::f64x4;

/// Below this dt/tau the coefficients of a step are summed as series: their closed forms cancel.
const SERIES_BELOW: f64 = 0.5;
/// Terms of those series: the first one left out is below 1e-20.
const SERIES_TERMS: u32 = 20;
/// Beyond this dt/tau, `exp(-dt/tau)` is below the rounding of 1: nothing is left.
const FORGOTTEN_BEYOND: f64 = 40.0;
/// The relaxing branch of a material or an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viscosity {
    /// Modulus of the branch over Young's modulus, s.
    pub modulus_ratio: f64,
    /// Time in which its force falls to 1/e under held strain, s.
    pub relaxation_time_s: f64,
}

/// Data of the branches of four elements; zero where an element has none.
#[derive(Clone, Default)]
pub struct ViscosityBlock {
    /// s.
    pub(super) ratio: f64x4,
    /// `e` and `1 - e`.
    pub(super) decay: f64x4,
    pub(super) lost: f64x4,
    /// `g`.
    pub(super) gain: f64x4,
    /// A step dissipates the sum of these times `w1^T K w1`, `w0^T K w1` and `w0^T K w0`.
    pub(super) dissipation: [f64x4; 3],
}

/// State of the branches of four elements.
#[derive(Clone, Default, Serialize, Deserialize)]
pub struct BranchState {
    /// Extension w of the branch's spring at each corner, rest frame, m.
    pub extension_m: [f64x4; 24],
    /// Displacement u that it was last brought to, rest frame, m.
    pub displacement_m: [f64x4; 24],
    /// The same two at the ground points.
    pub ground_extension_m: [f64x4; GROUND],
    pub ground_displacement_m: [f64x4; GROUND],
    /// Force of the branch on the nodes, N, scene frame.
    pub force_n: [f64x4; 24],
    /// `w^T K w`, J.
    pub(super) square_j: f64x4,
    /// Fraction of the branch's force that has not relaxed, `u^T K w / u^T K u`, 0 to 1.
    pub unrelaxed: f64x4,
}

/// What a branch does in a step of a given length.
#[derive(Default)]
struct StepCoefficients {
    decay: f64,
    lost: f64,
    gain: f64,
    dissipation: [f64; 3],
}

impl Viscosity {
    /// The dissipation is `s/tau` times the integral of `w^T K w` over the step, with
    /// `w(t) = exp(-t/tau) w0 + tau/dt (1 - exp(-t/tau)) (u1 - u0)`, in terms of w0 and w1.
    fn over_step(&self, dt_s: f64) -> StepCoefficients {
        let a = dt_s / self.relaxation_time_s;
        // c: integral of ((1 - exp(-a x)) / a)^2 over x from 0 to 1.
        let (decay, gain, c) = if a < SERIES_BELOW {
            let (mut gain, mut c) = (0.0, 0.0);
            // (-a)^n / (n + 1)! and 2^(n + 2).
            let (mut term, mut power) = (1.0, 4.0);
            for n in 0..SERIES_TERMS {
                let n = f64::from(n);
                gain += term;
                c += term * (power - 2.0) / ((n + 2.0) * (n + 3.0));
                term *= -a / (n + 2.0);
                power *= 2.0;
            }
            (1.0 - a * gain, gain, c)
        } else {
            let decay = if a > FORGOTTEN_BEYOND { 0.0 } else { f64x4::splat(-a).exp().to_array()[0] };
            let gain = (1.0 - decay) / a;
            (decay, gain, (1.0 - 2.0 * gain + 0.5 * (1.0 - decay * decay) / a) / (a * a))
        };
        let (factor, over) = (self.modulus_ratio * a, c / (gain * gain));
        let dissipation = [
            factor * over,
            factor * (gain - 2.0 * decay * over),
            factor * (0.5 * a * gain * gain + decay * decay * over),
        ];
        StepCoefficients { decay, lost: a * gain, gain, dissipation }
    }
}

impl ViscosityBlock {
    /// What the branches hold, J.
    pub(super) fn stored_j(&self, branch: &BranchState) -> f64x4 {
        f64x4::splat(0.5) * self.ratio * branch.square_j
    }

    /// Sets the branch of a lane for steps of `dt_s`, or that it has none.
    pub fn set(&mut self, lane: usize, viscosity: Option<&Viscosity>, dt_s: f64) {
        let step = viscosity.map_or_else(StepCoefficients::default, |v| v.over_step(dt_s));
        set_lane(&mut self.ratio, lane, viscosity.map_or(0.0, |v| v.modulus_ratio));
        set_lane(&mut self.decay, lane, step.decay);
        set_lane(&mut self.lost, lane, step.lost);
        set_lane(&mut self.gain, lane, step.gain);
        for (coefficient, value) in self.dissipation.iter_mut().zip(step.dissipation) {
            set_lane(coefficient, lane, value);
        }
    }

    /// Stiffness that the branch adds within a step, over the element's: `s g`.
    #[must_use]
    pub fn tangent(&self) -> f64x4 {
        self.ratio * self.gain
    }
}

impl BranchState {
    /// Forgets all strain: what was last reached counts as relaxed.
    pub fn relax(&mut self) {
        self.extension_m = [f64x4::ZERO; 24];
        self.ground_extension_m = [f64x4::ZERO; GROUND];
    }

    /// Takes over the memory of another element.
    pub fn copy_lane(&mut self, lane: usize, from: &Self, from_lane: usize) {
        let copy = |to: &mut [f64x4], from: &[f64x4]| {
            to.iter_mut().zip(from).for_each(|(to, from)| set_lane(to, lane, from.as_array()[from_lane]));
        };
        copy(&mut self.extension_m, &from.extension_m);
        copy(&mut self.displacement_m, &from.displacement_m);
        copy(&mut self.ground_extension_m, &from.ground_extension_m);
        copy(&mut self.ground_displacement_m, &from.ground_displacement_m);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Simpson's rule on the integrand itself, whatever the closed forms and series say.
    fn integral(f: impl Fn(f64) -> f64) -> f64 {
        let n = 2000;
        let x = |i: u32| f64::from(i) / f64::from(n);
        let weight = |i: u32| if i == 0 || i == n { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
        (0..=n).map(|i| weight(i) * f(x(i))).sum::<f64>() / f64::from(3 * n)
    }

    #[test]
    fn a_step_follows_the_differential_equation_and_books_what_it_dissipates() {
        for a in [1e-8, 1e-3, 0.3, 0.4999, 0.5, 2.0, 15.0] {
            let viscosity = Viscosity { modulus_ratio: 0.7, relaxation_time_s: 0.02 };
            let step = viscosity.over_step(a * viscosity.relaxation_time_s);
            for (w0, du) in [(1.0, 0.0), (0.0, 1.0), (0.8, -0.5), (-0.3, 0.31)] {
                // Solved by hand: w = exp(-a x) w0 + (1 - exp(-a x)) / a du at the time x dt.
                let w = |x: f64| (-a * x).exp() * w0 - (-a * x).exp_m1() / a * du;
                let w1 = step.decay * w0 + step.gain * du;
                assert!((w1 - w(1.0)).abs() < 1e-13, "a {a}: w {w1} against {}", w(1.0));
                let [after, across, before] = step.dissipation;
                let booked = after * w1 * w1 + across * w0 * w1 + before * w0 * w0;
                let expected = viscosity.modulus_ratio * a * integral(|x| w(x) * w(x));
                assert!((booked / expected - 1.0).abs() < 1e-7, "a {a}, w0 {w0}, du {du}: {booked} J, not {expected}");
            }
            assert!((step.lost - (1.0 - step.decay)).abs() < 1e-15);
        }
    }

    #[test]
    fn steps_far_longer_and_far_shorter_than_the_relaxation_time_have_their_limits() {
        let at = |a: f64| Viscosity { modulus_ratio: 1.0, relaxation_time_s: 1.0 }.over_step(a);
        // A dashpot: w1 = tau du/dt, a w1^2 dissipated.
        let long = at(1e3);
        assert!(long.decay == 0.0 && (long.gain * 1e3 - 1.0).abs() < 1e-12);
        assert!((long.dissipation[0] * long.gain / (1.0 - 1.5e-3) - 1.0).abs() < 1e-5, "{:?}", long.dissipation);
        // A spring.
        let short = at(1e-8);
        assert!((short.gain - 1.0).abs() < 1e-8 && (short.decay - 1.0).abs() < 2e-8);
        assert!(short.dissipation.iter().all(|d| (d / (1e-8 / 3.0) - 1.0).abs() < 1e-6), "{:?}", short.dissipation);
    }
}
