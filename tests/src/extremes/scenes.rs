//! Scenes of the matrix: blocks and blobs of a few voxels, blades, and what moves them.

use kerf_physics::scene::{BladeDesc, MaterialDesc, ObjectDesc, Scene, SceneDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{Pose, Quat, Vec3};

/// Rayleigh damping at the lowest frequency, mass and stiffness share each, over the critical one:
/// what tissue has, and enough for rest to be reached within the run.
const DAMPING_RATIO: f64 = 0.1;
/// Largest damping coefficients that a scene may have.
const MOST_ALPHA_PER_S: f64 = 1e4;
const MOST_BETA_S: f64 = 10.0;

/// A block or blob of one material.
#[derive(Clone, Debug, PartialEq)]
pub struct Specimen {
    /// Young's modulus, Pa.
    pub young_modulus_pa: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Density, kg/m^3.
    pub density_kg_per_m3: f64,
    /// Strain stiffening c.
    pub strain_stiffening: f64,
    /// Time step, s.
    pub dt_s: f64,
    /// Voxel edge, m.
    pub voxel_size_m: f64,
    /// Extent in voxels.
    pub voxels: [u32; 3],
    /// Composite elements have 2^level voxels a side.
    pub level: u8,
}

impl Default for Specimen {
    /// As soft as liver, 4 cm, at the default rate.
    fn default() -> Self {
        Self {
            young_modulus_pa: 1e4,
            poisson_ratio: 0.45,
            density_kg_per_m3: 1000.0,
            strain_stiffening: 0.0,
            dt_s: 1e-3,
            voxel_size_m: 5e-3,
            voxels: [8; 3],
            level: 1,
        }
    }
}

impl Specimen {
    /// Edge lengths, m.
    #[must_use]
    pub fn extent_m(&self) -> Vec3 {
        Vec3::from(self.voxels.map(|n| f64::from(n) * self.voxel_size_m))
    }

    /// Longest period, of bending about a foot: `2 pi sqrt(12) / 1.875^2 L^2 / (t c)` with
    /// `c = sqrt(E / rho)` (Euler and Bernoulli's cantilever of length L and thickness t).
    #[must_use]
    pub fn period_s(&self) -> f64 {
        let extent_m = self.extent_m();
        let sound_m_per_s = (self.young_modulus_pa / self.density_kg_per_m3).sqrt();
        6.19 * extent_m.max() * extent_m.max() / (extent_m.min() * sound_m_per_s)
    }

    /// The material, damped in proportion to the specimen's longest period.
    #[must_use]
    pub fn material(&self) -> MaterialDesc {
        let circular_per_s = 2.0 * std::f64::consts::PI / self.period_s();
        MaterialDesc {
            young_modulus_pa: self.young_modulus_pa,
            poisson_ratio: self.poisson_ratio,
            density_kg_per_m3: self.density_kg_per_m3,
            rayleigh_alpha_per_s: (2.0 * DAMPING_RATIO * circular_per_s).min(MOST_ALPHA_PER_S),
            rayleigh_beta_s: (2.0 * DAMPING_RATIO / circular_per_s).min(MOST_BETA_S),
            fracture_energy_j_per_m2: None,
            initiation_ratio: 2.0,
            rate: None,
            strain_stiffening: self.strain_stiffening,
            viscosity: None,
            prestrain: None,
            friction_coefficient: 0.0,
            color: None,
        }
    }

    /// A block, centred on x = z = 0, its foot at y = 0.
    #[must_use]
    pub fn block(&self) -> ObjectDesc {
        let extent = self.extent_m();
        let (half_x, half_z) = (0.5 * extent.x, 0.5 * extent.z);
        ObjectDesc {
            name: "specimen".into(),
            shape: ShapeDesc::Box { min_m: [-half_x, 0.0, -half_z], max_m: [half_x, extent.y, half_z] },
            voxel_size_m: Some(self.voxel_size_m),
            resolution: None,
            level: self.level,
            material: self.material(),
            finer: Vec::new(),
            min_elements_across: None,
            element: Default::default(),
            fracture_rule: Default::default(),
            regions: Vec::new(),
            fixed: Vec::new(),
            loads: Vec::new(),
        }
    }

    /// The same with its lowest layer of voxels held.
    #[must_use]
    pub fn held_block(&self) -> ObjectDesc {
        let mut block = self.block();
        block.fixed.push(below(1.01 * self.voxel_size_m));
        block
    }

    /// A scene of one object, at the solver's defaults, with `tools` blades that reach over it.
    #[must_use]
    pub fn scene(&self, object: ObjectDesc, tools: usize) -> Scene {
        let reach = self.extent_m().max();
        let blade = BladeDesc {
            edge_half_width_m: (0.01 * self.voxel_size_m).clamp(1e-8, 1e-2),
            thickness_m: (0.1 * self.voxel_size_m).min(0.1),
            ..BladeDesc::straight((1.5 * reach).clamp(1e-4, 10.0), (2.0 * reach).clamp(1e-4, 10.0))
        };
        let desc = SceneDesc {
            rate_hz: 1.0 / self.dt_s,
            tools: (0..tools).map(|i| ToolDesc::blade(&format!("blade {i}"), blade.clone())).collect(),
            ..SceneDesc::of("extremes", vec![object])
        };
        Scene { desc, meshes: Default::default() }
    }
}

/// Everything below a height.
#[must_use]
pub fn below(height_m: f64) -> ShapeDesc {
    ShapeDesc::Box { min_m: [-1e3; 3], max_m: [1e3, height_m, 1e3] }
}

/// Everything.
#[must_use]
pub fn everywhere() -> ShapeDesc {
    ShapeDesc::Box { min_m: [-1e3; 3], max_m: [1e3; 3] }
}

/// The edge level at a place, cutting downward.
#[must_use]
pub fn level_at(position_m: Vec3) -> Pose {
    Pose { position_m, orientation: Quat::identity() }
}

/// A move in a straight line at constant attitude, in `steps` steps from the pose after `from`.
pub fn line(from: Pose, by_m: Vec3, steps: u32) -> impl Iterator<Item = ToolMotion> {
    (1..=steps).map(move |step| {
        let position_m = from.position_m + by_m * (f64::from(step) / f64::from(steps));
        ToolMotion::move_to(Pose { position_m, ..from })
    })
}

/// Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (2014): the same numbers
/// from a seed on every machine.
pub struct SplitMix64(pub u64);

impl SplitMix64 {
    /// Next word.
    pub fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Next value in 0..1.
    pub fn unit(&mut self) -> f64 {
        (self.word() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Next value in `low..high`, its logarithm uniform.
    pub fn log(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }

    /// Next vector with components in -1..1.
    pub fn vector(&mut self) -> Vec3 {
        Vec3::from_fn(|_, _| 2.0 * self.unit() - 1.0)
    }

    /// Next index below `count`.
    pub fn index(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }
}
