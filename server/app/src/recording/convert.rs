//! What a session tells, as it stands in a recording, and back.

use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use kerf_physics::scene::{Meshes, TriangleMesh};
use kerf_physics::step_io::{EnergyStep, Grasp, ToolMotion, ToolOutput};
use kerf_physics::surface::delta::{
    AdaptedVertex, BodyStructure, BoundQuad, BoundVertex, HeldVertex, Keyframe, LatticeElement, LatticeNode,
    TopologyPatch,
};
use kerf_physics::world::ObjectStats;
use kerf_physics::{Pose, Quat, Scene, SceneDesc, ToolInput, Vec3};
use kerf_proto::v1;
use kerf_proto::v1::recorded_motion::Motion;
use kerf_session::{
    Checkpoint, LoggedInputs, Owner, Phase, SceneEvent, Session, Shortfall, StepTimes, TapedStep, ViewEvent, ViewState,
};

use crate::convert::wrench;

/// Version of a recording's layout. Since 2 the surface hash covers materials and held weights: viewers would refuse
/// the structures of a recording of version 1.
pub const VERSION: u32 = 2;

/// What the program was compiled for.
pub const TARGET: &str = std::env::consts::ARCH;

/// What a recording begins with.
///
/// # Errors
/// The scene cannot be written as text; one that runs can.
pub fn header(session: &Session, summary: v1::SceneSummary) -> Result<v1::RecordingHeader> {
    let mesh = |(name, mesh): (&String, &TriangleMesh)| v1::RecordedMesh {
        name: name.clone(),
        positions: mesh.positions.iter().flatten().copied().collect(),
        triangles: mesh.triangles.iter().flatten().copied().collect(),
    };
    Ok(v1::RecordingHeader {
        version: VERSION,
        server_version: crate::VERSION.into(),
        session_id: session.id().to_string(),
        scene_toml: toml::to_string(&session.scene().desc)?,
        meshes: session.scene().meshes.iter().map(mesh).collect(),
        scene: Some(summary),
        is_paused: session.phase() != Phase::Running,
        owner: session.owner().map(|owner| owner.name.clone()).unwrap_or_default(),
        is_private: session.owner().is_some_and(|owner| owner.is_private),
        target: TARGET.into(),
    })
}

/// Whose session was recorded.
pub fn owner(header: &v1::RecordingHeader) -> Option<Owner> {
    let v1::RecordingHeader { owner, is_private, .. } = header;
    (!owner.is_empty()).then(|| Owner { name: owner.clone(), is_private: *is_private })
}

/// The scene that was recorded.
///
/// # Errors
/// What is wrong with it.
pub fn scene(header: &v1::RecordingHeader) -> Result<Scene> {
    let desc = SceneDesc::from_toml("scene_toml", &header.scene_toml)?;
    let mut meshes = Meshes::new();
    for mesh in &header.meshes {
        let read = TriangleMesh {
            positions: arrays(&mesh.positions)?,
            triangles: arrays(&mesh.triangles)?,
            ..TriangleMesh::default()
        };
        let vertices = read.positions.len();
        let is_whole = read.triangles.iter().flatten().all(|&vertex| (vertex as usize) < vertices);
        ensure!(is_whole, "mesh {}: a triangle has a vertex beyond its {vertices}", mesh.name);
        meshes.insert(mesh.name.clone(), read);
    }
    Ok(Scene { desc, meshes })
}

/// What the recorded objects consisted of.
pub fn object_stats(header: &v1::RecordingHeader) -> Vec<ObjectStats> {
    let corner = |corner: Option<v1::Vec3>| {
        let v1::Vec3 { x, y, z } = corner.unwrap_or_default();
        [x, y, z].map(f64::from)
    };
    let stats = |object: &v1::ObjectSummary| {
        let mut stats = ObjectStats {
            rest_min_m: corner(object.rest_min_m),
            rest_max_m: corner(object.rest_max_m),
            voxel_size_m: object.voxel_size_m,
            voxels: object.voxels,
            composite_elements: object.composite_elements,
            ..ObjectStats::default()
        };
        (stats.left_out.pieces, stats.left_out.voxels) = (object.left_out_pieces, object.left_out_voxels);
        stats
    };
    header.scene.iter().flat_map(|scene| &scene.objects).map(stats).collect()
}

/// A step.
pub fn step(taped: &TapedStep) -> v1::RecordedStep {
    let motion = |input: &ToolInput| {
        let motion = match &input.motion {
            ToolMotion::EnterAt { pose, opening } => Motion::Enter(place(pose, *opening)),
            ToolMotion::MoveTo { pose, opening } => Motion::Move(place(pose, *opening)),
            ToolMotion::Lift => Motion::Lift(v1::RecordedLift {}),
        };
        v1::RecordedMotion { tool_id: input.tool as u32, motion: Some(motion) }
    };
    v1::RecordedStep {
        step: taped.report.step,
        sim_time_s: taped.report.sim_time_s,
        motions: taped.inputs.tools.iter().map(motion).collect(),
        work_units: taped.inputs.work_units,
        state_hash: taped.state_hash,
    }
}

/// A checkpoint as a file.
pub fn checkpoint(name: &str, checkpoint: &Checkpoint) -> v1::RecordedCheckpoint {
    v1::RecordedCheckpoint { name: name.into(), data: checkpoint.save() }
}

/// What went into a step.
///
/// # Errors
/// What is wrong with it.
pub fn inputs(step: &v1::RecordedStep) -> Result<LoggedInputs> {
    let input = |motion: &v1::RecordedMotion| {
        let to = match motion.motion.as_ref().context("a motion says nothing")? {
            Motion::Enter(to) => {
                let (pose, opening) = pose_of(to)?;
                ToolMotion::EnterAt { pose, opening }
            }
            Motion::Move(to) => {
                let (pose, opening) = pose_of(to)?;
                ToolMotion::MoveTo { pose, opening }
            }
            Motion::Lift(_) => ToolMotion::Lift,
        };
        Ok(ToolInput { tool: motion.tool_id as usize, motion: to })
    };
    let tools = step.motions.iter().map(input).collect::<Result<_>>();
    let tools = tools.with_context(|| format!("step {}", step.step))?;
    Ok(LoggedInputs { tools, work_units: step.work_units })
}

fn place(pose: &Pose, opening: f64) -> v1::RecordedPlace {
    let q = &pose.orientation;
    v1::RecordedPlace {
        position_m: pose.position_m.iter().copied().collect(),
        orientation: vec![q.i, q.j, q.k, q.w],
        opening,
    }
}

fn pose_of(place: &v1::RecordedPlace) -> Result<(Pose, f64)> {
    let ([x, y, z], [i, j, k, w]) = (place.position_m.as_slice(), place.orientation.as_slice()) else {
        bail!("a place needs three coordinates and a quaternion");
    };
    let numbers = [x, y, z, i, j, k, w, &place.opening];
    ensure!(numbers.iter().all(|number| number.is_finite()), "a place has a number that is not finite");
    // Not normalised once more: that could change the last bit.
    let orientation = Quat::new_unchecked(nalgebra::Quaternion::new(*w, *i, *j, *k));
    Ok((Pose { position_m: Vec3::new(*x, *y, *z), orientation }, place.opening))
}

/// A state, without its energies.
pub fn state(state: &ViewState) -> v1::RecordedState {
    let bodies = state.node_displacements_m.iter().zip(&state.adapted);
    let body = |(displacements_m, adapted): (&Vec<f32>, &Vec<AdaptedVertex>)| v1::RecordedBody {
        node_displacements_m: displacements_m.clone(),
        adapted_vertex_ids: adapted.iter().map(|vertex| vertex.id).collect(),
        adapted_offsets_m: adapted.iter().flat_map(|vertex| vertex.offset_m).collect(),
    };
    let tool = |tool: &ToolOutput| v1::RecordedTool {
        place: tool.pose.as_ref().map(|pose| place(pose, tool.opening)),
        wrench: Some(wrench(&tool.wrench)),
        cutting_length_m: tool.cutting_length_m,
        is_holding: tool.grasp == Grasp::Holding,
    };
    let times = &state.times;
    v1::RecordedState {
        topology_version: state.topology_version,
        step: state.step,
        sim_time_s: state.sim_time_s,
        late_steps: state.late_steps,
        bodies: bodies.map(body).collect(),
        tools: state.tools.iter().map(tool).collect(),
        times: Some(v1::RecordedTimes {
            steps: times.steps,
            stage_ns: times.stage_ns.to_vec(),
            total_ns: times.total_ns,
            max_ns: times.max_ns,
            solver_iterations: times.solver_iterations,
        }),
    }
}

/// A state as viewers see it.
///
/// # Errors
/// What is wrong with it.
pub fn view_state(recorded: &v1::RecordedState, energy: &v1::EnergyLedger) -> Result<ViewState> {
    let adapted = |body: &v1::RecordedBody| {
        let offsets_m = arrays(&body.adapted_offsets_m)?;
        ensure!(offsets_m.len() == body.adapted_vertex_ids.len(), "as many offsets as adapted vertices are needed");
        let vertex = |(&id, offset_m)| AdaptedVertex { id, offset_m, on_blade: false };
        Ok(body.adapted_vertex_ids.iter().zip(offsets_m).map(vertex).collect())
    };
    let times = recorded.times.clone().unwrap_or_default();
    let mut stage_ns = StepTimes::default().stage_ns;
    stage_ns.iter_mut().zip(&times.stage_ns).for_each(|(into, from)| *into = *from);
    let mut state = ViewState::default();
    state.topology_version = recorded.topology_version;
    state.step = recorded.step;
    state.sim_time_s = recorded.sim_time_s;
    state.late_steps = recorded.late_steps;
    state.node_displacements_m = recorded.bodies.iter().map(|body| body.node_displacements_m.clone()).collect();
    state.adapted = recorded.bodies.iter().map(adapted).collect::<Result<_>>()?;
    state.tools = recorded.tools.iter().map(tool_output).collect::<Result<_>>()?;
    state.energy = energy_step(energy);
    state.times = StepTimes {
        steps: times.steps,
        stage_ns,
        total_ns: times.total_ns,
        max_ns: times.max_ns,
        solver_iterations: times.solver_iterations,
    };
    Ok(state)
}

fn tool_output(recorded: &v1::RecordedTool) -> Result<ToolOutput> {
    let mut tool = ToolOutput { cutting_length_m: recorded.cutting_length_m, ..ToolOutput::default() };
    if let Some(place) = &recorded.place {
        let (pose, opening) = pose_of(place)?;
        (tool.pose, tool.opening) = (Some(pose), opening);
    }
    let vector = |v: Option<v1::Vec3>| v.map_or(Vec3::zeros(), |v| Vec3::new(v.x.into(), v.y.into(), v.z.into()));
    let felt = recorded.wrench.unwrap_or_default();
    (tool.wrench.force_n, tool.wrench.torque_nm) = (vector(felt.force_n), vector(felt.torque_nm));
    if recorded.is_holding {
        tool.grasp = Grasp::Holding;
    }
    Ok(tool)
}

fn energy_step(energy: &v1::EnergyLedger) -> EnergyStep {
    EnergyStep {
        tool_work_j: energy.tool_work_j,
        load_work_j: energy.load_work_j,
        elastic_j: energy.elastic_j,
        contact_j: energy.contact_j,
        kinetic_j: energy.kinetic_j,
        fracture_j: energy.fracture_j,
        front_slip_j: energy.front_slip_j,
        initiation_j: energy.initiation_j,
        parting_j: energy.parting_j,
        damping_j: energy.damping_j,
        friction_j: energy.friction_j,
        contact_loss_j: energy.contact_loss_j,
        numerical_j: energy.numerical_j,
        residual_j: energy.residual_j,
    }
}

/// A keyframe.
///
/// # Errors
/// What is wrong with it.
pub fn keyframe(recorded: &v1::Keyframe) -> Result<Keyframe> {
    Ok(Keyframe {
        topology_version: recorded.topology_version,
        bodies: recorded.bodies.iter().map(body).collect::<Result<_>>()?,
        surface_hash: recorded.surface_hash,
    })
}

/// A patch.
///
/// # Errors
/// What is wrong with it.
pub fn patch(recorded: &v1::TopologyPatch) -> Result<TopologyPatch> {
    Ok(TopologyPatch {
        from_version: recorded.from_version,
        to_version: recorded.to_version,
        bodies: recorded.bodies.iter().map(body).collect::<Result<_>>()?,
        surface_hash: recorded.surface_hash,
    })
}

fn body(recorded: &v1::BodyStructure) -> Result<BodyStructure> {
    let node = |(&id, rest_m)| LatticeNode { id, rest_m };
    let element = |(&id, nodes)| LatticeElement { id, nodes };
    let quad = |(&id, vertices)| BoundQuad { id, vertices };
    let materials = recorded.vertex_materials.iter().copied().chain(std::iter::repeat(0));
    let bound = |(((&id, &element), local), material): (((&u32, &u32), [f32; 3]), u32)| BoundVertex {
        id,
        element,
        local,
        material: material as u16,
    };
    let held = |(&id, weights)| HeldVertex { id, weights };
    let vertices = recorded.vertex_ids.iter().zip(&recorded.vertex_elements).zip(arrays(&recorded.vertex_local)?);
    Ok(BodyStructure {
        nodes: recorded.node_ids.iter().zip(arrays(&recorded.node_rest_m)?).map(node).collect(),
        elements: recorded.element_ids.iter().zip(arrays(&recorded.element_nodes)?).map(element).collect(),
        vertices: vertices.zip(materials).map(bound).collect(),
        held: recorded.held_vertex_ids.iter().zip(arrays(&recorded.held_vertex_weights)?).map(held).collect(),
        quads: recorded.quad_ids.iter().zip(arrays(&recorded.quad_vertices)?).map(quad).collect(),
        node_count: recorded.node_count,
    })
}

/// An event that a recording has; `None` for one that nobody who watches or follows it needs.
pub fn event(recorded: &v1::Event) -> Option<ViewEvent> {
    let event = match recorded.kind() {
        v1::EventKind::Reset => SceneEvent::Reset,
        v1::EventKind::CheckpointSaved => SceneEvent::CheckpointSaved(Arc::from(recorded.checkpoint_name.as_str())),
        v1::EventKind::CheckpointRestored => {
            SceneEvent::CheckpointRestored(Arc::from(recorded.checkpoint_name.as_str()))
        }
        v1::EventKind::CheckpointUploaded => {
            SceneEvent::CheckpointUploaded(Arc::from(recorded.checkpoint_name.as_str()))
        }
        v1::EventKind::ToolTaken => SceneEvent::ToolTaken(recorded.tool_id as usize),
        v1::EventKind::ToolReleased => SceneEvent::ToolReleased(recorded.tool_id as usize),
        v1::EventKind::Overloaded => SceneEvent::Overloaded(recorded.late_share),
        v1::EventKind::ToleranceChanged => SceneEvent::ToleranceChanged(recorded.relative_tolerance),
        v1::EventKind::Unsolved => SceneEvent::Unsolved(Shortfall {
            steps: recorded.unsolved_steps,
            relative_residual: recorded.relative_residual,
            unsettled_n_s: recorded.unsettled_n_s,
        }),
        v1::EventKind::PutAway => SceneEvent::PutAway(recorded.piece_count),
        _ => return None,
    };
    Some(ViewEvent { step: recorded.step, event })
}

/// Numbers in groups of so many.
fn arrays<T: Copy, const N: usize>(numbers: &[T]) -> Result<Vec<[T; N]>> {
    let (groups, rest) = numbers.as_chunks::<N>();
    ensure!(rest.is_empty(), "{} numbers are not groups of {N}", numbers.len());
    Ok(groups.to_vec())
}
