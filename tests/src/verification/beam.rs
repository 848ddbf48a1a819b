//! Beams by theory: what the solid ones are held against.

/// A cantilever of square section, clamped at s = 0, along +x; loads act along -y and keep their direction.
#[derive(Clone, Copy, Debug)]
pub struct Beam {
    /// Length, m.
    pub length_m: f64,
    /// Edge of the section, m.
    pub side_m: f64,
    /// Young's modulus, Pa.
    pub young_modulus_pa: f64,
    /// Poisson's ratio: with it the shear stiffness.
    pub poisson_ratio: f64,
    /// Force at the free end, N.
    pub tip_force_n: f64,
    /// Force per reference length, N/m.
    pub weight_n_per_m: f64,
}

/// Where the free end goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tip {
    /// Along the load, m.
    pub down_m: f64,
    /// Toward the clamp, m.
    pub back_m: f64,
}

/// Intervals of the Runge-Kutta integration; the tip is then right to eight digits.
const INTERVALS: u32 = 400;
/// Halvings of the interval that holds the clamp's moment: to the last bit.
const HALVINGS: u32 = 60;

/// Angle, moment and position at a section.
type Section = [f64; 4];

impl Beam {
    /// Second moment of the section's area, m^4.
    #[must_use]
    pub fn inertia_m4(&self) -> f64 {
        self.side_m.powi(4) / 12.0
    }

    /// Bending stiffness E I, N m^2.
    #[must_use]
    pub fn bending_stiffness_n_m2(&self) -> f64 {
        self.young_modulus_pa * self.inertia_m4()
    }

    /// Shear stiffness kappa G A with kappa = 5/6 (Reissner 1945), N.
    #[must_use]
    pub fn shear_stiffness_n(&self) -> f64 {
        5.0 / 6.0 * self.young_modulus_pa / (2.0 * (1.0 + self.poisson_ratio)) * self.side_m.powi(2)
    }

    /// Small deflection of the tip, m: Bernoulli's `q L^4 / 8 E I + P L^3 / 3 E I` and Timoshenko's shear.
    #[must_use]
    pub fn linear_tip_m(&self) -> f64 {
        let (p, q, l) = (self.tip_force_n, self.weight_n_per_m, self.length_m);
        let bending = (q * l.powi(4) / 8.0 + p * l.powi(3) / 3.0) / self.bending_stiffness_n_m2();
        bending + (q * l * l / 2.0 + p * l) / self.shear_stiffness_n()
    }

    /// First frequency of small vibration, Hz, for a mass per length: Bernoulli's beam,
    /// `f = 1.87510^2 / (2 pi) sqrt(E I / m L^4)`.
    #[must_use]
    pub fn first_frequency_hz(&self, mass_kg_per_m: f64) -> f64 {
        let stiffness = self.bending_stiffness_n_m2() / (mass_kg_per_m * self.length_m.powi(4));
        1.875_104_068_7_f64.powi(2) / std::f64::consts::TAU * stiffness.sqrt()
    }

    /// Large deflection of the inextensible beam that does not shear: the elastica.
    #[must_use]
    pub fn elastica_tip(&self) -> Tip {
        self.shoot(0.0)
    }

    /// Large deflection with stretch and shear (Reissner 1972, linear in his strains): the beam of a
    /// material whose Biot stress is linear in the stretch.
    #[must_use]
    pub fn large_tip(&self) -> Tip {
        self.shoot(1.0)
    }

    /// Finds the clamp's moment at which the free end carries none.
    fn shoot(&self, compliance: f64) -> Tip {
        let mut low = -(self.tip_force_n + 0.5 * self.weight_n_per_m * self.length_m) * self.length_m * 1.1;
        let mut high = 0.0;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            *(if self.integrate(middle, compliance)[1] < 0.0 { &mut low } else { &mut high }) = middle;
        }
        let [_, _, x, y] = self.integrate(0.5 * (low + high), compliance);
        Tip { down_m: -y, back_m: self.length_m - x }
    }

    /// The free end's section for a moment at the clamp, by the classical Runge-Kutta method.
    fn integrate(&self, clamp_moment_nm: f64, compliance: f64) -> Section {
        let ds = self.length_m / f64::from(INTERVALS);
        let mut section = [0.0, clamp_moment_nm, 0.0, 0.0];
        let ahead = |a: &Section, k: &Section, by: f64| -> Section { std::array::from_fn(|i| a[i] + by * k[i]) };
        for interval in 0..INTERVALS {
            let s = f64::from(interval) * ds;
            let k1 = self.slope(s, &section, compliance);
            let k2 = self.slope(s + 0.5 * ds, &ahead(&section, &k1, 0.5 * ds), compliance);
            let k3 = self.slope(s + 0.5 * ds, &ahead(&section, &k2, 0.5 * ds), compliance);
            let k4 = self.slope(s + ds, &ahead(&section, &k3, ds), compliance);
            for i in 0..4 {
                section[i] += ds / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
            }
        }
        section
    }

    /// `theta' = M / E I`, `r' = (1 + N / E A) t + Q / (kappa G A) n`, `M' = -r' x F`, with F the force
    /// of what lies beyond the section.
    fn slope(&self, s: f64, &[theta, moment, ..]: &Section, compliance: f64) -> Section {
        let force = -(self.tip_force_n + self.weight_n_per_m * (self.length_m - s));
        let (sin, cos) = theta.sin_cos();
        let stretch = 1.0 + compliance * force * sin / (self.young_modulus_pa * self.side_m.powi(2));
        let shear = compliance * force * cos / self.shear_stiffness_n();
        let (x, y) = (stretch * cos - shear * sin, stretch * sin + shear * cos);
        [moment / self.bending_stiffness_n_m2(), -x * force, x, y]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_elastica_is_the_one_of_elliptic_integrals() {
        // Mattiasson 1981, table 1: P L^2 / E I; tip down and back over L.
        for (load, down, back) in [(1.0, 0.30172, 0.05643), (3.0, 0.60325, 0.25442), (10.0, 0.81061, 0.55500)] {
            let mut beam = Beam {
                length_m: 2.0,
                side_m: 0.1,
                young_modulus_pa: 1e6,
                poisson_ratio: 0.0,
                tip_force_n: 0.0,
                weight_n_per_m: 0.0,
            };
            beam.tip_force_n = load * beam.bending_stiffness_n_m2() / beam.length_m.powi(2);
            let tip = beam.elastica_tip();
            assert!((tip.down_m / 2.0 - down).abs() < 6e-6, "{load}: {tip:?}");
            assert!((tip.back_m / 2.0 - back).abs() < 6e-6, "{load}: {tip:?}");
        }
    }

    #[test]
    fn a_small_load_bends_the_large_deflection_beam_as_the_linear_one() {
        let beam = Beam {
            length_m: 0.2,
            side_m: 0.02,
            young_modulus_pa: 2e6,
            poisson_ratio: 0.45,
            tip_force_n: 1e-6,
            weight_n_per_m: 2e-5,
        };
        assert!((beam.large_tip().down_m / beam.linear_tip_m() - 1.0).abs() < 1e-6);
    }
}
