//! Between the values of the sessions, the messages of the wire and the poses of scripts.

pub mod contact;
pub mod scene;
pub mod stepping;
pub mod view;

use kerf_physics::fault::{Fault, FaultKind};
use kerf_physics::step_io::Wrench;
use kerf_physics::{Pose, PoseError, Quat, Vec3};
use kerf_proto::v1;

pub fn vec3(v: &Vec3) -> v1::Vec3 {
    v1::Vec3 { x: v.x as f32, y: v.y as f32, z: v.z as f32 }
}

fn quat(q: &Quat) -> v1::Quat {
    v1::Quat { x: q.i as f32, y: q.j as f32, z: q.k as f32, w: q.w as f32 }
}

pub fn pose(pose: &Pose) -> v1::Pose {
    v1::Pose { position_m: Some(vec3(&pose.position_m)), orientation: Some(quat(&pose.orientation)) }
}

/// A pose as it arrived; what is absent is refused as what is not finite.
pub fn pose_from_wire(message: Option<v1::Pose>, length_tolerance: f64) -> Result<Pose, PoseError> {
    let position = message.and_then(|pose| pose.position_m).ok_or(PoseError::PositionNotFinite)?;
    let v1::Quat { x, y, z, w } = message.and_then(|pose| pose.orientation).ok_or(PoseError::OrientationNotFinite)?;
    let position_m = [position.x, position.y, position.z].map(f64::from);
    Pose::from_numbers(position_m, [x, y, z, w].map(f64::from), length_tolerance)
}

/// A pose as scripts and recordings have it; the quaternion keeps its bits.
pub fn pose_from_script(pose: &kerf_script::Pose) -> Pose {
    Pose { position_m: pose.position_m, orientation: pose.orientation }
}

pub fn script_pose(pose: &Pose) -> kerf_script::Pose {
    kerf_script::Pose { position_m: pose.position_m, orientation: pose.orientation }
}

pub fn wrench(wrench: &Wrench) -> v1::Wrench {
    v1::Wrench { force_n: Some(vec3(&wrench.force_n)), torque_nm: Some(vec3(&wrench.torque_nm)) }
}

pub fn fault(fault: &Fault) -> v1::Fault {
    let kind = match fault.what {
        FaultKind::NodeState => v1::FaultKind::NodeState,
        FaultKind::ToolWrench => v1::FaultKind::ToolWrench,
        FaultKind::Energy => v1::FaultKind::Energy,
    };
    v1::Fault { step: fault.step, object: fault.object.clone(), kind: kind.into() }
}
