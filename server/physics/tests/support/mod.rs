//! Scenes and helpers of the physics tests.
#![allow(dead_code, reason = "the tests of two crates share it")]

pub mod busy;
pub mod cutting;
pub mod press;
pub mod swept;

use kerf_physics::scene::{
    ElementKind, MaterialDesc, ObjectDesc, Scene, SceneDesc, ShapeDesc, SolverDesc, ViscosityDesc,
};
use kerf_physics::verification::{self, State, StepParams, unjudged};
use kerf_physics::{Body, MaterialPoint, StateHasher, StepInputs, Vec3, VoxelId, Workers, World};

/// Knuth's linear congruential generator: test inputs that a seed reproduces.
pub struct Lcg(pub u64);

impl Lcg {
    /// Next value in 0..1.
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

pub fn params(dt_s: f64) -> StepParams {
    StepParams { dt_s, relative_tolerance: 1e-6, max_iterations: 500 }
}

pub fn material() -> MaterialDesc {
    MaterialDesc {
        young_modulus_pa: 1e6,
        poisson_ratio: 0.45,
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

pub fn viscosity(relaxation_time_s: f64, relaxing_modulus_ratio: f64) -> Option<ViscosityDesc> {
    Some(ViscosityDesc { relaxation_time_s, relaxing_modulus_ratio })
}

pub fn object(min_m: [f64; 3], max_m: [f64; 3], h: f64, level: u8) -> ObjectDesc {
    ObjectDesc {
        name: "block".into(),
        shape: ShapeDesc::Box { min_m, max_m },
        voxel_size_m: Some(h),
        resolution: None,
        level,
        element: ElementKind::default(),
        fracture_rule: Default::default(),
        material: material(),
        regions: Vec::new(),
        finer: Vec::new(),
        min_elements_across: None,
        fixed: Vec::new(),
        loads: Vec::new(),
    }
}

pub fn scene(objects: Vec<ObjectDesc>) -> Scene {
    Scene {
        desc: SceneDesc {
            solver: SolverDesc { relative_tolerance: Some(1e-6), max_iterations: 500 },
            ..SceneDesc::of("test", objects)
        },
        meshes: Default::default(),
    }
}

/// The world of a scene whose values are sound.
pub fn world_of(scene: &Scene) -> World {
    let sound = scene.clone().judge().unwrap_or_else(|problems| panic!("{problems}"));
    World::new(&sound).expect("a valid scene")
}

/// The world of a scene that has values beyond their limits.
pub fn world_beyond_limits(scene: &Scene) -> World {
    World::new(&unjudged(scene.clone())).expect("a valid scene")
}

/// Hash of where all nodes are and how fast, by their bits: what worlds of different scenes can agree in.
pub fn motion_hash(world: &World) -> u64 {
    let mut hasher = StateHasher::default();
    for body in world.bodies() {
        let State { position_m, velocity_m_per_s, .. } = verification::state(body);
        position_m.iter().chain(velocity_m_per_s).for_each(|v| hasher.floats(v));
    }
    hasher.finish()
}

pub fn body(object: &ObjectDesc, params: StepParams) -> Body {
    verification::body(&scene(vec![object.clone()]), params).expect("a valid object")
}

/// Mean displacement of the voxels from `from_m` on along an axis, m.
pub fn mean_displacement(body: &Body, axis: usize, from_m: f64) -> Vec3 {
    let grid = body.grid();
    let centres = (0..).zip(grid.voxels()).map(|(id, voxel)| (VoxelId(id), grid.centre_m(voxel.ijk)));
    let moved: Vec<Vec3> = centres
        .filter(|(_, at)| at[axis] > from_m)
        .map(|(voxel, position_m)| body.current_m(&MaterialPoint { position_m, voxel }) - position_m)
        .collect();
    moved.iter().sum::<Vec3>() / moved.len() as f64
}

/// Tip deflection of the cantilever under a hundredth of its weight and what beam theory says, m.
pub fn beam(level: u8, h: f64, poisson_ratio: f64) -> (f64, f64) {
    let (length, side, young, density) = (0.2, 0.02, 2e6, 1100.0);
    let clamp = h * f64::from(1 << level);
    let mut desc = object([0.0; 3], [side, side, length + clamp], h, level);
    desc.material.young_modulus_pa = young;
    desc.material.poisson_ratio = poisson_ratio;
    desc.material.density_kg_per_m3 = density;
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.0, clamp] }];
    let mut scene = scene(vec![desc]);
    let g = 0.0981;
    scene.desc.gravity_m_per_s2 = [0.0, -g, 0.0];
    let mut world = world_of(&scene);
    world.relax(&Workers::serial(), &mut |_| ());
    let body = &world.bodies()[0];
    let tip: Vec<f64> = (0..body.node_count())
        .filter(|n| (body.rest_position_m(*n).z - (length + clamp)).abs() < 1e-9)
        .map(|n| verification::state(body).position_m[n][1] - body.rest_position_m(n).y)
        .collect();
    let deflection = -tip.iter().sum::<f64>() / tip.len() as f64;
    let q = density * g * side * side;
    let inertia = side.powi(4) / 12.0;
    let shear_modulus = young / (2.0 * (1.0 + poisson_ratio));
    let bending = q * length.powi(4) / (8.0 * young * inertia);
    let shear = q * length * length / (2.0 * (5.0 / 6.0) * shear_modulus * side * side);
    (deflection, bending + shear)
}

/// Steps a world without input.
pub fn run(world: &mut World, steps: usize) {
    for _ in 0..steps {
        world.step(&Workers::serial(), &kerf_physics::NoClock, &StepInputs::default());
    }
}

pub fn up(y: f64) -> Vec3 {
    Vec3::new(0.0, y, 0.0)
}

/// The elastic force on every node is the negative slope of the energy, by central differences, to 1e-6 of
/// the largest force.
pub fn assert_forces_are_the_energys_slope(body: &mut Body) {
    let forces = verification::elastic_forces_n(body);
    let scale = forces.iter().flatten().fold(0.0f64, |m, f| m.max(f.abs()));
    let step = 1e-7;
    for node in 0..body.node_count() {
        for axis in 0..3 {
            let mut energy = [0.0; 2];
            for (e, sign) in energy.iter_mut().zip([1.0, -1.0]) {
                verification::state_mut(body).position_m[node][axis] += sign * step;
                verification::evaluate(body, 30);
                *e = verification::energy(body).elastic_j;
                verification::state_mut(body).position_m[node][axis] -= sign * step;
            }
            let slope = (energy[0] - energy[1]) / (2.0 * step);
            let error = (slope + forces[node][axis]).abs() / scale;
            assert!(error < 1e-6, "node {node} axis {axis}: {slope} against {}", -forces[node][axis]);
        }
    }
}
