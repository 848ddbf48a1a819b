//! What a body is made of.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Color;

/// A material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialDesc {
    /// Young's modulus at small strain, Pa, 1e2 to 1e10.
    pub young_modulus_pa: f64,
    /// Poisson's ratio, 0 to 0.4999; above 0.499 the bulk modulus is that at 0.499.
    pub poisson_ratio: f64,
    /// Density, kg/m^3, 1 to 2e4. Default 1000: water.
    #[serde(default = "default_density")]
    pub density_kg_per_m3: f64,
    /// Rayleigh damping in proportion to mass, 1/s. Default 0.
    #[serde(default)]
    pub rayleigh_alpha_per_s: f64,
    /// Rayleigh damping in proportion to stiffness, s. Default 0.
    #[serde(default)]
    pub rayleigh_beta_s: f64,
    /// Fracture energy Gc, J/m^2; absent: the material cannot be cut.
    #[serde(default)]
    pub fracture_energy_j_per_m2: Option<f64>,
    /// Energy release rate at which a front starts, over Gc; 1 to 10. Default 2.
    #[serde(default = "default_initiation_ratio")]
    pub initiation_ratio: f64,
    /// How the fracture energy rises with the speed of the cut. Default: it does not.
    #[serde(default)]
    pub rate: Option<RateDesc>,
    /// Coefficient c of the strain-stiffening law (uniaxially sigma = E eps exp(c eps^2)), 0 to 20.
    /// Default 0: linear co-rotational.
    #[serde(default)]
    pub strain_stiffening: f64,
    /// The stress that relaxes in time. Default: none, which costs nothing.
    #[serde(default)]
    pub viscosity: Option<ViscosityDesc>,
    /// Strain that the tissue is under in life: where it is cut, it retracts. Default: none, which costs nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prestrain: Option<PrestrainDesc>,
    /// Coefficient of Coulomb friction of the material's surfaces on each other, 0 to 10; between two
    /// materials the geometric mean of theirs; of a smooth probe on them it is the material's own. Default 0: wet
    /// tissue slides.
    #[serde(default)]
    pub friction_coefficient: f64,
    /// Its colour, as "#b5473c"; a cut face is drawn paler. For the eye alone. Default: a viewer chooses by name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>", regex(pattern = "^#[0-9a-fA-F]{6}$"))]
    pub color: Option<Color>,
}

impl MaterialDesc {
    /// Young's modulus against a jolt, before anything has relaxed, Pa.
    #[must_use]
    pub fn instantaneous_modulus_pa(&self) -> f64 {
        self.young_modulus_pa * (1.0 + self.viscosity.map_or(0.0, |v| v.relaxing_modulus_ratio))
    }
}

/// Fracture energy that rises with the speed v at which the front goes through the material:
/// `Gc(v) = Gc max(1, v / v0)^p`. A front starts at `initiation_ratio` times Gc at rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RateDesc {
    /// Speed v0 up to which Gc is that at rest, m/s, 1e-6 to 10.
    pub reference_speed_m_per_s: f64,
    /// Exponent p, 0 to 1.
    pub exponent: f64,
}

/// The relaxing part of a standard linear solid: under a strain held from t = 0 the stress is
/// `E eps (1 + s exp(-t / tau))`. Shear and volume relax alike.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ViscosityDesc {
    /// Relaxation time tau, s, 1e-4 to 1e4.
    pub relaxation_time_s: f64,
    /// Modulus s that relaxes, over `young_modulus_pa`, which remains; 1e-6 to 100.
    pub relaxing_modulus_ratio: f64,
}

/// Strain of tissue in life over the shape that it shrinks to where nothing holds it. The scene begins at rest under it
/// and the loads.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PrestrainDesc {
    /// Lengthening over the length when free, -0.2 to 0.5; below 0 the tissue swells where it is cut.
    pub strain: f64,
    /// Direction of the strain, of any length. Default: all directions alike.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub along: Option<[f64; 3]>,
}

fn default_density() -> f64 {
    1000.0
}

fn default_initiation_ratio() -> f64 {
    2.0
}
