//! A scene in which all is in play that a state has: cuts that a blade, scissors and a pull drive on, a grasp, a probe,
//! tissue on tissue, and materials that stiffen and relax.

use super::world_of;
use super::{Lcg, object, scene, viscosity};
use kerf_physics::scene::{
    BladeDesc, CapsuleDesc, Face, GrasperDesc, LoadDesc, RegionDesc, Scene, ScissorsDesc, ShapeDesc, ToolDesc,
};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};

const SIDE_M: f64 = 0.03;
const HEIGHT_M: f64 = 0.025;
const H_M: f64 = 0.0025;
/// Kinds of the scene: of materials that are linear; that stiffen; that stiffen in finer elements on one side.
pub const KINDS: usize = 3;

/// A world and the hands in it, which do the same whenever they are asked for the same step.
pub struct Busy {
    pub world: World,
    pub kind: usize,
}

/// A block that is pulled to both sides, with a lid of other tissue on it.
pub fn busy_scene(kind: usize) -> Scene {
    let half = 0.5 * SIDE_M;
    let mut block = object([-half, 0.0, -half], [half, HEIGHT_M, half], H_M, 1 + (kind % 2) as u8);
    block.material.young_modulus_pa = 5e4;
    block.material.fracture_energy_j_per_m2 = Some(20.0);
    block.material.rayleigh_beta_s = 1e-3;
    block.material.friction_coefficient = 0.2;
    block.material.strain_stiffening = if kind == 0 { 0.0 } else { 5.0 };
    block.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.01 * H_M, 1.0] }];
    let everywhere = ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0; 3] };
    let pull = |face, pa: f64| LoadDesc::Traction { region: everywhere.clone(), face, traction_pa: [pa, 0.0, 0.0] };
    block.loads = vec![pull(Face::MinX, -2e3), pull(Face::MaxX, 2e3)];
    let mut relaxing = block.material.clone();
    relaxing.viscosity = viscosity(0.05, 0.5);
    let shape = ShapeDesc::Box { min_m: [0.0, -1.0, -1.0], max_m: [1.0; 3] };
    block.regions = vec![RegionDesc { name: "relaxing".into(), shape, material: relaxing }];
    if kind == 2 {
        block.level = 2;
        block.finer = vec![kerf_physics::scene::FinerDesc {
            shape: ShapeDesc::Box { min_m: [-1.0, -1.0, 0.0], max_m: [1.0; 3] },
            level: 1,
        }];
    }
    let mut lid = object([-half, HEIGHT_M + 1e-4, -half], [-0.2 * half, HEIGHT_M + 0.01, half], H_M, 1);
    lid.name = "lid".into();
    lid.material.young_modulus_pa = 3e4;
    lid.material.rayleigh_beta_s = 2e-3;
    lid.material.friction_coefficient = 0.3;
    let mut scene = scene(vec![block, lid]);
    scene.desc.rate_hz = 500.0;
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    scene.desc.solver.relative_tolerance = Some(1e-3);
    scene.desc.tools = vec![
        ToolDesc::blade(
            "blade",
            BladeDesc { flank_friction: Some(0.1), thickness_m: 5e-4, ..BladeDesc::straight(0.02, 0.03) },
        ),
        ToolDesc::grasper("grasper", GrasperDesc { max_force_n: Some(50.0), ..GrasperDesc::new(0.005) }),
        ToolDesc::probe("probe", CapsuleDesc { radius_m: 0.006, length_m: 0.0 }),
        ToolDesc::scissors("scissors", ScissorsDesc::new(0.012, 0.01)),
    ];
    scene
}

impl Busy {
    pub fn new(kind: usize) -> Self {
        Self { world: world_of(&busy_scene(kind)), kind }
    }

    /// What the hands do in a step.
    fn inputs(&self, step: u64) -> Vec<ToolInput> {
        let t = step as f64 / 500.0;
        let mut random = Lcg(step + 7);
        let wave = |hz: f64| (std::f64::consts::TAU * hz * t).sin();
        let at = |x: f64, y: f64, z: f64, turn: Quat| Pose { position_m: Vec3::new(x, y, z), orientation: turn };
        let blade = at(
            0.004 * wave(0.7),
            HEIGHT_M - 0.008 + 0.01 * wave(1.3).abs(),
            0.004 * wave(0.4),
            Quat::from_euler_angles(0.1 * wave(0.3), 1.3, 0.0),
        );
        let grasper =
            at(0.5 * SIDE_M + 0.002 * wave(0.5), HEIGHT_M - 0.002, -0.01 + 1e-4 * random.unit(), Quat::identity());
        let probe = at(0.01, HEIGHT_M + 0.008 - 0.004 * wave(0.9).abs(), 0.01, Quat::identity());
        let scissors = at(
            0.5 * SIDE_M + 0.006 - 0.012 * wave(0.6).abs(),
            0.012,
            0.0,
            Quat::from_euler_angles(0.0, std::f64::consts::PI, 0.0),
        );
        let open = |opening: f64, pose: Pose| ToolMotion::MoveTo { pose, opening };
        let probed = if step % 300 == 299 { ToolMotion::Lift } else { ToolMotion::move_to(probe) };
        let motions = [
            ToolMotion::move_to(blade),
            open(if step % 400 < 20 { 1.0 } else { 0.0 }, grasper),
            probed,
            open(0.5 + 0.5 * wave(1.1), scissors),
        ];
        motions.into_iter().enumerate().map(|(tool, motion)| ToolInput { tool, motion }).collect()
    }

    /// Takes so many steps; returns how many links they part.
    pub fn run(&mut self, steps: u32) -> u32 {
        self.run_with(&Workers::serial(), steps)
    }

    pub fn run_with(&mut self, workers: &Workers<'_>, steps: u32) -> u32 {
        let mut parted = 0;
        for _ in 0..steps {
            let inputs = self.inputs(self.world.output().step);
            let output = self.world.step(workers, &NoClock, &StepInputs::of(&inputs));
            parted += output.fracture.parted_links;
        }
        parted
    }
}
