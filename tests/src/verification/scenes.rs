//! Scenes of the verification cases, and what is read off a body.

use anyhow::{Context, Result};
use kerf_physics::scene::{ElementKind, MaterialDesc, ObjectDesc, Scene, SceneDesc, ShapeDesc, SolverDesc};
use kerf_physics::{Body, Mat3, MaterialPoint, NoClock, StepInputs, Vec3, Workers, World, verification};

/// A shape that holds every voxel.
pub const EVERYWHERE: ShapeDesc = ShapeDesc::Box { min_m: [-1e2; 3], max_m: [1e2; 3] };

/// A discretisation: the voxels' edge and the level of the composite elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mesh {
    /// Edge of a voxel, m.
    pub voxel_m: f64,
    /// Elements are grouped from 2^level voxels a side.
    pub level: u8,
}

impl Mesh {
    /// A mesh whose elements have `k` (a power of two) voxels a side.
    #[must_use]
    pub const fn new(k: u32, voxel_m: f64) -> Self {
        Self { voxel_m, level: k.trailing_zeros() as u8 }
    }

    /// Voxels along an edge of an element.
    #[must_use]
    pub fn k(&self) -> u32 {
        1 << self.level
    }

    /// How tables call it.
    #[must_use]
    pub fn name(&self) -> String {
        format!("k {}, h {} mm", self.k(), self.voxel_m * 1e3)
    }

    /// Edge of a composite element, m.
    #[must_use]
    pub fn element_m(&self) -> f64 {
        self.voxel_m * f64::from(self.k())
    }
}

/// Linear elasticity without damping or fracture; density of water.
#[must_use]
pub fn material(young_modulus_pa: f64, poisson_ratio: f64) -> MaterialDesc {
    MaterialDesc {
        young_modulus_pa,
        poisson_ratio,
        density_kg_per_m3: 1000.0,
        rayleigh_alpha_per_s: 0.0,
        rayleigh_beta_s: 0.0,
        fracture_energy_j_per_m2: None,
        initiation_ratio: 2.0,
        rate: None,
        strain_stiffening: 0.0,
        viscosity: None,
        prestrain: None,
        friction_coefficient: 0.0,
        color: None,
    }
}

/// A box from the origin.
#[must_use]
pub fn block(size_m: [f64; 3], mesh: Mesh, material: MaterialDesc) -> ObjectDesc {
    ObjectDesc {
        name: "block".into(),
        shape: ShapeDesc::Box { min_m: [0.0; 3], max_m: size_m },
        voxel_size_m: Some(mesh.voxel_m),
        resolution: None,
        level: mesh.level,
        element: ElementKind::default(),
        fracture_rule: Default::default(),
        material,
        regions: Vec::new(),
        finer: Vec::new(),
        min_elements_across: None,
        fixed: Vec::new(),
        loads: Vec::new(),
    }
}

/// A scene of one object at 1 kHz without gravity, solved to 1e-6.
#[must_use]
pub fn scene(object: ObjectDesc) -> Scene {
    Scene {
        desc: SceneDesc {
            solver: SolverDesc { relative_tolerance: Some(1e-6), max_iterations: 500 },
            ..SceneDesc::of("verification", vec![object])
        },
        meshes: Default::default(),
    }
}

/// Steps a world without input.
pub fn run(world: &mut World, steps: u32) {
    for _ in 0..steps {
        world.step(&Workers::serial(), &NoClock, &StepInputs::default());
    }
}

/// Displacement of a material point that lies in a voxel or on its face, m.
///
/// # Errors
/// The point lies outside the body.
pub fn displacement_m(body: &Body, position_m: Vec3) -> Result<Vec3> {
    let point = point(body, position_m)?;
    Ok(body.current_m(&point) - position_m)
}

/// The material point at a reference position in the body or on its surface.
///
/// # Errors
/// The point lies outside the body.
pub fn point(body: &Body, position_m: Vec3) -> Result<MaterialPoint> {
    // A point on a face belongs to the voxel toward the middle of the body.
    let dims = Vec3::from(body.grid().dims().map(f64::from));
    let middle_m = body.grid().origin_m() + dims * (0.5 * body.grid().voxel_size_m());
    let inward_m = (middle_m - position_m) * 1e-9;
    let voxel = body.grid().voxel_at(body.grid().cell_of(&(position_m + inward_m)));
    Ok(MaterialPoint { position_m, voxel: voxel.with_context(|| format!("{position_m:?} lies outside the body"))? })
}

/// Moves every node to `F X + t`, and evaluates with rotations that have converged.
pub fn deform(body: &mut Body, f: &Mat3, t_m: &Vec3) {
    for node in 0..body.node_count() {
        verification::state_mut(body).position_m[node] = (f * body.rest_position_m(node) + t_m).into();
    }
    verification::evaluate(body, 60);
}

/// Largest component of a node-wise vector.
#[must_use]
pub fn largest(nodal: &[[f64; 3]]) -> f64 {
    nodal.iter().flatten().fold(0.0, |m, x| m.max(x.abs()))
}

/// Knuth's linear congruential generator: inputs that a seed reproduces.
pub struct Lcg(pub u64);

impl Lcg {
    /// Next value in 0..1.
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A vector with components in -1..1.
    pub fn vector(&mut self) -> Vec3 {
        Vec3::from_fn(|_, _| 2.0 * self.unit() - 1.0)
    }
}
