//! Elastic constants.

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
    /// lambda = E nu / ((1 + nu)(1 - 2 nu)). (Eq. 9 of the paper lacks the factors.)
    #[must_use]
    pub fn new(young_modulus_pa: f64, poisson_ratio: f64, density_kg_per_m3: f64) -> Self {
        Self {
            lambda_pa: young_modulus_pa * poisson_ratio / ((1.0 + poisson_ratio) * (1.0 - 2.0 * poisson_ratio)),
            mu_pa: young_modulus_pa / (2.0 * (1.0 + poisson_ratio)),
            density_kg_per_m3,
        }
    }
}
