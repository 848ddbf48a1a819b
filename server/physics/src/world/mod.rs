//! The state of one scene and the order of its step.

mod activity;
mod blade_contact;
mod body_slot;
mod brake;
mod clear;
mod contact_model;
mod description;
mod detection;
mod file;
mod inputs;
mod interior;
mod models;
mod motion;
mod own_view;
mod part_groups;
mod parting;
mod put_away;
mod queries;
mod report;
mod rollback;
mod scratch;
mod show;
mod sleep;
mod snapshot;
mod solve;
mod state;
mod tension;
mod tissue_contact;
mod tool;
mod tool_contact;
mod wrenches;

use crate::Vec3;
use crate::body::{Body, share_of_rest};
use crate::making::{Making, MakingStage, Teller};
use crate::scene::{SceneError, SceneProblems};
use crate::stage::{Lap, Stage, StageClock};
use crate::step_io::{EnergyStep, StepInputs, StepOutput, ToolOutput};
use crate::tool::part::ToolPart;
use crate::validate::SoundScene;
use crate::work::WorkMeter;
use crate::workers::Workers;
use body_slot::BodySlot;
use contact_model::ToolModel;
use description::Description;
use scratch::Scratch;
use state::State;
use std::sync::Arc;
use tool::Tool;
use tool_contact::ToolContact;

pub use crate::body::Relaxation;
pub use file::LoadError;
pub use interior::Interior;
pub use queries::{ObjectStats, TissuePress, WorldCounts};
pub use snapshot::Snapshot;

/// One scene: its objects, its tools and their state.
pub struct World {
    /// What it is of: constant.
    description: Description,
    /// What a step changes and the next one goes on from.
    state: State,
    /// Room to work in, and what is made of the state for those who watch.
    scratch: Scratch,
    /// What the last step reported.
    output: StepOutput,
}

impl World {
    /// Builds the scene at rest.
    ///
    /// # Errors
    /// What shows only while it is built: a mesh that encloses nothing, a point in no voxel, a prestrain without equilibrium.
    pub fn new(scene: &SoundScene) -> Result<Self, SceneProblems> {
        Self::make(scene, &mut |_| ())
    }

    /// The same, and tells how far it is: often enough for a bar that moves.
    ///
    /// # Errors
    /// Those of [`World::new`].
    pub fn make(scene: &SoundScene, tell: &mut dyn FnMut(Making)) -> Result<Self, SceneProblems> {
        let mut teller = Teller::new(scene.desc.objects.len(), tell);
        let params = description::params(scene)?;
        let parts = ToolPart::of(&scene.desc.tools, scene.desc.stiffest_pa())?;
        let tools = scene.desc.tools.len();
        let mut slots = Vec::with_capacity(scene.desc.objects.len());
        for (index, object) in scene.desc.objects.iter().enumerate() {
            let mut body = Body::made(scene, index, params, &Workers::serial(), &mut teller)?;
            let is_tense = object.materials().any(|material| material.prestrain.is_some());
            if is_tense {
                teller.stage(MakingStage::Equilibrium);
                let Relaxation { converged, relative_residual, .. } =
                    body.relax(&Workers::serial(), &mut |residual| teller.relaxed(share_of_rest(residual)));
                if !converged {
                    Err(SceneError::Field {
                        field: format!("objects[{index}].material.prestrain"),
                        message: format!(
                            "does not come to rest: {relative_residual:.1e} of the forces stay unbalanced"
                        ),
                    })?;
                }
            }
            slots.push(BodySlot::new(body, &parts, is_tense || !object.loads.is_empty()));
        }
        let tracked_points = description::tracked_points(scene, &slots)?;
        let mut scratch = Scratch::default();
        scratch.models.resize_with(tools, ToolModel::default);
        let output = StepOutput {
            tools: vec![ToolOutput::default(); tools],
            tracked_displacement_m: vec![Vec3::zeros(); tracked_points.len()],
            ..StepOutput::default()
        };
        let mut state = State {
            step: 0,
            topology_version: 0,
            slots,
            tools: vec![Tool::default(); parts.len()],
            tissue: None,
            energy: EnergyStep::default(),
            spring_stored_j: 0.0,
        };
        if state.slots.len() > 1 {
            state.follow_tissue_anew();
        }
        let most_relative_residual = scene.desc.most_relative_residual();
        let reach = put_away::reach(state.bodies());
        let scene = Arc::new(description::identity(scene));
        let dt_s = params.dt_s;
        let description = Description { scene, dt_s, most_relative_residual, parts, tracked_points, reach };
        Ok(Self { description, state, scratch, output })
    }

    /// Advances the scene by one time step.
    pub fn step(&mut self, workers: &Workers<'_>, clock: &dyn StageClock, inputs: &StepInputs<'_>) -> &StepOutput {
        workers.run(|| self.run_stages(workers, clock, inputs));
        &self.output
    }

    fn run_stages(&mut self, workers: &Workers<'_>, clock: &dyn StageClock, inputs: &StepInputs<'_>) {
        let Self { description, state, scratch, output } = self;
        let dt_s = description.dt_s;
        scratch.work = WorkMeter::begin(inputs.work_units, description.most_relative_residual);
        let mut lap = Lap::start(clock);
        inputs::take_edits(workers, state);
        inputs::apply(description, inputs, state, scratch, output);
        lap.end(Stage::ApplyInputs);
        if state.tools.iter().any(|tool| tool.pose.is_some()) {
            detection::tools(state);
            lap.end(Stage::Contact);
        }
        if state.tissue.is_some() && state.awake().next().is_some() {
            detection::tissue(dt_s, state);
            lap.end(Stage::SelfContact);
        }
        detection::cohesive(dt_s, state);
        output.solve = solve::velocities(workers, dt_s, state, &mut scratch.work);
        brake::spins(dt_s, state);
        lap.end(Stage::Velocities);
        models::ask(inputs.models, scratch);
        if scratch.models.iter().any(ToolModel::is_asked) {
            models::go_on(workers, description, state, scratch);
            lap.end(Stage::ContactModel);
        }
        motion::integrate(workers, state);
        lap.end(Stage::Integrate);
        motion::evaluate(workers, dt_s, state);
        rollback::take_back_lost(workers, state, output);
        wrenches::write(description, state, scratch, output);
        wrenches::slip(description, state, output);
        lap.end(Stage::Rotations);
        if state.slots.iter().any(BodySlot::may_part) {
            parting::advance_fronts(dt_s, state, scratch, output);
            lap.end(Stage::Fracture);
        }
        if state.slots.iter().any(|slot| !slot.scratch.parting.is_empty()) {
            parting::update_topology(workers, state, output);
            lap.end(Stage::Topology);
        }
        if scratch.view.is_some() && output.fracture.parted_links > 0 {
            show::follow(state, scratch);
            lap.end(Stage::Surface);
        }
        output.put_away = put_away::put_away(workers, description, state);
        sleep::let_sleep(workers, dt_s, state);
        report::finish(description, state, scratch, output);
        output.profile = lap.finish();
    }

    /// Takes the scene to rest under its loads alone, tools lifted. `progress` is told the norm of the
    /// unbalanced force over that of the loads before each solve.
    pub fn relax(&mut self, workers: &Workers<'_>, progress: &mut dyn FnMut(f64)) -> Relaxation {
        let mut total = Relaxation { solves: 0, relative_residual: 0.0, converged: true };
        for slot in &mut self.state.slots {
            slot.wake();
            slot.contacts.iter_mut().for_each(ToolContact::lift);
            let one = slot.body.relax(workers, progress);
            slot.ledger.after = slot.body.energy();
            total.solves += one.solves;
            total.relative_residual = total.relative_residual.max(one.relative_residual);
            total.converged &= one.converged;
        }
        report::read_tracked_points(&self.description, &self.state, &mut self.output);
        total
    }

    /// See [`crate::verification::scale_blade_penalties`].
    pub(crate) fn scale_blade_penalties(&mut self, factor: f64) {
        self.state.slots.iter_mut().flat_map(|s| &mut s.contacts).for_each(|c| c.scale_penalties(factor));
    }

    /// What the last step reported.
    #[must_use]
    pub fn output(&self) -> &StepOutput {
        &self.output
    }

    /// The scene's bodies.
    #[must_use]
    pub fn bodies(&self) -> Vec<&Body> {
        self.state.bodies().collect()
    }

    /// A body whose state is to be set from outside: starts that are not at rest.
    pub(crate) fn body_mut(&mut self, index: usize) -> &mut Body {
        let slot = &mut self.state.slots[index];
        slot.edited.get_or_insert(slot.body.boundary().version());
        &mut slot.body
    }
}
