//! Between the values of the sessions and the messages of the wire.

pub mod contact;
pub mod scene;
pub mod view;

use kerf_physics::fault::{Fault, FaultKind};
use kerf_physics::step_io::Wrench;
use kerf_physics::tool::Pose;
use kerf_physics::{Quat, Vec3};
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

pub fn wrench(wrench: &Wrench) -> v1::Wrench {
    v1::Wrench { force_n: Some(vec3(&wrench.force_n)), torque_nm: Some(vec3(&wrench.torque_nm)) }
}

pub fn fault(fault: &Fault) -> v1::Fault {
    let kind = match fault.what {
        FaultKind::NodeState => v1::FaultKind::NodeState,
        FaultKind::ToolWrench => v1::FaultKind::ToolWrench,
    };
    v1::Fault { step: fault.step, object: fault.object.clone(), kind: kind.into() }
}
