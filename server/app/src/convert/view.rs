//! Structure and events as viewers get them, and of a state what is no displacement.

use kerf_physics::step_io::{Grasp, ToolOutput};
use kerf_physics::surface::delta::{BodyStructure, Keyframe, TopologyPatch};
use kerf_proto::v1;
use kerf_proto::v1::view_response::Message;
use kerf_session::{SceneEvent, Shortfall, StepTimes, ViewEvent, ViewState};

use super::scene::energy_ledger;
use super::{fault, pose, wrench};

/// A keyframe as it goes over the wire, with the unit of each object's displacements.
#[must_use]
pub fn keyframe(keyframe: &Keyframe, quanta_m: &[f64]) -> v1::Keyframe {
    let bodies = keyframe.bodies.iter().zip(quanta_m);
    v1::Keyframe {
        topology_version: keyframe.topology_version,
        bodies: bodies.map(|(whole, quantum_m)| v1::BodyStructure { quantum_m: *quantum_m, ..body(whole) }).collect(),
        surface_hash: keyframe.surface_hash,
        encoding: v1::SurfaceEncoding::Lattice.into(),
    }
}

/// A patch as it goes over the wire.
#[must_use]
pub fn patch(patch: &TopologyPatch) -> v1::TopologyPatch {
    v1::TopologyPatch {
        from_version: patch.from_version,
        to_version: patch.to_version,
        bodies: patch.bodies.iter().map(body).collect(),
        surface_hash: patch.surface_hash,
    }
}

fn body(body: &BodyStructure) -> v1::BodyStructure {
    v1::BodyStructure {
        node_count: body.node_count,
        node_ids: body.nodes.iter().map(|node| node.id).collect(),
        node_rest_m: body.nodes.iter().flat_map(|node| node.rest_m).collect(),
        element_ids: body.elements.iter().map(|element| element.id).collect(),
        element_nodes: body.elements.iter().flat_map(|element| element.nodes).collect(),
        vertex_ids: body.vertices.iter().map(|vertex| vertex.id).collect(),
        vertex_elements: body.vertices.iter().map(|vertex| vertex.element).collect(),
        vertex_materials: vertex_materials(body),
        vertex_local: body.vertices.iter().flat_map(|vertex| vertex.local).collect(),
        held_vertex_ids: body.held.iter().map(|vertex| vertex.id).collect(),
        held_vertex_weights: body.held.iter().flat_map(|vertex| vertex.weights).collect(),
        quad_ids: body.quads.iter().map(|quad| quad.id).collect(),
        quad_vertices: body.quads.iter().flat_map(|quad| quad.vertices).collect(),
        quantum_m: 0.0,
    }
}

/// Nothing for an object of one material.
fn vertex_materials(body: &BodyStructure) -> Vec<u32> {
    match body.vertices.iter().all(|vertex| vertex.material == 0) {
        true => Vec::new(),
        false => body.vertices.iter().map(|vertex| u32::from(vertex.material)).collect(),
    }
}

/// A state but for where the objects are, with energies.
pub fn state_without_bodies(state: &ViewState) -> v1::State {
    v1::State {
        topology_version: state.topology_version,
        step: state.step,
        sim_time_s: state.sim_time_s,
        tools: state.tools.iter().map(tool_state).collect(),
        late_steps: state.late_steps,
        profile: Some(profile(&state.times)),
        energy: Some(energy_ledger(&state.energy)),
        ..v1::State::default()
    }
}

fn tool_state(tool: &ToolOutput) -> v1::ToolState {
    v1::ToolState {
        pose: tool.pose.as_ref().map(pose),
        wrench: Some(wrench(&tool.wrench)),
        cutting_length_m: tool.cutting_length_m as f32,
        opening: tool.opening as f32,
        is_holding: tool.grasp == Grasp::Holding,
    }
}

fn profile(times: &StepTimes) -> v1::StepProfile {
    let steps = f64::from(times.steps.max(1));
    let mean_s = |sum_ns: u64| (sum_ns as f64 * 1e-9 / steps) as f32;
    v1::StepProfile {
        steps: times.steps,
        stage_mean_s: times.stage_ns.iter().copied().map(mean_s).collect(),
        step_mean_s: mean_s(times.total_ns),
        step_max_s: (times.max_ns as f64 * 1e-9) as f32,
        solver_iterations_mean: (times.solver_iterations as f64 / steps) as f32,
    }
}

/// What happened, as viewers are told.
pub fn event(happened: &ViewEvent) -> Message {
    let of = |kind: v1::EventKind| v1::Event { step: happened.step, kind: kind.into(), ..v1::Event::default() };
    Message::Event(match happened.event {
        SceneEvent::Fault(ref found) => return Message::Fault(fault(found)),
        SceneEvent::Paused => of(v1::EventKind::Paused),
        SceneEvent::Resumed => of(v1::EventKind::Resumed),
        SceneEvent::Reset => of(v1::EventKind::Reset),
        SceneEvent::Closing => of(v1::EventKind::Closing),
        SceneEvent::Failed => of(v1::EventKind::Failed),
        SceneEvent::Reanchored => of(v1::EventKind::Reanchored),
        SceneEvent::Overloaded(late_share) => v1::Event { late_share, ..of(v1::EventKind::Overloaded) },
        SceneEvent::ToolTaken(tool) => v1::Event { tool_id: tool as u32, ..of(v1::EventKind::ToolTaken) },
        SceneEvent::ToolReleased(tool) => v1::Event { tool_id: tool as u32, ..of(v1::EventKind::ToolReleased) },
        SceneEvent::CheckpointSaved(ref name) => {
            v1::Event { checkpoint_name: name.to_string(), ..of(v1::EventKind::CheckpointSaved) }
        }
        SceneEvent::CheckpointRestored(ref name) => {
            v1::Event { checkpoint_name: name.to_string(), ..of(v1::EventKind::CheckpointRestored) }
        }
        SceneEvent::CheckpointUploaded(ref name) => {
            v1::Event { checkpoint_name: name.to_string(), ..of(v1::EventKind::CheckpointUploaded) }
        }
        SceneEvent::Unsolved(Shortfall { steps, relative_residual, unsettled_n_s }) => {
            v1::Event { unsolved_steps: steps, relative_residual, unsettled_n_s, ..of(v1::EventKind::Unsolved) }
        }
        SceneEvent::PutAway(piece_count) => v1::Event { piece_count, ..of(v1::EventKind::PutAway) },
        SceneEvent::ToleranceChanged(relative_tolerance) => {
            v1::Event { relative_tolerance, ..of(v1::EventKind::ToleranceChanged) }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_of_no_steps_divides_by_nothing() {
        let profile = profile(&StepTimes::default());
        assert_eq!((profile.steps, profile.step_mean_s), (0, 0.0));
    }

    #[test]
    fn a_profile_is_a_mean_in_seconds() {
        let times = StepTimes { steps: 4, total_ns: 8_000_000, max_ns: 5_000_000, ..StepTimes::default() };
        let profile = profile(&times);
        assert!((profile.step_mean_s - 2e-3).abs() < 1e-9 && (profile.step_max_s - 5e-3).abs() < 1e-9);
    }
}
