//! One model diced, and what came of it.

use std::panic::{AssertUnwindSafe, catch_unwind};

use anyhow::Result;
use kerf_physics::scene::{BladeDesc, ToolDesc};
use kerf_physics::step_io::{EnergyStep, StepOutput};
use kerf_physics::{NoClock, SoundScene, StepInputs, ToolInput, Vec3, Workers, World};
use kerf_scenes::catalog;
use serde::{Deserialize, Serialize};

use super::plunge::Plunge;
use crate::extremes::scenes::SplitMix64;

/// Rates of which each dicing draws one, Hz.
const RATES_HZ: [f64; 5] = [60.0, 125.0, 250.0, 500.0, 1000.0];
/// As strokes are solved to.
const TOLERANCE: f64 = 1e-3;
/// The blade's extents over the model's.
const REACH: f64 = 1.2;
/// Energy the ledger may leave unexplained, over what tools and loads worked: as for strokes.
const MOST_RESIDUAL: f64 = 1e-2;
/// What is stored may exceed what was worked by this fraction of it: contacts that come on deep bring some.
const MOST_GAIN: f64 = 0.1;

/// What came of a dicing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tally {
    /// Draws all that is random of it.
    pub seed: u64,
    /// Steps a second.
    pub rate_hz: f64,
    /// Steps taken.
    pub steps: u64,
    /// Links parted.
    pub parted_links: u64,
    /// Pieces at the end.
    pub parts: usize,
    /// Steps of which a piece was rolled back.
    pub faults: u32,
    /// Solves that were taken up again.
    pub retries: u32,
    /// Steps whose last solve did not get to its tolerance.
    pub unconverged_steps: u32,
    /// Steps that left contacts unsettled.
    pub unsettled_steps: u32,
    /// Most iterations of a step.
    pub most_iterations: u32,
    /// Parts that fell out of the scene's reach and were put away.
    pub put_away: u32,
    /// Sum of what the ledger left unexplained, in magnitude, over that of what tools and loads worked.
    pub residual_ratio: f64,
    /// Most of what was stored beyond what had been worked, over that.
    pub gain_ratio: f64,
    /// What went wrong in words.
    pub findings: Vec<String>,
}

/// Energies summed over the steps, J.
#[derive(Default)]
struct Sums {
    worked_j: f64,
    worked_magnitude_j: f64,
    residual_j: f64,
    /// Most of what was stored beyond what had been worked.
    gained_j: f64,
}

impl Sums {
    fn add(&mut self, energy: &EnergyStep) {
        self.worked_j += energy.tool_work_j + energy.load_work_j;
        self.worked_magnitude_j += energy.tool_work_j.abs() + energy.load_work_j.abs();
        self.residual_j += energy.residual_j.abs();
        let stored_j = energy.elastic_j + energy.kinetic_j + energy.contact_j;
        self.gained_j = self.gained_j.max(stored_j - self.worked_j);
    }

    /// Over all that was worked.
    fn ratio(&self, energy_j: f64) -> f64 {
        energy_j / self.worked_magnitude_j.max(f64::MIN_POSITIVE)
    }
}

impl Tally {
    fn add(&mut self, output: &StepOutput, sums: &mut Sums) {
        self.steps += 1;
        self.parted_links += u64::from(output.fracture.parted_links);
        self.retries += output.solve.retries;
        self.unconverged_steps += u32::from(output.solve.is_unconverged);
        self.unsettled_steps += u32::from(output.solve.unsettled_n_s > 0.0);
        self.most_iterations = self.most_iterations.max(output.solve.iterations);
        self.put_away += output.put_away;
        if let Some(fault) = &output.fault {
            self.faults += 1;
            self.findings.push(format!("{} in `{}` at step {}", fault.what, fault.object, fault.step));
        }
        sums.add(&output.energy);
        self.gain_ratio = sums.ratio(sums.gained_j);
        self.residual_ratio = sums.ratio(sums.residual_j);
    }

    fn judge(&mut self) {
        if self.residual_ratio.is_nan() || self.residual_ratio > MOST_RESIDUAL {
            self.findings.push(format!("{:.1e} of the work is not accounted for", self.residual_ratio));
        }
        if self.gain_ratio.is_nan() || self.gain_ratio > MOST_GAIN {
            self.findings.push(format!("{:.1e} of the work was stored beyond it", self.gain_ratio));
        }
    }
}

/// A built-in scene as it is diced: its objects with what holds and loads them, and one blade that reaches across;
/// `resolution` voxels along its longest edge, or as many as it has.
///
/// # Errors
/// There is no such scene, or it is refused so.
pub fn model(name: &str, resolution: Option<u32>) -> Result<SoundScene> {
    let mut scene = catalog::builtin(name)?.into_scene();
    // On a coarser lattice they may lie in no voxel.
    scene.desc.tracked_points.clear();
    let object = &mut scene.desc.objects[0];
    if resolution.is_some() {
        (object.voxel_size_m, object.resolution) = (None, resolution);
    }
    let scene = scene.judge()?;
    let stats = World::new(&scene)?.object_stats()[0];
    let extent_m = Vec3::from(stats.rest_max_m) - Vec3::from(stats.rest_min_m);
    let width_m = REACH * extent_m.x.max(extent_m.z);
    let blade = BladeDesc { thickness_m: 1e-3, ..BladeDesc::straight(width_m, REACH * extent_m.y) };
    Ok(scene.with(|desc| {
        desc.tools = vec![ToolDesc::blade("blade", blade)];
        desc.solver.relative_tolerance = Some(TOLERANCE);
    })?)
}

/// Dices a fresh model by `plunges`, half of them along each axis.
///
/// # Errors
/// What the scene is refused for.
pub fn dice(scene: &SoundScene, seed: u64, plunges: u32) -> Result<Tally> {
    let mut rng = SplitMix64(seed);
    let rate_hz = RATES_HZ[rng.index(RATES_HZ.len())];
    let scene = scene.clone().with(|desc| desc.rate_hz = rate_hz)?;
    let mut tally = Tally { seed, rate_hz, ..Tally::default() };
    let mut world = World::new(&scene)?;
    let stats = world.object_stats()[0];
    let bounds_m = [stats.rest_min_m.into(), stats.rest_max_m.into()];
    let margin_m = 2.0 * world.bodies()[0].grid().voxel_size_m();
    let mut sums = Sums::default();
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        for index in 0..plunges {
            let turned = 2 * index >= plunges;
            let plunge = Plunge::random(&mut rng, bounds_m, (margin_m, 1.0 / scene.desc.rate_hz), turned);
            for motion in plunge.motions() {
                let input = [ToolInput { tool: 0, motion }];
                tally.add(world.step(&Workers::serial(), &NoClock, &StepInputs::of(&input)), &mut sums);
            }
        }
    }));
    if outcome.is_err() {
        tally.findings.push(format!("panicked in step {}", tally.steps));
    }
    tally.parts = world.counts().parts;
    tally.judge();
    Ok(tally)
}
