//! Elastic constants.

/// Poisson's ratio above which the bulk modulus stays what it is there, 500 times the shear modulus.
/// Implicit steps with lagged rotations make energy beyond; and at a free surface tissue is told from
/// incompressible by less than a thousandth already.
const MOST_BULK_POISSON_RATIO: f64 = 0.499;

/// Isotropic linear elasticity and density of a voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elastic {
    /// First Lame constant, Pa.
    pub lambda_pa: f64,
    /// Shear modulus, Pa.
    pub mu_pa: f64,
    /// Density, kg/m^3.
    pub density_kg_per_m3: f64,
}

impl Elastic {
    /// From Young's modulus and Poisson's ratio: mu = E / 2(1 + nu),
    /// lambda = E nu / ((1 + nu)(1 - 2 nu)). (Eq. 9 of the paper lacks the factors.) Above a Poisson's ratio of
    /// 0.499 lambda is that at 0.499.
    #[must_use]
    pub fn new(young_modulus_pa: f64, poisson_ratio: f64, density_kg_per_m3: f64) -> Self {
        let bulk_ratio = poisson_ratio.min(MOST_BULK_POISSON_RATIO);
        Self {
            lambda_pa: young_modulus_pa * bulk_ratio / ((1.0 + bulk_ratio) * (1.0 - 2.0 * bulk_ratio)),
            mu_pa: young_modulus_pa / (2.0 * (1.0 + poisson_ratio)),
            density_kg_per_m3,
        }
    }

    /// With a shear modulus of at most this much, Pa, at the same Poisson's ratio.
    #[must_use]
    pub fn at_most(self, mu_pa: f64) -> Self {
        let share = (mu_pa / self.mu_pa).min(1.0);
        Self { lambda_pa: share * self.lambda_pa, mu_pa: share * self.mu_pa, ..self }
    }

    /// Speed of waves along a free surface, m/s, within 0.2 % (Rahman, Michelitsch 2006).
    #[must_use]
    pub fn rayleigh_wave_m_per_s(&self) -> f64 {
        let nu = 0.5 * self.lambda_pa / (self.lambda_pa + self.mu_pa);
        let over_shear_waves = 0.874 + nu * (0.196 - nu * (0.043 + nu * 0.055));
        over_shear_waves * (self.mu_pa / self.density_kg_per_m3).sqrt()
    }
}
