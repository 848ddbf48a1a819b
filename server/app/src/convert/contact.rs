//! Poses in, contacts out.

use kerf_physics::step_io::{ContactModel, Grasp, ToolOutput};
use kerf_physics::tool::OPEN;
use kerf_proto::v1;
use kerf_session::{DriverId, PoseLimits, PoseRefusal, PoseSample, StepReport};

use super::{pose, pose_from_wire, vec3, wrench};

/// The button that closes the jaws of a tool whose device does not say how far they are open.
const CLOSING_BUTTON: u32 = 1;

/// A pose and the opening of the jaws as they arrived.
pub fn pose_sample(message: &v1::ToolPose, limits: &PoseLimits) -> Result<PoseSample, PoseRefusal> {
    Ok(PoseSample {
        seq: message.seq,
        client_ns: message.client_ns,
        pose: pose_from_wire(message.pose, limits.quaternion_norm_tolerance)?,
        opening: message.opening.map_or(if message.buttons & CLOSING_BUTTON == 0 { OPEN } else { 0.0 }, f64::from),
    })
}

pub fn rejection(tool_id: u32, seq: u64, refusal: &PoseRefusal) -> v1::PoseRejected {
    v1::PoseRejected { tool_id, seq, field: refusal.field().into(), limit: refusal.limit() }
}

/// What a tool feels, as message `number` of its stream. The echo is that of `driver`'s own poses.
pub fn contact(report: &StepReport, tool: usize, driver: DriverId, number: u64, flags: u32) -> v1::Contact {
    let of_tool = report.tools.get(tool).copied().unwrap_or_default();
    let echo = of_tool.echo.filter(|echo| echo.driver == driver);
    let felt = felt(report.step, report.sim_time_s, tool, &of_tool.output);
    v1::Contact {
        echo_seq: echo.map_or(0, |echo| echo.seq),
        echo_ns: echo.map_or(0, |echo| echo.client_ns),
        flags: flags | felt.flags,
        number,
        server_ns: report.ended_ns,
        echo_arrived_ns: echo.map_or(0, |echo| echo.arrived_ns),
        ..felt
    }
}

/// What a tool feels after a step, whoever is told of it.
pub fn felt(step: u64, sim_time_s: f64, tool: usize, output: &ToolOutput) -> v1::Contact {
    let lifted = output.pose.is_none().then_some(v1::ContactFlag::Lifted as u32);
    let grasp = match output.grasp {
        Grasp::Nothing => 0,
        Grasp::Holding => v1::ContactFlag::Holding as u32,
        Grasp::Slipped => v1::ContactFlag::Slipped as u32,
    };
    v1::Contact {
        tool_id: tool as u32,
        step,
        sim_time_s,
        wrench: Some(wrench(&output.wrench)),
        model: output.contact.as_ref().map(contact_model),
        cutting_length_m: output.cutting_length_m as f32,
        flags: lifted.unwrap_or(0) | grasp,
        ..v1::Contact::default()
    }
}

fn contact_model(model: &ContactModel) -> v1::ContactModel {
    let upper_row = |row: usize| model.stiffness[row][row..].iter().map(|value| *value as f32);
    v1::ContactModel {
        reference: Some(pose(&model.reference)),
        stiffness: (0..6).flat_map(upper_row).collect(),
        damping_n_s_per_m: model.damping_n_s_per_m as f32,
        force_cap_n: model.force_cap_n.map(|force_n| force_n as f32),
        cap_direction: model.force_cap_n.map(|_| vec3(&model.cap_direction)),
        validity_radius_m: model.validity_radius_m as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::Vec3;
    use kerf_physics::step_io::Wrench;
    use kerf_physics::tool::Pose;

    #[test]
    fn stiffness_travels_as_its_upper_triangle_row_by_row() {
        let mut stiffness = [[0.0; 6]; 6];
        for (row, values) in stiffness.iter_mut().enumerate() {
            for (column, value) in values.iter_mut().enumerate() {
                *value = (row.min(column) * 10 + row.max(column)) as f64;
            }
        }
        let model = ContactModel {
            reference: Pose::default(),
            wrench: Wrench::default(),
            stiffness,
            damping_n_s_per_m: 1.0,
            force_cap_n: None,
            cap_direction: Vec3::y(),
            validity_radius_m: 0.01,
        };
        let sent = contact_model(&model);
        assert_eq!(sent.stiffness.len(), 21);
        assert_eq!(sent.stiffness[..8], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 11.0, 12.0]);
        assert_eq!((sent.force_cap_n, sent.cap_direction), (None, None));
    }

    #[test]
    fn jaws_follow_the_opening_or_else_the_first_button() {
        let pose = Some(pose(&Pose::default()));
        let opening = |buttons, opening| {
            let message = v1::ToolPose { pose, buttons, opening, ..Default::default() };
            pose_sample(&message, &PoseLimits::default()).unwrap().opening
        };
        assert_eq!([opening(0, None), opening(1, None), opening(2, None)], [1.0, 0.0, 1.0]);
        assert_eq!([opening(1, Some(0.25)), opening(0, Some(0.0))], [0.25, 0.0]);
    }

    #[test]
    fn an_absent_orientation_is_refused_by_its_name() {
        let position_m = Some(v1::Vec3::default());
        let message = v1::ToolPose { pose: Some(v1::Pose { position_m, orientation: None }), ..Default::default() };
        assert_eq!(pose_sample(&message, &PoseLimits::default()).unwrap_err().field(), "pose.orientation");
    }
}
