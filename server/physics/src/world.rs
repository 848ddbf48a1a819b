//! The state of one scene and the order of its step.

use crate::body::{Body, BodyEnergy, TopologyChange};
use crate::contact::broad::{Aabb, SpatialHash};
use crate::contact::flank::Walls;
use crate::contact::{Contact, Mode};
use crate::fault::{Fault, FaultKind};
use crate::fracture::front::{BladeMotion, Front};
use crate::grid::{Crossing, LinkId};
use crate::hash::StateHasher;
use crate::ledger::{self, BodyLedger, ContactLedger};
use crate::params::StepParams;
use crate::scene::{Scene, SceneError};
use crate::solve::spring::POINT_NODES;
use crate::stage::{Lap, Stage, StageClock};
use crate::step_io::{ContactModel, FractureStep, StepInputs, StepOutput, ToolMotion, ToolOutput, Wrench};
use crate::surface::Surface;
use crate::surface::delta::{Keyframe, TopologyPatch};
use crate::tool::Pose;
use crate::tool::blade::Blade;
use crate::view::View;
use crate::workers::Workers;
use crate::{Vec3, body};

pub use crate::body::Relaxation;

/// A step's contact springs are re-solved at most this many times; what still changes then waits for
/// the next step.
const MAX_ACTIVE_SET_SOLVES: u32 = 4;

/// A step may not end with more than this many times the energy it began with, beyond what was put
/// in; steps that behave end with less than they began with.
const ENERGY_GROWTH: f64 = 1.5;
/// Energies below this are left alone, J.
const LEAST_ENERGY_J: f64 = 1e-9;
/// A step is taken back to a quarter this many times at most.
const MAX_STEPS_BACK: u32 = 8;

/// A tool and where it is.
struct Tool {
    blade: Blade,
    pose: Option<Pose>,
    /// Pose at the beginning of the step; equal to `pose` where it has just entered.
    before: Option<Pose>,
    entered: bool,
}

/// What one tool does in one body.
struct ToolContact {
    front: Front,
    flanks: Vec<Contact>,
    hash: SpatialHash,
}

/// A body with the step data that belongs to it.
struct BodySlot {
    body: Body,
    /// By tool.
    contacts: Vec<ToolContact>,
    /// Walls of what was cut.
    walls: Walls,
    velocity_change: body::Nodal,
    impulses: Vec<(u32, [f64; 3])>,
    ledger: BodyLedger,
    parting: Vec<(LinkId, Crossing)>,
    /// Links that were parted in this step, and what that changed.
    parted: Vec<LinkId>,
    change: TopologyChange,
    /// Its state was set from outside since the last step.
    edited: bool,
}

/// A probe: a material point that is followed.
struct Probe {
    body: usize,
    point: body::MaterialPoint,
}

/// One scene: its objects, its tools and their state.
pub struct World {
    params: StepParams,
    slots: Vec<BodySlot>,
    tools: Vec<Tool>,
    probes: Vec<Probe>,
    /// Present from when the surface is first asked for until it is forgotten: nobody watches,
    /// nothing is contoured.
    view: Option<View>,
    contact_ledger: ContactLedger,
    flank_before_j: f64,
    output: StepOutput,
}

/// What an object of a scene consists of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectStats {
    /// Lower corner of its bounding box at rest, m.
    pub rest_min_m: [f64; 3],
    /// Upper corner of its bounding box at rest, m.
    pub rest_max_m: [f64; 3],
    /// Edge length of a fine voxel, m.
    pub voxel_size_m: f64,
    /// Fine voxels.
    pub voxels: u32,
    /// Composite elements as they are now.
    pub composite_elements: u32,
}

/// Numbers of things in a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorldCounts {
    /// Fine voxels.
    pub voxels: usize,
    /// Composite elements of the levels solved on.
    pub composite_elements: usize,
    /// Nodes of the levels solved on.
    pub nodes: usize,
    /// Vertices of the surface.
    pub surface_vertices: usize,
    /// Triangles of the surface.
    pub surface_triangles: usize,
    /// Separate pieces.
    pub parts: usize,
}

impl World {
    /// Builds the scene at rest.
    ///
    /// # Errors
    /// A field of the scene whose value is not supported, with the field and the limit named.
    pub fn new(scene: &Scene) -> Result<Self, SceneError> {
        let desc = &scene.desc;
        let params = StepParams {
            dt_s: 1.0 / desc.rate_hz,
            relative_tolerance: desc.solver.relative_tolerance,
            max_iterations: desc.solver.max_iterations,
        };
        let blades: Vec<Blade> = desc.tools.iter().map(|t| Blade::from(&t.blade)).collect();
        let mut slots = Vec::with_capacity(desc.objects.len());
        for index in 0..desc.objects.len() {
            slots.push(BodySlot::new(Body::new(scene, index, params, &Workers::serial())?, &blades));
        }
        let mut world = Self {
            params,
            slots,
            tools: blades.into_iter().map(|blade| Tool { blade, pose: None, before: None, entered: false }).collect(),
            probes: Vec::new(),
            view: None,
            contact_ledger: ContactLedger::default(),
            flank_before_j: 0.0,
            output: StepOutput::default(),
        };
        for (index, probe) in desc.probes.iter().enumerate() {
            world.probes.push(world.find_probe(scene, index, &probe.object, probe.position_m.into())?);
        }
        world.output.tools = vec![ToolOutput::default(); world.tools.len()];
        world.output.probe_displacement_m = vec![Vec3::zeros(); world.probes.len()];
        Ok(world)
    }

    fn find_probe(&self, scene: &Scene, index: usize, object: &str, position_m: Vec3) -> Result<Probe, SceneError> {
        let error = |message: String| SceneError::Field { field: format!("probes[{index}]"), message };
        let body = scene
            .desc
            .objects
            .iter()
            .position(|o| o.name == object)
            .ok_or_else(|| error(format!("there is no object named {object:?}")))?;
        let grid = &self.slots[body].body.grid;
        let voxel = grid
            .voxel_at(grid.cell_of(&position_m))
            .ok_or_else(|| error(format!("position_m {position_m:?} lies in no voxel of {object:?}")))?;
        Ok(Probe { body, point: body::MaterialPoint { position_m, voxel } })
    }

    /// Advances the scene by one time step.
    pub fn step(&mut self, workers: &Workers<'_>, clock: &dyn StageClock, inputs: &StepInputs<'_>) -> &StepOutput {
        let mut lap = Lap::start(clock);
        self.slots.iter_mut().filter(|s| s.edited).for_each(|s| s.take_edits(workers));
        self.apply_inputs(inputs);
        lap.end(Stage::ApplyInputs);
        if self.tools.iter().any(|t| t.pose.is_some()) {
            self.detect_contacts();
            lap.end(Stage::Contact);
        }
        self.solve_velocities(workers);
        lap.end(Stage::Velocities);
        self.integrate(workers);
        self.write_wrenches();
        lap.end(Stage::Integrate);
        self.evaluate(workers);
        lap.end(Stage::Rotations);
        if self.slots.iter().any(|s| s.contacts.iter().any(|c| !c.front.contacts.is_empty())) {
            self.advance_fronts();
            lap.end(Stage::Fracture);
        }
        if self.slots.iter().any(|s| !s.parting.is_empty()) {
            self.update_topology(workers);
            lap.end(Stage::Topology);
        }
        if self.view.is_some() && self.output.fracture.parted_links > 0 {
            self.update_view();
            lap.end(Stage::Surface);
        }
        self.finish();
        self.output.profile = lap.finish();
        &self.output
    }

    fn apply_inputs(&mut self, inputs: &StepInputs<'_>) {
        self.output.fault = None;
        self.output.fracture = FractureStep::default();
        self.contact_ledger = ContactLedger::default();
        self.view.iter_mut().for_each(View::clear_patch);
        for tool in &mut self.tools {
            tool.before = tool.pose;
            tool.entered = false;
        }
        for input in inputs.tools {
            let Some(tool) = self.tools.get_mut(input.tool) else { continue };
            match input.motion {
                ToolMotion::MoveTo(pose) if tool.pose.is_some() => tool.pose = Some(pose),
                ToolMotion::MoveTo(pose) | ToolMotion::EnterAt(pose) => {
                    tool.pose = Some(pose);
                    tool.before = Some(pose);
                    tool.entered = true;
                }
                ToolMotion::Lift => {
                    tool.pose = None;
                    self.slots.iter_mut().for_each(|s| s.contacts[input.tool].lift());
                }
            }
        }
    }

    fn detect_contacts(&mut self) {
        for slot in &mut self.slots {
            for (tool, contact) in self.tools.iter().zip(&mut slot.contacts) {
                if let (Some(pose), Some(before)) = (tool.pose, tool.before) {
                    let motion = BladeMotion { blade: &tool.blade, before, pose };
                    contact.detect(&slot.body, &slot.walls, &motion, tool.entered);
                }
            }
        }
    }

    fn solve_velocities(&mut self, workers: &Workers<'_>) {
        let mut report = crate::step_io::SolveReport::default();
        for slot in &mut self.slots {
            slot.body.assemble_right_side();
            for _ in 0..MAX_ACTIVE_SET_SOLVES {
                let solve = slot.solve(workers, self.params.dt_s);
                report.iterations += solve.iterations;
                report.solves += 1;
                report.relative_residual = report.relative_residual.max(solve.relative_residual);
                if !slot.settle_contacts(self.params.dt_s) {
                    break;
                }
            }
            let touched = slot.impulses.iter().map(|i| i.0);
            slot.body.correct_rigid_motion(touched, &mut slot.velocity_change);
            slot.body.stiffen_crumbs(&mut slot.velocity_change);
        }
        self.output.solve = report;
    }

    fn integrate(&mut self, workers: &Workers<'_>) {
        let dt = self.params.dt_s;
        for slot in &mut self.slots {
            slot.ledger.step = slot.body.step_energies(&slot.velocity_change);
            let body = &mut slot.body;
            for (v, dv) in body.velocity_m_per_s.iter_mut().zip(&slot.velocity_change) {
                (0..3).for_each(|i| v[i] += dv[i]);
            }
            for (x, v) in body.position_m.iter_mut().zip(&body.velocity_m_per_s) {
                (0..3).for_each(|i| x[i] += dt * v[i]);
            }
            slot.ledger.load_work_j = body.external_work_j(body.velocity_m_per_s.iter().map(|v| v.map(|c| dt * c)));
            if !body.is_finite() {
                slot.roll_back(workers, &mut self.output);
            }
        }
    }

    fn evaluate(&mut self, workers: &Workers<'_>) {
        for slot in &mut self.slots {
            slot.ledger.before = slot.ledger.after;
            slot.body.evaluate(workers, 2);
            slot.ledger.solved = slot.bound_energy(workers);
            if !slot.body.save_finite_state() {
                slot.roll_back(workers, &mut self.output);
                slot.ledger.solved = slot.ledger.after;
            }
            slot.body.refresh_operator(workers);
            slot.ledger.after = slot.ledger.solved;
        }
    }

    fn advance_fronts(&mut self) {
        for slot in &mut self.slots {
            for (tool, contact) in self.tools.iter().zip(&mut slot.contacts) {
                if let (Some(pose), Some(before)) = (tool.pose, tool.before) {
                    let motion = BladeMotion { blade: &tool.blade, before, pose };
                    let book = contact.front.advance(&slot.body, &motion, &mut slot.parting);
                    self.contact_ledger.front.add(&book);
                }
            }
        }
        self.output.fracture.cut_area_m2 = self.contact_ledger.front.area_m2;
    }

    fn update_topology(&mut self, workers: &Workers<'_>) {
        for slot in &mut self.slots {
            slot.parted = slot.body.part_links(&slot.parting);
            slot.parting.clear();
            slot.change = TopologyChange::default();
            if slot.parted.is_empty() {
                continue;
            }
            slot.change = slot.body.update_topology(workers, &slot.parted);
            slot.velocity_change.resize(slot.body.node_count(), [0.0; 3]);
            slot.ledger.after = slot.body.energy();
            slot.walls.update(&slot.body, &slot.parted, &slot.change);
            slot.reserve();
            self.output.fracture.parted_links += slot.parted.len() as u32;
        }
        if self.output.fracture.parted_links > 0 {
            self.output.topology_version += 1;
        }
    }

    fn update_view(&mut self) {
        if let Some(view) = &mut self.view {
            let bodies = self.slots.iter().map(|s| (&s.body, s.parted.as_slice(), &s.change));
            view.update(bodies, self.output.topology_version);
        }
    }

    /// Wrenches from the forces the solver applied; tool work and flank energies with them.
    fn write_wrenches(&mut self) {
        for (index, tool) in self.tools.iter().enumerate() {
            let mut wrench = Wrench::default();
            let mut model = tool.pose.map(|pose| ContactModelSum::new(pose, &tool.blade));
            for slot in &self.slots {
                let contact = &slot.contacts[index];
                for c in contact.springs().filter(|c| c.mode != Mode::Off) {
                    let force = c.direction * c.force_n();
                    self.contact_ledger.tool_work_j += force.dot(&(c.tool_point_m - c.tool_point_before_m));
                    if let Some(sum) = &mut model {
                        sum.add(c, &mut wrench);
                    }
                }
                for c in &contact.flanks {
                    self.contact_ledger.flank_work_j += c.force_n() * (c.gap_m - c.gap_before_m);
                    self.contact_ledger.flank_stored_j += 0.5 * c.force_n() * c.gap_m;
                }
            }
            let output = &mut self.output.tools[index];
            output.pose = tool.pose;
            output.wrench = wrench;
            output.contact = model.and_then(|m| m.finish(wrench));
            output.cutting_length_m = self.slots.iter().map(|s| s.contacts[index].front.cutting_length_m()).sum();
        }
    }

    fn finish(&mut self) {
        let before = self.output.energy;
        let ledgers = self.slots.iter().map(|s| &s.ledger);
        self.output.energy = ledger::book(ledgers, &self.contact_ledger, &before, self.flank_before_j);
        self.flank_before_j = self.contact_ledger.flank_stored_j;
        for (probe, out) in self.probes.iter().zip(&mut self.output.probe_displacement_m) {
            *out = self.slots[probe.body].body.current_m(&probe.point) - probe.point.position_m;
        }
        self.output.step += 1;
        self.output.sim_time_s = self.output.step as f64 * self.params.dt_s;
    }

    /// Takes the scene to rest under its loads alone, tools lifted. `progress` is told the norm of the
    /// unbalanced force over that of the loads before each solve.
    pub fn relax(&mut self, workers: &Workers<'_>, progress: &mut dyn FnMut(f64)) -> Relaxation {
        let mut total = Relaxation { solves: 0, relative_residual: 0.0, converged: true };
        for slot in &mut self.slots {
            slot.contacts.iter_mut().for_each(ToolContact::lift);
            let one = slot.body.relax(workers, progress);
            slot.ledger.after = slot.body.energy();
            total.solves += one.solves;
            total.relative_residual = total.relative_residual.max(one.relative_residual);
            total.converged &= one.converged;
        }
        total
    }

    /// What the last step reported.
    #[must_use]
    pub fn output(&self) -> &StepOutput {
        &self.output
    }

    /// The scene's bodies.
    #[must_use]
    pub fn bodies(&self) -> Vec<&Body> {
        self.slots.iter().map(|s| &s.body).collect()
    }

    /// A body whose state is to be set from outside: starts that are not at rest.
    pub fn body_mut(&mut self, index: usize) -> &mut Body {
        self.slots[index].edited = true;
        &mut self.slots[index].body
    }

    /// Numbers of things in the scene as it is now; contours the surface if nobody has yet.
    #[must_use]
    pub fn counts(&mut self) -> WorldCounts {
        let mut counts = WorldCounts::default();
        for (_, surface) in self.bodies_and_surfaces() {
            counts.surface_vertices += surface.vertices().len();
            counts.surface_triangles += 2 * surface.quads().len();
        }
        for slot in &self.slots {
            counts.voxels += slot.body.grid.voxels().len();
            counts.composite_elements += slot.body.base().elements.len();
            counts.nodes += slot.body.node_count();
            counts.parts += slot.body.part_count() as usize;
        }
        counts
    }

    /// What each object consists of.
    #[must_use]
    pub fn object_stats(&self) -> Vec<ObjectStats> {
        let stats = |slot: &BodySlot| {
            let grid = &slot.body.grid;
            let centres = grid.voxels().iter().map(|v| grid.centre_m(v.ijk));
            let aabb = Aabb::around(centres).grown(0.5 * grid.voxel_size_m());
            ObjectStats {
                rest_min_m: aabb.min_m.into(),
                rest_max_m: aabb.max_m.into(),
                voxel_size_m: grid.voxel_size_m(),
                voxels: grid.voxels().len() as u32,
                composite_elements: slot.body.base().elements.len() as u32,
            }
        };
        self.slots.iter().map(stats).collect()
    }

    /// Contours nothing more until the surface is asked for again; it will then be the same as if it
    /// had been followed.
    pub fn forget_surface(&mut self) {
        self.view = None;
    }

    /// What viewers see, contoured if nobody has yet, and the slots of the bodies it shows.
    fn view(&mut self) -> (&View, &[BodySlot]) {
        let view = self.view.get_or_insert_with(|| View::new(self.slots.iter().map(|s| &s.body)));
        (view, &self.slots)
    }

    /// Each body with its surface, which is contoured if nobody has yet.
    pub fn bodies_and_surfaces(&mut self) -> impl Iterator<Item = (&Body, &Surface)> {
        let (view, slots) = self.view();
        slots.iter().map(|s| &s.body).zip(view.surfaces())
    }

    /// Structure of the scene as it is now. From the first call on, steps that part links make a
    /// [`TopologyPatch`], until [`World::forget_surface`].
    #[must_use]
    pub fn keyframe(&mut self) -> Keyframe {
        let version = self.output.topology_version;
        let (view, slots) = self.view();
        view.keyframe(slots.iter().map(|s| &s.body), version)
    }

    /// What the last step changed in the structure; `None` where no link parted, or where nobody
    /// has asked for a keyframe since the surface was forgotten.
    #[must_use]
    pub fn topology_patch(&self) -> Option<&TopologyPatch> {
        self.view.as_ref()?.patch()
    }

    /// Displacements of an object's nodes, xyz interleaved, m, scene frame, appended to `out`.
    pub fn node_displacements_m(&self, object: usize, out: &mut Vec<f32>) {
        let body = &self.slots[object].body;
        for (node, x) in body.position_m.iter().enumerate() {
            let rest = body.rest_position_m(node);
            out.extend((0..3).map(|i| (x[i] - rest[i]) as f32));
        }
    }

    /// Hash of positions, velocities, fronts and topology.
    #[must_use]
    pub fn state_hash(&self) -> u64 {
        let mut hasher = StateHasher::default();
        hasher.word(self.output.step);
        for slot in &self.slots {
            for values in [&slot.body.position_m, &slot.body.velocity_m_per_s] {
                values.iter().for_each(|v| hasher.floats(v));
            }
            for element in &slot.body.base().elements {
                element.nodes.iter().for_each(|n| hasher.word(u64::from(*n)));
            }
            slot.contacts.iter().for_each(|c| c.front.fold_into(&mut hasher));
        }
        hasher.finish()
    }

    /// Hash of the surface's structure; see [`crate::surface::hash`].
    #[must_use]
    pub fn surface_hash(&mut self) -> u64 {
        self.view().0.hash()
    }
}

impl BodySlot {
    fn new(body: Body, blades: &[Blade]) -> Self {
        let contacts = blades
            .iter()
            .map(|blade| ToolContact {
                front: Front::new(blade, &body),
                flanks: Vec::new(),
                hash: SpatialHash::default(),
            })
            .collect();
        let energy = body.energy();
        let mut slot = Self {
            velocity_change: vec![[0.0; 3]; body.node_count()],
            ledger: BodyLedger { after: energy, ..BodyLedger::default() },
            body,
            contacts,
            walls: Walls::default(),
            impulses: Vec::new(),
            parting: Vec::new(),
            parted: Vec::new(),
            change: TopologyChange::default(),
            edited: false,
        };
        slot.reserve();
        slot
    }

    /// Room for every contact there may be until links part again: a step in between allocates nothing.
    fn reserve(&mut self) {
        for contact in &mut self.contacts {
            contact.flanks.clear();
            contact.flanks.reserve(self.walls.len());
            contact.hash.reserve(self.body.base().elements.len());
        }
        let springs = self.contacts.iter().map(|c| c.front.most_springs() + self.walls.len()).sum();
        self.impulses.clear();
        self.impulses.reserve(POINT_NODES * springs);
        self.body.reserve_springs(springs);
    }

    fn solve(&mut self, workers: &Workers<'_>, dt_s: f64) -> crate::step_io::SolveReport {
        self.velocity_change.resize(self.body.node_count(), [0.0; 3]);
        self.impulses.clear();
        for contact in self.contacts.iter().flat_map(ToolContact::springs).filter(|c| c.mode != Mode::Off) {
            let impulse = contact.direction * contact.impulse(dt_s);
            self.impulses.extend(contact.weights.iter().map(|(node, w)| (node, (impulse * w).into())));
        }
        self.body.set_springs(self.contacts.iter().flat_map(ToolContact::springs));
        let scale = self.body.applied_impulse_norm(&self.impulses);
        self.body.solve_velocity_change(workers, &self.impulses, scale, &mut self.velocity_change)
    }

    fn settle_contacts(&mut self, dt_s: f64) -> bool {
        let mut changed = false;
        for contact in &mut self.contacts {
            for front in &mut contact.front.contacts {
                changed |= front.settle(dt_s, &self.velocity_change);
            }
            for flank in &mut contact.flanks {
                changed |= flank.settle(dt_s, &self.velocity_change);
            }
        }
        changed
    }

    /// A state that was set from outside is what the next step starts from and goes back to, if it is
    /// finite.
    fn take_edits(&mut self, workers: &Workers<'_>) {
        self.edited = false;
        self.body.evaluate(workers, 20);
        if self.body.save_finite_state() {
            self.body.refresh_operator(workers);
            self.ledger.after = self.body.energy();
        }
    }

    /// Takes a step back where it created energy: the linearised step bounds it but where an element
    /// turns or stiffens many times over within one step (few voxels in a cell, hit at metres per
    /// second). The ledger's residual shows it. Returns the energy of the step's end.
    fn bound_energy(&mut self, workers: &Workers<'_>) -> BodyEnergy {
        let velocity = &self.body.velocity_m_per_s;
        let work = |(node, impulse): &(u32, [f64; 3])| -> f64 {
            (0..3).map(|i| impulse[i] * velocity[*node as usize][i]).sum()
        };
        let put_in = self.impulses.iter().map(|i| work(i).abs()).sum::<f64>() + self.ledger.load_work_j.abs();
        let bound = ENERGY_GROWTH * self.ledger.before.total_j() + 2.0 * put_in + LEAST_ENERGY_J;
        let mut energy = self.body.energy();
        for _ in 0..MAX_STEPS_BACK {
            if energy.total_j() <= bound {
                break;
            }
            self.body.step_back(workers, 0.25);
            energy = self.body.energy();
        }
        energy
    }

    /// Positions and rotations go back to the last finite step, velocities are zeroed, the tools lifted.
    fn roll_back(&mut self, workers: &Workers<'_>, output: &mut StepOutput) {
        self.body.restore_finite_state(workers);
        self.velocity_change.iter_mut().for_each(|v| *v = [0.0; 3]);
        self.contacts.iter_mut().for_each(ToolContact::lift);
        self.ledger = BodyLedger { after: self.body.energy(), ..BodyLedger::default() };
        output.fault = Some(Fault { step: output.step, object: self.body.name.clone(), what: FaultKind::NodeState });
    }
}

impl ToolContact {
    fn lift(&mut self) {
        self.front.lift();
        self.flanks.clear();
    }

    fn springs(&self) -> impl Iterator<Item = &Contact> {
        self.front.contacts.iter().flat_map(|c| [&c.forward, &c.lateral]).chain(&self.flanks)
    }

    fn detect(&mut self, body: &Body, walls: &Walls, motion: &BladeMotion<'_>, entered: bool) {
        let half = 0.5 * motion.blade.width_m;
        let ends = [motion.before, motion.pose]
            .into_iter()
            .flat_map(|pose| [-half, half].map(|x| pose.transform(&Vec3::new(x, 0.0, 0.0))));
        self.hash.rebuild(body, &Aabb::around(ends).grown(body.grid.voxel_size_m()));
        if entered {
            self.front.enter(body, &self.hash, motion.blade, &motion.pose);
        }
        self.front.detect(body, &self.hash, motion);
        self.flanks.clear();
        if !walls.is_empty() {
            walls.contacts(body, motion.blade, &motion.before, &motion.pose, &mut self.flanks);
        }
    }
}

/// Accumulates the wrench and the local contact model of a tool.
struct ContactModelSum {
    pose: Pose,
    forward: Vec3,
    stiffness: [[f64; 6]; 6],
    cap_n: f64,
    yields: bool,
    contacts: u32,
    radius_m: f64,
}

impl ContactModelSum {
    fn new(pose: Pose, blade: &Blade) -> Self {
        Self {
            pose,
            forward: pose.orientation * -Vec3::y(),
            stiffness: [[0.0; 6]; 6],
            cap_n: 0.0,
            yields: false,
            contacts: 0,
            radius_m: 0.05 * blade.width_m,
        }
    }

    fn add(&mut self, contact: &Contact, wrench: &mut Wrench) {
        let arm = contact.tool_point_m - self.pose.position_m;
        let force = -contact.direction * contact.force_n();
        wrench.force_n += force;
        wrench.torque_nm += arm.cross(&force);
        self.contacts += 1;
        if contact.limit_n.is_finite() {
            self.cap_n += contact.limit_n;
        }
        self.yields |= contact.mode == Mode::Yield;
        let turn = arm.cross(&contact.direction);
        let row = [0, 1, 2].map(|i| contact.direction[i]);
        let row: [f64; 6] = std::array::from_fn(|i| if i < 3 { row[i] } else { turn[i - 3] });
        for i in 0..6 {
            for j in 0..6 {
                self.stiffness[i][j] += contact.stiffness_n_per_m * row[i] * row[j];
            }
        }
    }

    fn finish(self, wrench: Wrench) -> Option<ContactModel> {
        (self.contacts > 0).then_some(ContactModel {
            reference: self.pose,
            wrench,
            stiffness: self.stiffness,
            damping_n_s_per_m: 0.0,
            force_cap_n: self.yields.then_some(self.cap_n),
            cap_direction: -self.forward,
            validity_radius_m: self.radius_m,
        })
    }
}
