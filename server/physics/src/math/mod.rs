//! Vector types and the few numerical helpers that more than one module needs.

mod aabb;
mod cofactor;

pub use aabb::Aabb;
pub use cofactor::cofactor;

/// A vector or point, `f64`.
pub type Vec3 = nalgebra::Vector3<f64>;
/// A 3x3 matrix, `f64`.
pub type Mat3 = nalgebra::Matrix3<f64>;
/// Force and torque, or translation and rotation, `f64`.
pub type Vec6 = nalgebra::Vector6<f64>;
/// A 6x6 matrix between them, `f64`.
pub type Mat6 = nalgebra::Matrix6<f64>;
/// What six numbers do to a vector, `f64`.
pub type Mat3x6 = nalgebra::Matrix3x6<f64>;
/// Vectors by node.
pub type Nodal = Vec<[f64; 3]>;
/// A unit quaternion; stored xyzw.
pub type Quat = nalgebra::UnitQuaternion<f64>;
