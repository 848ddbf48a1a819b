//! The needle's way into the liver, out again, and the force on it.

use anyhow::{Context, Result};
use kerf_physics::scene::{ObjectDesc, ToolShapeDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, Pose, Quat, Scene, SceneDesc, SoundScene, StepInputs, ToolInput, Vec3, Workers, World};

const SCENE: &str = include_str!("../../scenes/needle-liver.toml");
/// Height of the surface, m.
const TOP_M: f64 = 0.048;
/// Height above it at which the needle starts, m.
const CLEARANCE_M: f64 = 5e-4;
const SPEED_M_PER_S: f64 = 3e-3;
/// Off the middle of the voxels that the needle goes through, m.
const ASIDE_M: f64 = 4e-4;

/// The scene, with what `change` makes of the liver.
///
/// # Errors
/// The scene is not one.
pub fn scene(change: fn(&mut ObjectDesc)) -> Result<SoundScene> {
    let mut desc = SceneDesc::from_toml("needle-liver.toml", SCENE)?;
    change(desc.objects.first_mut().context("the scene has an object")?);
    Ok(Scene { desc, meshes: Default::default() }.judge()?)
}

/// What a front needs to go on, by the scene's material, N: Gc times the width of the edge.
#[must_use]
pub fn griffith_n(scene: &Scene) -> f64 {
    let ToolShapeDesc::Blade(edge) = &scene.desc.tools[0].shape else { return f64::NAN };
    scene.desc.objects[0].material.fracture_energy_j_per_m2.unwrap_or(f64::NAN) * edge.width_m
}

/// One step of a needle's way.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Depth of the edge under the undisturbed surface, m.
    pub depth_m: f64,
    /// Force against the needle's way in, N.
    pub force_n: f64,
}

/// A needle's way in and out.
pub struct Run {
    /// On the way in, by step.
    pub inward: Vec<Sample>,
    /// On the way out.
    pub outward: Vec<Sample>,
}

/// Pushes the needle in by `depth_m` and draws it out again.
///
/// # Errors
/// The scene's values are not supported, or a step failed.
pub fn run(scene: &SoundScene, depth_m: f64) -> Result<Run> {
    let mut world = World::new(scene)?;
    world.forget_surface();
    let per_step_m = SPEED_M_PER_S / scene.desc.rate_hz;
    let steps = ((CLEARANCE_M + depth_m) / per_step_m).round() as u32;
    let mut at = |step: u32| -> Result<Sample> {
        let depth_m = f64::from(step) * per_step_m - CLEARANCE_M;
        let pose = Pose { position_m: Vec3::new(0.0, TOP_M - depth_m, ASIDE_M), orientation: Quat::identity() };
        let inputs = [ToolInput { tool: 0, motion: ToolMotion::move_to(pose) }];
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
        anyhow::ensure!(output.fault.is_none(), "{:?} at {depth_m} m", output.fault);
        Ok(Sample { depth_m, force_n: output.tools[0].wrench.force_n.y })
    };
    let inward = (0..=steps).map(&mut at).collect::<Result<_>>()?;
    let outward = (0..steps).rev().map(&mut at).collect::<Result<_>>()?;
    Ok(Run { inward, outward })
}

impl Run {
    /// The sample at which the tissue gives: that of the largest force on the way in.
    #[must_use]
    pub fn puncture(&self) -> Sample {
        let none = Sample { depth_m: 0.0, force_n: 0.0 };
        self.inward.iter().fold(none, |most, sample| if sample.force_n > most.force_n { *sample } else { most })
    }

    /// Mean force between two depths on the way in, N.
    #[must_use]
    pub fn mean_force_n(&self, from_m: f64, to_m: f64) -> f64 {
        let within = self.inward.iter().filter(|sample| (from_m..to_m).contains(&sample.depth_m));
        let (sum, count) = within.fold((0.0, 0u32), |(sum, count), sample| (sum + sample.force_n, count + 1));
        sum / f64::from(count)
    }

    /// Largest pull on the needle as it is drawn out, N.
    #[must_use]
    pub fn pull_n(&self) -> f64 {
        self.outward.iter().fold(0.0, |most, sample| most.max(-sample.force_n))
    }
}
