//! Scenes, limits and sessions as clients are told of them.

use kerf_physics::Stage;
use kerf_physics::making::{Making, MakingStage};
use kerf_physics::scene::{BladeDesc, CapsuleDesc, DialDesc, ObjectDesc, ToolDesc, ToolShapeDesc};
use kerf_physics::step_io::EnergyStep;
use kerf_physics::world::ObjectStats;
use kerf_proto::v1;
use kerf_scenes::dial::{Choice, FinerRegions};
use kerf_session::{CheckpointInfo, Phase, Session, SessionStatus, Watched};

use super::vec3;
use crate::config::ControlLimits;
use crate::status::RequestError;

pub fn scene_summary(session: &Session) -> v1::SceneSummary {
    let desc = &session.scene().desc;
    let stiffest_pa = desc.stiffest_pa();
    let stats = session.object_stats().iter().copied().map(Some).chain(std::iter::repeat(None));
    v1::SceneSummary {
        name: desc.name.clone(),
        description: desc.description.clone(),
        dt_s: 1.0 / desc.rate_hz,
        objects: desc.objects.iter().zip(stats).map(|(object, stats)| object_summary(object, stats)).collect(),
        tools: desc.tools.iter().map(|tool| tool_summary(tool, stiffest_pa)).collect(),
        tracked_point_names: desc.tracked_points.iter().map(|point| point.name.clone()).collect(),
        stage_names: Stage::ALL.iter().map(|stage| stage.name().into()).collect(),
    }
}

fn object_summary(object: &ObjectDesc, stats: Option<ObjectStats>) -> v1::ObjectSummary {
    let stats = stats.unwrap_or_default();
    let corner = |[x, y, z]: [f64; 3]| Some(v1::Vec3 { x: x as f32, y: y as f32, z: z as f32 });
    v1::ObjectSummary {
        name: object.name.clone(),
        rest_min_m: corner(stats.rest_min_m),
        rest_max_m: corner(stats.rest_max_m),
        fracture_energy_j_per_m2: object.material.fracture_energy_j_per_m2,
        young_modulus_pa: object.material.young_modulus_pa,
        voxel_size_m: stats.voxel_size_m,
        voxels: stats.voxels,
        composite_elements: stats.composite_elements,
        left_out_pieces: stats.left_out.pieces,
        left_out_voxels: stats.left_out.voxels,
        material_names: std::iter::once(&object.name).chain(object.regions.iter().map(|r| &r.name)).cloned().collect(),
        material_colors: object
            .materials()
            .map(|material| material.color.map(Into::into).unwrap_or_default())
            .collect(),
    }
}

fn capsule(capsule: &CapsuleDesc) -> v1::ProbeSummary {
    v1::ProbeSummary { radius_m: capsule.radius_m, length_m: capsule.length_m }
}

fn tool_summary(tool: &ToolDesc, stiffest_pa: f64) -> v1::ToolSummary {
    use v1::tool_summary::Kind;
    let handle = tool.shape.handle().map(capsule);
    let kind = match &tool.shape {
        ToolShapeDesc::Blade(blade) => Kind::Blade(v1::BladeSummary {
            width_m: blade.width_m,
            height_m: blade.height_m,
            thickness_m: blade.thickness_m,
            edge_m: edge_m(blade),
            handle,
        }),
        ToolShapeDesc::Grasper(grasper) => {
            let max_force_n = Some(grasper.slips_above_n(stiffest_pa));
            Kind::Grasper(v1::GrasperSummary { radius_m: grasper.radius_m, max_force_n, handle })
        }
        ToolShapeDesc::Probe(probe) => Kind::Probe(capsule(probe)),
        ToolShapeDesc::Scissors(scissors) => Kind::Scissors(v1::ScissorsSummary {
            blade_length_m: scissors.blade_length_m,
            blade_height_m: scissors.blade_height_m,
            max_angle_rad: scissors.max_angle_rad,
            thickness_m: scissors.thickness_m,
            handle,
        }),
    };
    v1::ToolSummary { name: tool.name.clone(), kind: Some(kind) }
}

/// Points of an edge, xyz interleaved: the edge of a scene that runs has its points.
fn edge_m(blade: &BladeDesc) -> Vec<f32> {
    let points_m = blade.edge.points_m(blade.width_m).unwrap_or_default();
    points_m.iter().flat_map(|point| [point.x as f32, point.y as f32, point.z as f32]).collect()
}

pub fn limits(session: &Session, control: &ControlLimits) -> v1::Limits {
    let limits = session.limits();
    let extent_m = limits.pose.workspace_half_extent_m as f32;
    v1::Limits {
        max_pose_rate_hz: control.max_pose_rate_hz,
        default_contact_rate_hz: control.default_contact_rate_hz,
        max_contact_rate_hz: control.max_contact_rate_hz,
        max_view_rate_hz: limits.view_rate_hz,
        max_tool_speed_m_per_s: limits.pose.max_speed_m_per_s,
        workspace_min_m: Some(v1::Vec3 { x: -extent_m, y: -extent_m, z: -extent_m }),
        workspace_max_m: Some(v1::Vec3 { x: extent_m, y: extent_m, z: extent_m }),
        lease_s: limits.lease_s,
        max_rejected_poses_in_a_row: control.max_rejected_in_a_row,
        max_contact_age_s: control.max_contact_age_s,
    }
}

pub fn state(phase: &Phase) -> v1::SessionState {
    match phase {
        Phase::Running => v1::SessionState::Running,
        Phase::Paused => v1::SessionState::Paused,
        Phase::Failed { .. } => v1::SessionState::Failed,
        Phase::Closing => v1::SessionState::Closing,
    }
}

pub fn session_info(session: &Session, journal: Option<v1::Journal>) -> v1::SessionInfo {
    v1::SessionInfo {
        session_id: session.id().to_string(),
        scene_name: session.scene().desc.name.clone(),
        state: state(&session.phase()).into(),
        is_replay: session.is_replay(),
        vitals: Some(session_vitals(session)),
        journal,
    }
}

fn session_vitals(session: &Session) -> v1::SessionVitals {
    let Watched { done, viewers, drivers, hangs, .. } = session.watched();
    v1::SessionVitals {
        step_rate_hz: session.scene().desc.rate_hz,
        steps: done.steps,
        late_steps: done.late_steps,
        busy_s: done.busy_ns as f64 * 1e-9,
        longest_step_s: done.longest_step_ns as f64 * 1e-9,
        viewers: viewers as u32,
        drivers: drivers as u32,
        faults: done.faults,
        parted_links: done.parted_links,
        memory_bytes: session.memory_bytes() as u64,
        hangs,
    }
}

pub fn session_description(
    session: &Session,
    status: &SessionStatus,
    control: &ControlLimits,
    (recording, journal): (Option<v1::Recording>, Option<v1::Journal>),
) -> v1::SessionDescription {
    let failure = status.phase.failure().unwrap_or_default().to_owned();
    v1::SessionDescription {
        session_id: session.id().to_string(),
        state: state(&status.phase).into(),
        scene: Some(scene_summary(session)),
        limits: Some(limits(session, control)),
        step: status.step,
        sim_time_s: status.sim_time_s,
        topology_version: status.topology_version,
        late_steps: status.late_steps,
        viewers: session.viewers() as u32,
        leased_tool_ids: session.held_tools().into_iter().map(|tool| tool as u32).collect(),
        energy: Some(energy_ledger(&status.energy)),
        tracked_displacements_m: status.tracked_displacement_m.iter().map(vec3).collect(),
        state_hash: status.state_hash,
        failure,
        load: session.load(),
        memory_bytes: session.memory_bytes() as u64,
        recording,
        journal,
        private: session.owner().is_some_and(|owner| owner.is_private),
        dial: session.dial().map(dial_choice),
        relative_tolerance: status.relative_tolerance,
    }
}

/// A checkpoint that a session can go back to.
pub fn checkpoint(checkpoint: CheckpointInfo) -> v1::Checkpoint {
    v1::Checkpoint { name: checkpoint.name, step: checkpoint.step, sim_time_s: checkpoint.sim_time_s }
}

/// What a client asks of the dial.
pub fn dial(asked: v1::create_session_request::Dial) -> Result<DialDesc, RequestError> {
    use v1::create_session_request::Dial;
    let positive = |field: &'static str, value: f64| match value.is_finite() && value > 0.0 {
        true => Ok(value),
        false => Err(RequestError::Dial { field, value }),
    };
    Ok(match asked {
        // A level that no scene has is refused with the scene.
        Dial::Level(level) => DialDesc::Level(u8::try_from(level).unwrap_or(u8::MAX)),
        Dial::BudgetMs(ms) => DialDesc::BudgetMs(positive("budget_ms", ms)?),
        Dial::MaxError(error) => DialDesc::MaxError(positive("max_error", error)?),
    })
}

fn dial_choice(choice: &Choice) -> v1::DialChoice {
    let setting = choice.setting.map(|setting| v1::DialSetting {
        level: u32::from(setting.level),
        voxel_scale: setting.voxel_scale,
        relative_tolerance: setting.relative_tolerance,
        element: setting.element.name().into(),
        has_finer_regions: setting.finer == FinerRegions::Stated,
    });
    let expected = choice.expected.map(|point| v1::DialExpectation {
        median_ms: point.median_ms,
        p99_ms: point.p99_ms,
        displacement_error: point.displacement_rms_error,
        force_error: point.force_rms_error,
        hardware: choice.hardware.clone(),
    });
    v1::DialChoice { setting, expected }
}

pub fn energy_ledger(energy: &EnergyStep) -> v1::EnergyLedger {
    v1::EnergyLedger {
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

/// How far a scene is; `None`: it is being read.
pub fn making_progress(making: Option<Making>) -> v1::MakingProgress {
    let Some(Making { object, objects, stage, voxels, elements, share }) = making else {
        return v1::MakingProgress { stage: v1::MakingStage::Reading.into(), ..Default::default() };
    };
    let stage = match stage {
        MakingStage::Voxels => v1::MakingStage::Voxels,
        MakingStage::Elements => v1::MakingStage::Elements,
        MakingStage::Solver => v1::MakingStage::Solver,
        MakingStage::Equilibrium => v1::MakingStage::Equilibrium,
    };
    v1::MakingProgress {
        stage: stage.into(),
        object: object as u32,
        objects: objects as u32,
        voxels: voxels as u64,
        composite_elements: elements as u64,
        share: share as f32,
    }
}
