//! A block, and a blade that is driven through it.

use anyhow::{Context, Result, ensure};
use kerf_physics::scene::{BladeDesc, ObjectDesc, Scene, SceneDesc, ShapeDesc, SolverDesc, ToolDesc};
use kerf_physics::step_io::{EnergyStep, ToolMotion};
use kerf_physics::{Mat3, NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World, verification};

/// Tolerance of the velocity solves: energies at rest are differed.
const RELATIVE_TOLERANCE: f64 = 1e-4;
const MAX_ITERATIONS: u32 = 500;
/// Height of a blade's flanks, m: more than any block's.
const BLADE_HEIGHT_M: f64 = 0.3;
/// At rest the kinetic energy is less than this fraction of what is stored.
const REST: f64 = 3e-5;
/// For so long, s: tissue that swings has none as it turns round.
const REST_FOR_S: f64 = 0.1;
/// Simulated time within which a held blade comes to rest, s.
const MAX_REST_S: f64 = 2.0;

/// The directions of a straight blade and where its edge's middle starts.
#[derive(Clone, Copy, Debug)]
pub struct Hold {
    /// Middle of the edge, scene frame, m.
    pub start_m: Vec3,
    /// Unit vector along the edge.
    pub along: Vec3,
    /// Unit vector of the cutting direction, across the edge.
    pub forward: Vec3,
}

/// A blade above a block.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The block.
    pub object: ObjectDesc,
    /// Length of the edge, m.
    pub blade_width_m: f64,
    /// How the blade is held.
    pub hold: Hold,
    /// Speed at which it is driven, m/s.
    pub speed_m_per_s: f64,
    /// Steps per second, Hz.
    pub rate_hz: f64,
    /// Half-width of the edge, m.
    pub edge_half_width_m: f64,
    /// Factor on the penalties among the blade's contacts.
    pub penalty_factor: f64,
}

/// One step of a drive.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Way of the edge along the cutting direction, m.
    pub travel_m: f64,
    /// Force on the tool, scene frame, N.
    pub force_n: Vec3,
    /// Area swept, m^2.
    pub area_m2: f64,
    /// What was booked.
    pub energy: EnergyStep,
}

/// What a held blade and the tissue around it come to.
#[derive(Clone, Copy, Debug)]
pub struct RestState {
    /// Energy in the elements, in what is held and in the contacts, J.
    pub stored_j: f64,
    /// Force against the cutting direction, N.
    pub force_n: f64,
    /// Area swept so far, m^2.
    pub area_m2: f64,
}

/// A blade in a block, and what it met so far.
pub struct Rig {
    world: World,
    pose: Pose,
    forward: Vec3,
    speed_m_per_s: f64,
    dt_s: f64,
    travel_m: f64,
    /// By step.
    pub samples: Vec<Sample>,
}

impl Rig {
    /// The world of a set-up, its blade not yet in it.
    ///
    /// # Errors
    /// The scene asks for what a scene may not.
    pub fn new(setup: &Setup) -> Result<Self> {
        let mut desc = SceneDesc {
            solver: SolverDesc { relative_tolerance: Some(RELATIVE_TOLERANCE), max_iterations: MAX_ITERATIONS },
            rate_hz: setup.rate_hz,
            ..SceneDesc::of("cut", vec![setup.object.clone()])
        };
        let edge_half_width_m = setup.edge_half_width_m;
        let blade = BladeDesc { edge_half_width_m, ..BladeDesc::straight(setup.blade_width_m, BLADE_HEIGHT_M) };
        desc.tools = vec![ToolDesc::blade("blade", blade)];
        let scene = Scene { desc, meshes: Default::default() }.judge().context("the scene of a cut")?;
        let mut world = World::new(&scene)?;
        verification::scale_blade_penalties(&mut world, setup.penalty_factor);
        let Hold { start_m, along, forward } = setup.hold;
        let turn = Mat3::from_columns(&[along, -forward, along.cross(&-forward)]);
        let orientation = Quat::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(turn));
        Ok(Self {
            world,
            pose: Pose { position_m: start_m, orientation },
            forward,
            speed_m_per_s: setup.speed_m_per_s,
            dt_s: 1.0 / setup.rate_hz,
            travel_m: 0.0,
            samples: Vec::new(),
        })
    }

    fn step(&mut self) -> Result<()> {
        let inputs = [ToolInput { tool: 0, motion: ToolMotion::move_to(self.pose) }];
        let output = self.world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
        ensure!(output.fault.is_none(), "step {}: {:?}", output.step, output.fault);
        self.samples.push(Sample {
            travel_m: self.travel_m,
            force_n: output.tools[0].wrench.force_n,
            area_m2: output.fracture.cut_area_m2,
            energy: output.energy,
        });
        Ok(())
    }

    /// Drives the edge on.
    ///
    /// # Errors
    /// A step had a fault.
    pub fn drive(&mut self, by_m: Vec3) -> Result<()> {
        let steps = self.steps(by_m.norm());
        (0..steps as usize).try_for_each(|_| self.go(by_m / steps))
    }

    /// Whole steps that a way takes.
    fn steps(&self, way_m: f64) -> f64 {
        (way_m / (self.speed_m_per_s * self.dt_s)).round().max(1.0)
    }

    /// Takes the edge on by a step's way.
    fn go(&mut self, by_m: Vec3) -> Result<()> {
        self.pose.position_m += by_m;
        self.travel_m += by_m.dot(&self.forward);
        self.step()
    }

    /// Drives the edge on in the cutting direction, back where negative.
    ///
    /// # Errors
    /// A step had a fault.
    pub fn advance(&mut self, by_m: f64) -> Result<()> {
        self.drive(self.forward * by_m)
    }

    /// Drives the edge on as [`Self::advance`] does, from rest to rest: what moves with an edge that stops at once goes on,
    /// and takes the front farther than its force does.
    ///
    /// # Errors
    /// A step had a fault.
    pub fn ease(&mut self, by_m: f64) -> Result<()> {
        let steps = self.steps(by_m.abs());
        let gone = |step: f64| (3.0 - 2.0 * step / steps) * (step / steps).powi(2);
        for step in 1..=steps as usize {
            self.go(self.forward * (by_m * (gone(step as f64) - gone(step as f64 - 1.0))))?;
        }
        Ok(())
    }

    /// From now on drives the edge so many times as fast.
    pub fn hasten(&mut self, factor: f64) {
        self.speed_m_per_s *= factor;
    }

    /// Holds the blade until the tissue is at rest; `None` where it does not come to rest.
    ///
    /// # Errors
    /// A step had a fault.
    pub fn rest(&mut self) -> Result<Option<RestState>> {
        let mut still_s = 0.0;
        for _ in 0..(MAX_REST_S / self.dt_s) as usize {
            self.step()?;
            let energy = self.last().energy;
            let stored_j = energy.elastic_j + energy.contact_j;
            still_s = if energy.kinetic_j < REST * stored_j { still_s + self.dt_s } else { 0.0 };
            if still_s > REST_FOR_S {
                let force_n = -self.last().force_n.dot(&self.forward);
                return Ok(Some(RestState { stored_j, force_n, area_m2: self.area_m2() }));
            }
        }
        Ok(None)
    }

    fn last(&self) -> &Sample {
        &self.samples[self.samples.len() - 1]
    }

    /// Area swept so far, m^2.
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        self.samples.iter().map(|s| s.area_m2).sum()
    }

    /// Force against the cutting direction by the way of the edge, N.
    #[must_use]
    pub fn force_curve(&self) -> Vec<(f64, f64)> {
        self.samples.iter().map(|s| (s.travel_m, -s.force_n.dot(&self.forward))).collect()
    }
}

/// Mean force on the tool over steps, N.
#[must_use]
pub fn mean_force_n(samples: &[Sample]) -> Vec3 {
    samples.iter().map(|s| s.force_n).sum::<Vec3>() / samples.len() as f64
}

/// A term of the ledger summed over steps, J.
#[must_use]
pub fn sum(samples: &[Sample], term: impl Fn(&EnergyStep) -> f64) -> f64 {
    samples.iter().map(|s| term(&s.energy)).sum()
}

/// Work of the front over the area that it swept, J/m^2.
#[must_use]
pub fn front_work_j_per_m2(samples: &[Sample]) -> f64 {
    sum(samples, |e| e.fracture_j + e.front_slip_j) / samples.iter().map(|s| s.area_m2).sum::<f64>()
}

/// Work of the tool less what it stored, over the area swept, J/m^2; the first of the samples is where it begins.
#[must_use]
pub fn spent_j_per_m2(samples: &[Sample]) -> f64 {
    let stored_j = |s: &Sample| s.energy.elastic_j + s.energy.contact_j + s.energy.kinetic_j;
    let stored_j = samples.last().map_or(0.0, stored_j) - samples.first().map_or(0.0, stored_j);
    (sum(&samples[1..], |e| e.tool_work_j) - stored_j) / samples[1..].iter().map(|s| s.area_m2).sum::<f64>()
}

/// Sum of the residuals' sizes over the tool's work.
#[must_use]
pub fn ledger_residual(samples: &[Sample]) -> f64 {
    sum(samples, |e| e.residual_j.abs()) / sum(samples, |e| e.tool_work_j)
}

/// A shape that holds what lies below a height, m.
#[must_use]
pub fn below(height_m: f64) -> ShapeDesc {
    ShapeDesc::Box { min_m: [-10.0; 3], max_m: [10.0, height_m, 10.0] }
}

/// Shapes that hold what lies beyond two places along x, m.
#[must_use]
pub fn beyond(low_m: f64, high_m: f64) -> [ShapeDesc; 2] {
    [(-10.0, low_m), (high_m, 10.0)]
        .map(|(from_m, to_m)| ShapeDesc::Box { min_m: [from_m, -10.0, -10.0], max_m: [to_m, 10.0, 10.0] })
}
