//! One world under observation: what goes in, what is stored, what it costs to solve.

use kerf_physics::step_io::{StepOutput, ToolMotion};
use kerf_physics::{Body, NoClock, Scene, SceneProblems, StepInputs, ToolInput, Vec3, Workers, World, verification};

/// Energies below this fraction of `E V` (Young's modulus times volume), those of strains of a thousandth,
/// count as nothing.
const NO_ENERGY: f64 = 1e-6;
/// Fraction of the steps after letting go, at their end, over which rest is judged: a vibration may pass
/// through standstill, not stay there.
const REST_WINDOW: f64 = 0.1;

/// What was seen of a world.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measures {
    /// Steps taken.
    pub steps: u32,
    /// Whether every energy, wrench, position and velocity was a number.
    pub finite: bool,
    /// Steps whose state was rolled back.
    pub faults: u32,
    /// Energy put in: stored at the start, magnitudes of the work of tools and loads, and what tools
    /// that were put down in the tissue compressed, J.
    pub put_in_j: f64,
    /// Elastic, contact and kinetic energy at most, over the energy put in.
    pub stored_of_put_in: f64,
    /// Stored energy beyond the start's plus the net work, at most, over the energy put in.
    pub made_of_put_in: f64,
    /// What the ledger leaves unexplained, sum of magnitudes, over the energy put in.
    pub residual_of_put_in: f64,
    /// Iterations of a step, median and most.
    pub iterations: [u32; 2],
    /// Steps whose solve ended above its tolerance.
    pub unconverged_steps: u32,
    /// Links that parted.
    pub parted_links: u64,
    /// Present once the world has been let go.
    pub rest: Option<Rest>,
}

/// How still a world became after it was let go.
#[derive(Clone, Debug, PartialEq)]
pub struct Rest {
    /// Kinetic energy at most over the last tenth, over the energy put in.
    pub kinetic_of_put_in: f64,
    /// Time since letting go over the longest period of the body.
    pub periods: f64,
    /// Farthest node from its place at rest, in voxels; absent where it need not return there.
    pub left_voxels: Option<f64>,
}

/// Whether a body that is let go goes back to where it was built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Return {
    /// Held, whole and unloaded: every node goes back.
    ToItsPlace,
    /// Free, loaded or cut: it comes to rest somewhere.
    Anywhere,
}

/// A world under observation.
pub struct Trial {
    /// The world.
    pub world: World,
    /// Time step, s.
    pub dt_s: f64,
    tolerance: f64,
    no_energy_j: f64,
    start_j: f64,
    net_j: f64,
    stored_j: f64,
    made_j: f64,
    edited: bool,
    iterations: Vec<u32>,
    seen: Measures,
}

impl Trial {
    /// The scene's world at rest.
    ///
    /// # Errors
    /// What the scene is refused for.
    pub fn new(scene: Scene) -> Result<Self, SceneProblems> {
        let scene = scene.judge()?;
        let world = World::new(&scene)?;
        let volume = |body: &Body| body.grid().voxels().len() as f64 * body.grid().voxel_size_m().powi(3);
        let bodies = world.bodies();
        let stiff_j = bodies.iter().zip(&scene.desc.objects).map(|(b, o)| o.material.young_modulus_pa * volume(b));
        Ok(Self {
            no_energy_j: NO_ENERGY * stiff_j.sum::<f64>(),
            dt_s: 1.0 / scene.desc.rate_hz,
            tolerance: scene.desc.relative_tolerance(),
            start_j: 0.0,
            net_j: 0.0,
            stored_j: 0.0,
            made_j: 0.0,
            edited: false,
            iterations: Vec::new(),
            seen: Measures { finite: true, ..Measures::default() },
            world,
        })
    }

    /// Sets positions and velocities of the first body from its rest positions; the energy of that
    /// start counts as put in.
    pub fn start(&mut self, mut state: impl FnMut(Vec3) -> (Vec3, Vec3)) {
        let body = verification::body_mut(&mut self.world, 0);
        for node in 0..body.node_count() {
            let (position_m, velocity_m_per_s) = state(body.rest_position_m(node));
            verification::state_mut(body).position_m[node] = position_m.into();
            verification::state_mut(body).velocity_m_per_s[node] = velocity_m_per_s.into();
        }
        self.take_start();
    }

    /// Takes a state of the first body that was set from outside as the start.
    pub fn take_start(&mut self) {
        let body = verification::body_mut(&mut self.world, 0);
        verification::evaluate(body, 60);
        self.start_j = verification::energy(body).total_j();
        self.seen.put_in_j = self.start_j;
        self.edited = true;
    }

    /// A step in which each tool does what `motions` says.
    pub fn step(&mut self, motions: &[ToolMotion]) -> &StepOutput {
        let inputs: Vec<ToolInput> =
            motions.iter().enumerate().map(|(tool, &motion)| ToolInput { tool, motion }).collect();
        let contact_before_j = self.world.output().energy.contact_j;
        let output = self.world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
        let e = &output.energy;
        let wrenches = output.tools.iter().flat_map(|t| t.wrench.force_n.iter().chain(t.wrench.torque_nm.iter()));
        let stored_j = e.elastic_j + e.contact_j + e.kinetic_j;
        let entered = motions.iter().any(|m| matches!(m, ToolMotion::EnterAt { .. }));
        let compressed_j = if entered { (e.contact_j - contact_before_j).max(0.0) } else { 0.0 };
        self.net_j += e.tool_work_j + e.load_work_j + compressed_j;
        let seen = &mut self.seen;
        seen.finite &= stored_j.is_finite() && wrenches.copied().all(f64::is_finite);
        seen.steps += 1;
        seen.faults += u32::from(output.fault.is_some());
        seen.put_in_j += e.tool_work_j.abs() + e.load_work_j.abs() + compressed_j;
        self.stored_j = self.stored_j.max(stored_j);
        self.made_j = self.made_j.max(stored_j - self.start_j - self.net_j);
        if !self.edited {
            seen.residual_of_put_in += e.residual_j.abs();
        }
        seen.unconverged_steps += u32::from(output.solve.relative_residual > self.tolerance);
        seen.parted_links += u64::from(output.fracture.parted_links);
        self.iterations.push(output.solve.iterations);
        self.edited = false;
        output
    }

    /// Lifts every tool and steps until `periods` of the body have passed, at most `most_steps`.
    pub fn let_go(&mut self, period_s: f64, periods: f64, most_steps: u32, back: Return) {
        let steps = (periods * period_s / self.dt_s).ceil().clamp(100.0, f64::from(most_steps)) as u32;
        let lift = vec![ToolMotion::Lift; self.world.output().tools.len()];
        let mut kinetic_j = 0.0f64;
        for step in 0..steps {
            let still = self.step(&lift).energy.kinetic_j;
            if f64::from(step) >= f64::from(steps) * (1.0 - REST_WINDOW) {
                kinetic_j = kinetic_j.max(still);
            }
        }
        self.seen.rest = Some(Rest {
            kinetic_of_put_in: kinetic_j / self.seen.put_in_j.max(self.no_energy_j),
            periods: f64::from(steps) * self.dt_s / period_s,
            left_voxels: (back == Return::ToItsPlace).then(|| left_voxels(self.world.bodies()[0])),
        });
    }

    /// What was seen.
    #[must_use]
    pub fn finish(mut self) -> Measures {
        self.seen.finite &= self.world.bodies().iter().all(|b| b.is_finite());
        let put_in_j = self.seen.put_in_j.max(self.no_energy_j);
        self.seen.stored_of_put_in = self.stored_j / put_in_j;
        self.seen.made_of_put_in = self.made_j / put_in_j;
        self.seen.residual_of_put_in /= put_in_j;
        self.iterations.sort_unstable();
        let most = self.iterations.last().copied().unwrap_or(0);
        self.seen.iterations = [self.iterations.get(self.iterations.len() / 2).copied().unwrap_or(0), most];
        self.seen
    }
}

/// Largest distance of a node from where it was built, in voxels.
fn left_voxels(body: &Body) -> f64 {
    let moved = verification::state(body)
        .position_m
        .iter()
        .enumerate()
        .map(|(n, x)| (Vec3::from(*x) - body.rest_position_m(n)).norm());
    moved.fold(0.0, f64::max) / body.grid().voxel_size_m()
}
