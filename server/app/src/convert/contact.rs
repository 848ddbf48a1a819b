//! Poses in, contacts out.

use kerf_physics::OPEN;
use kerf_physics::step_io::{ContactModel, Grasp, ToolOutput};
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

/// Over this share of the time between two contacts a station goes over from one model to the next: most of what the
/// older one was wrong by is gone before the next comes, and at 60 Hz no force jumps within 4 ms.
const BLENDED_SHARE: f64 = 0.25;

/// What a tool feels, as message `number` of its stream, of which `rate_hz` come a second. The echo is that of
/// `driver`'s own poses.
pub fn contact(
    report: &StepReport,
    tool: usize,
    driver: DriverId,
    (number, rate_hz): (u64, f64),
    flags: u32,
) -> v1::Contact {
    let of_tool = report.tools.get(tool).copied().unwrap_or_default();
    let echo = of_tool.echo.filter(|echo| echo.driver == driver);
    let felt = felt((report.step, report.sim_time_s), tool, (&of_tool.output, of_tool.waits), BLENDED_SHARE / rate_hz);
    v1::Contact {
        echo_seq: echo.map_or(0, |echo| echo.seq),
        echo_ns: echo.map_or(0, |echo| echo.client_ns),
        flags: flags | felt.flags,
        number,
        server_ns: report.ended_ns,
        lag_ns: report.lag_ns,
        echo_arrived_ns: echo.map_or(0, |echo| echo.arrived_ns),
        ..felt
    }
}

/// The same for a client that renders no forces from models: where the tool is in the place of its model.
pub fn without_model(contact: v1::Contact, report: &StepReport) -> v1::Contact {
    let placed = report.tools.get(contact.tool_id as usize).and_then(|of_tool| of_tool.output.pose);
    v1::Contact { model: None, reference: placed.as_ref().map(pose), ..contact }
}

/// What a tool feels after a step, whoever is told of it, and whether it waits until it is clear of tissue; over
/// `blend_time_s` a station goes over to its model.
pub fn felt(
    (step, sim_time_s): (u64, f64),
    tool: usize,
    (output, waits): (&ToolOutput, bool),
    blend_time_s: f64,
) -> v1::Contact {
    let lifted = if output.pose.is_none() { v1::ContactFlag::Lifted as u32 } else { 0 };
    let waits = if waits { v1::ContactFlag::WaitsUntilClear as u32 } else { 0 };
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
        model: output.contact.as_ref().map(|model| contact_model(model, blend_time_s)),
        cutting_length_m: output.cutting_length_m as f32,
        flags: lifted | waits | grasp,
        ..v1::Contact::default()
    }
}

/// The 21 entries of the upper triangle, row by row.
fn upper_triangle(matrix: &[[f64; 6]; 6]) -> Vec<f32> {
    (0..6).flat_map(|row| matrix[row][row..].iter().map(|value| *value as f32)).collect()
}

fn contact_model(model: &ContactModel, blend_time_s: f64) -> v1::ContactModel {
    let damping_n_s_per_m = (0..3).map(|i| model.damping[i][i]).sum::<f64>() / 3.0;
    v1::ContactModel {
        reference: Some(pose(&model.reference)),
        stiffness: upper_triangle(&model.stiffness),
        damping_n_s_per_m: damping_n_s_per_m as f32,
        force_cap_n: model.force_cap_n.map(|force_n| force_n as f32),
        cap_direction: model.force_cap_n.map(|_| vec3(&model.cap_direction)),
        validity_radius_m: model.validity_radius_m as f32,
        damping: upper_triangle(&model.damping),
        velocity_m_per_s: Some(vec3(&model.velocity_m_per_s)),
        angular_velocity_rad_per_s: Some(vec3(&model.angular_velocity_rad_per_s)),
        blend_time_s: blend_time_s as f32,
        gives_at_n: model.give.map(|give| give.at_n as f32),
        force_cap_given_n: model.give.map_or(0.0, |give| give.cap_n as f32),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::Pose;
    use kerf_physics::step_io::Give;

    #[test]
    fn stiffness_travels_as_its_upper_triangle_row_by_row() {
        let mut stiffness = [[0.0; 6]; 6];
        for (row, values) in stiffness.iter_mut().enumerate() {
            for (column, value) in values.iter_mut().enumerate() {
                *value = (row.min(column) * 10 + row.max(column)) as f64;
            }
        }
        let damping = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { i as f64 } else { 0.0 }));
        let model = ContactModel { stiffness, damping, ..ContactModel::default() };
        let sent = contact_model(&model, 0.004);
        assert_eq!((sent.stiffness.len(), sent.damping.len()), (21, 21));
        assert_eq!(sent.stiffness[..8], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 11.0, 12.0]);
        assert_eq!((sent.damping_n_s_per_m, sent.damping[6], sent.blend_time_s), (1.0, 1.0, 0.004));
        assert_eq!((sent.force_cap_n, sent.cap_direction, sent.gives_at_n), (None, None, None));
        let give = Some(Give { at_n: 1.75, cap_n: 1.0 });
        let sent = contact_model(&ContactModel { force_cap_n: Some(2.0), give, ..model }, 0.004);
        assert_eq!((sent.force_cap_n, sent.gives_at_n, sent.force_cap_given_n), (Some(2.0), Some(1.75), 1.0));
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
