//! Materials as the step uses them.

use super::ToughnessRate;
use crate::fem::block::ElementLaw;
use crate::fem::material::Elastic;
use crate::fem::viscosity::Viscosity;
use crate::scene::{MaterialDesc, PrestrainDesc};
use crate::{Mat3, Vec3};

/// Material of a voxel as the step uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Young's modulus, Pa.
    pub young_modulus_pa: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Lame constants and density.
    pub elastic: Elastic,
    /// Damping, stiffening and relaxation.
    pub law: ElementLaw,
    /// Fracture energy, J/m^2; `None`: cannot be cut.
    pub fracture_energy_j_per_m2: Option<f64>,
    /// Energy release rate at which a front starts over the fracture energy.
    pub initiation_ratio: f64,
    /// How the fracture energy rises with the speed of the front.
    pub(crate) toughness_rate: Option<ToughnessRate>,
    /// Coefficient of friction of tissue on tissue.
    pub friction_coefficient: f64,
}

impl From<&MaterialDesc> for Material {
    fn from(desc: &MaterialDesc) -> Self {
        Self {
            young_modulus_pa: desc.young_modulus_pa,
            poisson_ratio: desc.poisson_ratio,
            elastic: Elastic::new(desc.young_modulus_pa, desc.poisson_ratio, desc.density_kg_per_m3),
            law: ElementLaw {
                alpha_per_s: desc.rayleigh_alpha_per_s,
                beta_s: desc.rayleigh_beta_s,
                stiffening_rate_per_pa: 2.0 * desc.strain_stiffening / desc.young_modulus_pa,
                viscosity: desc.viscosity.map(|v| Viscosity {
                    modulus_ratio: v.relaxing_modulus_ratio,
                    relaxation_time_s: v.relaxation_time_s,
                }),
                free_stretch: desc.prestrain.as_ref().map(free_stretch),
            },
            fracture_energy_j_per_m2: desc.fracture_energy_j_per_m2,
            initiation_ratio: desc.initiation_ratio,
            toughness_rate: desc.rate.map(ToughnessRate::from),
            friction_coefficient: desc.friction_coefficient,
        }
    }
}

/// Stretch from the shape in life to the one that the tissue takes where nothing holds it.
fn free_stretch(prestrain: &PrestrainDesc) -> Mat3 {
    let stretch = 1.0 / (1.0 + prestrain.strain);
    match prestrain.along {
        None => Mat3::from_diagonal_element(stretch),
        Some(along) => {
            let along = Vec3::from(along).normalize();
            Mat3::identity() + (stretch - 1.0) * along * along.transpose()
        }
    }
}
