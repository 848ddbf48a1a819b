//! The state of one scene and the order of its step.

mod activity;
mod blade_contact;
mod body_slot;
mod brake;
mod contact_model;
mod interior;
mod part_groups;
mod pulled;
mod queries;
mod sleep;
mod snapshot;
mod solve;
mod tissue_contact;
mod tool;
mod tool_contact;

use crate::Vec3;
use crate::body::{Body, MaterialPoint, PartedLinks, TopologyChange};
use crate::fault::{Fault, FaultKind};
use crate::fracture::{FrontBook, samples_drive};
use crate::grid::Grid;
use crate::ledger::{self, BodyLedger, ContactLedger};
use crate::params::StepParams;
use crate::scene::wording::brief;
use crate::scene::{Scene, SceneError};
use crate::stage::{Lap, Stage, StageClock};
use crate::step_io::{FractureStep, Grasp, StepInputs, StepOutput, ToolMotion, ToolOutput};
use crate::tool::ToolShape;
use crate::view::View;
use crate::workers::Workers;
use body_slot::BodySlot;
use contact_model::{ContactSum, ToolModel};
use tissue_contact::TissueContacts;
use tool::Tool;
use tool_contact::ToolContact;

pub use crate::body::Relaxation;
pub use interior::Interior;
pub use queries::{ObjectStats, TissuePress, WorldCounts};
pub use snapshot::Snapshot;

/// A material point that is followed.
struct TrackedPoint {
    body: usize,
    point: MaterialPoint,
}

/// One scene: its objects, its tools and their state.
pub struct World {
    params: StepParams,
    slots: Vec<BodySlot>,
    tools: Vec<Tool>,
    tracked_points: Vec<TrackedPoint>,
    /// Present from when the surface is first asked for until it is forgotten: nobody watches,
    /// nothing is contoured.
    view: Option<View>,
    /// Present from when tissue may meet tissue: in scenes of several objects, and after the first cut.
    tissue: Option<TissueContacts>,
    contact_ledger: ContactLedger,
    springs_before_j: f64,
    /// By tool; nothing that a step does depends on them.
    models: Vec<ToolModel>,
    output: StepOutput,
}

impl World {
    /// Builds the scene at rest.
    ///
    /// # Errors
    /// A field of the scene whose value is not supported, with the field and the limit named.
    pub fn new(scene: &Scene) -> Result<Self, SceneError> {
        let desc = &scene.desc;
        if let Some(dial) = &desc.dial {
            let message = format!("{dial} is not settled; a world is built of a setting");
            return Err(SceneError::Field { field: "dial".into(), message });
        }
        let params = StepParams {
            dt_s: 1.0 / desc.rate_hz,
            relative_tolerance: desc.relative_tolerance(),
            max_iterations: desc.solver.max_iterations,
        };
        let mut tools = Vec::with_capacity(desc.tools.len());
        for (index, tool) in desc.tools.iter().enumerate() {
            let shape = ToolShape::new(&tool.shape).map_err(|e| e.within(&format!("tools[{index}].shape")))?;
            tools.push(Tool::new(shape));
        }
        let mut slots = Vec::with_capacity(desc.objects.len());
        for (index, object) in desc.objects.iter().enumerate() {
            let body = Body::new(scene, index, params, &Workers::serial())?;
            slots.push(BodySlot::new(body, tools.iter().map(|tool| &tool.shape), !object.loads.is_empty()));
        }
        let mut world = Self {
            params,
            slots,
            tools,
            tracked_points: Vec::new(),
            view: None,
            tissue: None,
            contact_ledger: ContactLedger::default(),
            springs_before_j: 0.0,
            models: Vec::new(),
            output: StepOutput::default(),
        };
        for (index, point) in desc.tracked_points.iter().enumerate() {
            world.tracked_points.push(world.find_tracked_point(
                scene,
                index,
                &point.object,
                point.position_m.into(),
            )?);
        }
        if world.slots.len() > 1 {
            world.follow_tissue();
        }
        world.models.resize_with(world.tools.len(), ToolModel::default);
        world.output.tools = vec![ToolOutput::default(); world.tools.len()];
        world.output.tracked_displacement_m = vec![Vec3::zeros(); world.tracked_points.len()];
        Ok(world)
    }

    fn find_tracked_point(
        &self,
        scene: &Scene,
        index: usize,
        object: &str,
        position_m: Vec3,
    ) -> Result<TrackedPoint, SceneError> {
        let error =
            |message: String| SceneError::Field { field: format!("tracked_points[{index}].position_m"), message };
        let body = scene
            .desc
            .objects
            .iter()
            .position(|o| o.name == object)
            .ok_or_else(|| error(format!("there is no object named `{object}`")))?;
        let grid = &self.slots[body].body.state.grid;
        let voxel =
            grid.voxel_at(grid.cell_of(&position_m)).ok_or_else(|| error(outside(grid, object, &position_m)))?;
        Ok(TrackedPoint { body, point: MaterialPoint { position_m, voxel } })
    }

    /// Advances the scene by one time step.
    pub fn step(&mut self, workers: &Workers<'_>, clock: &dyn StageClock, inputs: &StepInputs<'_>) -> &StepOutput {
        workers.run(|| self.run_stages(workers, clock, inputs));
        &self.output
    }

    fn run_stages(&mut self, workers: &Workers<'_>, clock: &dyn StageClock, inputs: &StepInputs<'_>) {
        let mut lap = Lap::start(clock);
        self.take_edits(workers);
        self.apply_inputs(inputs);
        lap.end(Stage::ApplyInputs);
        if self.tools.iter().any(|t| t.pose.is_some()) {
            self.detect_contacts();
            lap.end(Stage::Contact);
        }
        if self.tissue.is_some() && self.awake().next().is_some() {
            self.detect_tissue();
            lap.end(Stage::SelfContact);
        }
        let dt_s = self.params.dt_s;
        self.awake().for_each(|slot| slot.detect_cohesive(dt_s));
        self.solve_velocities(workers);
        self.brake_spins();
        lap.end(Stage::Velocities);
        if !inputs.models.is_empty() {
            self.update_models(workers, inputs.models);
            lap.end(Stage::ContactModel);
        }
        self.integrate(workers);
        lap.end(Stage::Integrate);
        self.evaluate(workers);
        self.write_wrenches();
        self.slip();
        lap.end(Stage::Rotations);
        if self.slots.iter().any(BodySlot::may_part) {
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
        self.let_sleep(workers);
        self.finish();
        self.output.profile = lap.finish();
    }

    /// The bodies of which a step is taken.
    fn awake(&mut self) -> impl Iterator<Item = &mut BodySlot> {
        self.slots.iter_mut().filter(|slot| !slot.is_asleep())
    }

    fn take_edits(&mut self, workers: &Workers<'_>) {
        let mut cut = false;
        for slot in &mut self.slots {
            cut |= slot.take_edits(workers);
        }
        if cut {
            self.follow_tissue();
        }
    }

    fn apply_inputs(&mut self, inputs: &StepInputs<'_>) {
        self.output.fault = None;
        self.output.fracture = FractureStep::default();
        self.contact_ledger = ContactLedger::default();
        self.view.iter_mut().for_each(View::begin_step);
        self.slots.iter_mut().for_each(|slot| slot.parted.clear());
        for tool in &mut self.tools {
            tool.before = tool.pose;
            tool.opening_before = tool.opening;
            tool.entered = false;
        }
        if let Some(tolerance) = inputs.relative_tolerance {
            for slot in self.slots.iter_mut().filter(|slot| slot.body.relative_tolerance() != tolerance) {
                slot.wake();
                slot.body.set_relative_tolerance(tolerance);
            }
        }
        for input in inputs.tools {
            let Some(tool) = self.tools.get_mut(input.tool) else { continue };
            match input.motion {
                ToolMotion::MoveTo { pose, opening } => tool.move_to(pose, opening),
                ToolMotion::EnterAt { pose, opening } => tool.enter_at(pose, opening),
                ToolMotion::Lift => {
                    tool.pose = None;
                    for slot in &mut self.slots {
                        if slot.contacts[input.tool].has_springs() {
                            slot.wake();
                        }
                        slot.contacts[input.tool].lift();
                    }
                }
            }
        }
    }

    fn detect_contacts(&mut self) {
        for slot in &mut self.slots {
            slot.detect_tools(&self.tools);
            if slot.pulled.is_none() && slot.contacts.iter().any(ToolContact::holds) {
                slot.feel_pull();
            }
        }
    }

    fn integrate(&mut self, workers: &Workers<'_>) {
        for slot in self.awake() {
            slot.ledger.load_work_j = slot.body.integrate(workers, &slot.velocity_change);
        }
    }

    /// Rotations, forces and energies where the step has led to. What is not finite by now, positions included, is
    /// found here and rolled back: nobody has seen it yet.
    fn evaluate(&mut self, workers: &Workers<'_>) {
        let mut rolled_back = false;
        for slot in &mut self.slots {
            if slot.is_asleep() {
                slot.ledger = BodyLedger::at_rest(slot.ledger.after);
                continue;
            }
            slot.front_stored_j = 0.0;
            slot.ledger.before = slot.ledger.after;
            slot.ledger.step = slot.body.evaluate_step(workers, &slot.velocity_change);
            slot.ledger.turned_j = slot.body.turn_velocities(workers);
            slot.ledger.solved = slot.body.energy();
            slot.ledger.after = slot.ledger.solved;
            if slot.body.save_finite_state(workers) {
                continue;
            }
            slot.roll_back(workers);
            rolled_back = true;
            // Of several bodies the first is reported: the others may have failed for it.
            let (step, object) = (self.output.step, &slot.body.description.name);
            let fault = || Fault { step, object: object.clone(), what: FaultKind::NodeState };
            self.output.fault.get_or_insert_with(fault);
        }
        if rolled_back {
            // What pressed on it, or it pressed on, finds nothing to go on from.
            self.tissue.iter_mut().for_each(|tissue| tissue.release(&self.slots));
        }
    }

    fn advance_fronts(&mut self) {
        let samples = samples_drive(self.output.step, self.params.dt_s);
        for slot in self.slots.iter_mut().filter(|slot| !slot.is_asleep()) {
            let mut book = FrontBook::default();
            for (tool, contact) in self.tools.iter().zip(&mut slot.contacts) {
                if let Some(path) = tool.path() {
                    book.add(&contact.advance(&slot.body, &path, slot.pulled.is_some(), &mut slot.parting));
                    if samples {
                        contact.sample_drive(&slot.body);
                    }
                }
            }
            if let Some(pulled) = &mut slot.pulled {
                let (of_pull, looks) = pulled.advance(&slot.body, &book, &mut slot.parting);
                book.add(&of_pull);
                self.output.fracture.looks += looks;
            }
            slot.front_stored_j = book.stored_j;
            self.contact_ledger.front.add(&book);
        }
        self.output.fracture.cut_area_m2 = self.contact_ledger.front.area_m2;
    }

    fn update_topology(&mut self, workers: &Workers<'_>) {
        for slot in &mut self.slots {
            let PartedLinks { parted, spared } = slot.body.part_links(&slot.parting);
            slot.parted = parted;
            self.output.fracture.spared_links += spared as u32;
            slot.parting.clear();
            slot.change = TopologyChange::default();
            if slot.parted.is_empty() {
                continue;
            }
            slot.change = slot.body.update_topology(workers, &slot.parted);
            slot.velocity_change.resize(slot.body.node_count(), [0.0; 3]);
            slot.ledger.after = slot.body.energy();
            slot.pulled.iter_mut().for_each(|pulled| pulled.follow(&slot.body, &slot.parted, &slot.change));
            self.output.fracture.parted_links += slot.parted.len() as u32;
        }
        if self.output.fracture.parted_links > 0 {
            self.output.topology_version += 1;
            self.follow_tissue();
        }
    }

    /// Takes the surfaces as they are now to the contact of tissue with tissue, where there may be any.
    fn follow_tissue(&mut self) {
        match &mut self.tissue {
            Some(tissue) => tissue.follow(&self.slots),
            None => self.tissue = Some(TissueContacts::new(&self.slots)),
        }
        let springs = self.tissue.as_ref().map_or(0, TissueContacts::most_springs);
        self.slots.iter_mut().for_each(|slot| slot.reserve(springs));
    }

    fn update_view(&mut self) {
        if let Some(view) = &mut self.view {
            let bodies = self.slots.iter().map(|s| (&s.body, s.parted.as_slice(), &s.change));
            view.update(bodies, self.output.topology_version);
        }
    }

    /// Brings what `tools` feel up to date: with the step's own matrices, before anything parts.
    fn update_models(&mut self, workers: &Workers<'_>, tools: &[usize]) {
        for &index in tools {
            let Some(tool) = self.tools.get(index) else { continue };
            let Some(pose) = tool.pose else { continue };
            let model = &mut self.models[index];
            model.begin(index, &mut self.slots);
            for (body, slot) in self.slots.iter_mut().enumerate() {
                if slot.contacts[index].pressing().next().is_none() {
                    continue;
                }
                let dt_s = slot.body.quasi_static_dt_s();
                let of_tissue = self.tissue.iter().flat_map(|tissue| tissue.point_springs(body, dt_s));
                slot.set_quasi_static_springs(of_tissue, dt_s);
                model.feel(workers, (body, &mut slot.body), (&tool.shape, &pose), slot.contacts[index].pressing());
            }
        }
    }

    /// Wrenches from the forces the solver applied, models about them; tool work and the springs' energies with them.
    fn write_wrenches(&mut self) {
        for (index, tool) in self.tools.iter().enumerate() {
            let mut sum = tool.pose.map(ContactSum::new);
            for slot in &self.slots {
                let contact = &slot.contacts[index];
                for c in contact.acting() {
                    let moved_m = c.ends.tool_point_m - c.ends.tool_point_before_m;
                    self.contact_ledger.tool_work_j += c.applied_n().dot(&moved_m);
                    sum.iter_mut().for_each(|sum| sum.push(c));
                }
                if let Some(sum) = &mut sum {
                    contact.pressing().for_each(|c| sum.bound(c));
                }
                contact.beside_fronts().for_each(|c| self.contact_ledger.add(c, self.params.dt_s));
            }
            let output = &mut self.output.tools[index];
            (output.pose, output.opening) = (tool.pose, tool.opening);
            output.wrench = sum.as_ref().map(ContactSum::wrench).unwrap_or_default();
            output.touches = sum.as_ref().is_some_and(|sum| sum.touches);
            let felt = &mut self.models[index].felt;
            *felt = felt.filter(|_| output.touches);
            let about = sum.zip(tool.path()).zip(felt.as_ref());
            output.contact = about.map(|((sum, path), felt)| {
                let give = contact_model::give(|| self.slots.iter().flat_map(|slot| slot.contacts[index].pressing()));
                sum.model((&tool.shape, &path), self.params.dt_s, felt, give)
            });
            output.cutting_length_m = self.slots.iter().map(|s| s.contacts[index].cutting_length_m()).sum();
            let holds = self.slots.iter().any(|s| s.contacts[index].holds());
            output.grasp = if holds { Grasp::Holding } else { Grasp::Nothing };
        }
        if let Some(tissue) = &mut self.tissue {
            tissue.conclude(&mut self.contact_ledger, self.params.dt_s);
        }
    }

    /// What is held with more force than a grasper has slips out of it, all at once.
    fn slip(&mut self) {
        for (index, (tool, output)) in self.tools.iter().zip(&mut self.output.tools).enumerate() {
            if output.grasp == Grasp::Holding && output.wrench.force_n.norm() > tool.shape.max_hold_n() {
                self.slots.iter_mut().for_each(|slot| slot.contacts[index].lift());
                output.grasp = Grasp::Slipped;
            }
        }
    }

    fn finish(&mut self) {
        let contacts = self.slots.iter_mut().flat_map(|s| &mut s.contacts);
        self.contact_ledger.front.lost_j += contacts.map(ToolContact::take_dropped_j).sum::<f64>();
        self.contact_ledger.front.stored_j = self.slots.iter().map(|s| s.front_stored_j).sum();
        let before = self.output.energy;
        let ledgers = self.slots.iter().map(|s| &s.ledger);
        self.output.energy = ledger::book(ledgers, &self.contact_ledger, &before, self.springs_before_j);
        self.springs_before_j = self.contact_ledger.spring_stored_j;
        self.read_tracked_points();
        self.output.step += 1;
        self.output.sim_time_s = self.output.step as f64 * self.params.dt_s;
    }

    fn read_tracked_points(&mut self) {
        for (tracked, out) in self.tracked_points.iter().zip(&mut self.output.tracked_displacement_m) {
            *out = self.slots[tracked.body].body.current_m(&tracked.point) - tracked.point.position_m;
        }
    }

    /// Takes the scene to rest under its loads alone, tools lifted. `progress` is told the norm of the
    /// unbalanced force over that of the loads before each solve.
    pub fn relax(&mut self, workers: &Workers<'_>, progress: &mut dyn FnMut(f64)) -> Relaxation {
        let mut total = Relaxation { solves: 0, relative_residual: 0.0, converged: true };
        for slot in &mut self.slots {
            slot.wake();
            slot.contacts.iter_mut().for_each(ToolContact::lift);
            let one = slot.body.relax(workers, progress);
            slot.ledger.after = slot.body.energy();
            total.solves += one.solves;
            total.relative_residual = total.relative_residual.max(one.relative_residual);
            total.converged &= one.converged;
        }
        self.read_tracked_points();
        total
    }

    /// For verification: sets a factor on the stiffness of every blade contact that is a penalty, of the springs that
    /// hold the tissue beside an edge and of those between flanks and walls, so as to tell what of a cut depends on
    /// it. The spring ahead of an edge is not one of them: it is the compliance of the continuum between an element
    /// and the edge's half-width. No scene has this.
    pub fn scale_blade_penalties(&mut self, factor: f64) {
        self.slots.iter_mut().flat_map(|s| &mut s.contacts).for_each(|c| c.scale_penalties(factor));
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
        let slot = &mut self.slots[index];
        slot.edited.get_or_insert(slot.body.boundary().version());
        &mut slot.body
    }
}

/// What is said of a tracked point in no voxel: where the nearest one is.
fn outside(grid: &Grid, object: &str, position_m: &Vec3) -> String {
    let told = |point: Vec3| format!("[{}, {}, {}]", brief(point.x), brief(point.y), brief(point.z));
    let centres = grid.voxels().iter().map(|voxel| grid.centre_m(voxel.ijk));
    let away = |centre: &Vec3| (centre - position_m).norm_squared();
    let nearest = centres.min_by(|a, b| away(a).total_cmp(&away(b))).map_or("none".to_owned(), told);
    format!("{} lies in no voxel of `{object}`; the nearest voxel's centre is {nearest}", told(*position_m))
}
