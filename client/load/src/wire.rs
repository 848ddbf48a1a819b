//! Between the script's poses and the wire's, and checks of what comes in.

use anyhow::Context;
use kerf_proto::v1;
use nalgebra::Vector3;

use kerf_script::Pose;

/// Bytes that gRPC puts before each message: one flag, four of length.
pub const FRAME_BYTES: u64 = 5;

/// A pose as it is sent.
#[must_use]
pub fn pose_to_wire(pose: &Pose) -> v1::Pose {
    let (position_m, orientation) = (&pose.position_m, pose.orientation.quaternion());
    v1::Pose {
        position_m: Some(v1::Vec3 { x: position_m.x as f32, y: position_m.y as f32, z: position_m.z as f32 }),
        orientation: Some(v1::Quat {
            x: orientation.i as f32,
            y: orientation.j as f32,
            z: orientation.k as f32,
            w: orientation.w as f32,
        }),
    }
}

/// A required vector; `field` names it in the error.
///
/// # Errors
/// The vector is absent or not finite.
pub fn vector(vector: Option<v1::Vec3>, field: &str) -> anyhow::Result<Vector3<f64>> {
    let v1::Vec3 { x, y, z } = vector.with_context(|| format!("{field} is missing"))?;
    let vector = Vector3::new(f64::from(x), f64::from(y), f64::from(z));
    anyhow::ensure!(vector.iter().all(|c| c.is_finite()), "{field} is not finite");
    Ok(vector)
}
