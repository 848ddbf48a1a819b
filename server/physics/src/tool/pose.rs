//! Where a tool is: its pose and the opening of its jaws.

use nalgebra::Quaternion;
use serde::{Deserialize, Serialize};

use crate::{Quat, Vec3};

/// Opening of jaws that are open, as a fraction of their full opening. Closed jaws have 0.
pub const OPEN: f64 = 1.0;

/// Why numbers state no pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// The position is missing or not finite.
    #[error("position_m: must be three finite numbers")]
    PositionNotFinite,
    /// The orientation is missing or not finite.
    #[error("orientation: must be four finite numbers")]
    OrientationNotFinite,
    /// The quaternion is no rotation.
    #[error("orientation: the quaternion's length is {length}, must be within {tolerance} of 1")]
    NoRotation {
        /// Its length.
        length: f64,
        /// How far from 1 it may be.
        tolerance: f64,
    },
}

/// Pose of a tool in the scene frame. Tool frame: origin = reference point = middle of the edge,
/// +x along the edge, -y the cutting direction (spine to edge), +z the blade's normal. The reference point of
/// scissors is their pivot, a grasper's the middle of its jaws, a probe's that of its axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Reference point, m.
    pub position_m: Vec3,
    /// Rotation from the tool frame to the scene frame.
    pub orientation: Quat,
}

impl Default for Pose {
    fn default() -> Self {
        Self { position_m: Vec3::zeros(), orientation: Quat::identity() }
    }
}

impl Pose {
    /// The pose that numbers from outside state, the quaternion as xyzw; it is normalised.
    ///
    /// # Errors
    /// A number is not finite, or the quaternion's length is off 1 by more than `length_tolerance`.
    pub fn from_numbers(
        position_m: [f64; 3],
        orientation_xyzw: [f64; 4],
        length_tolerance: f64,
    ) -> Result<Self, PoseError> {
        if !position_m.iter().all(|v| v.is_finite()) {
            return Err(PoseError::PositionNotFinite);
        }
        if !orientation_xyzw.iter().all(|v| v.is_finite()) {
            return Err(PoseError::OrientationNotFinite);
        }
        let quaternion = Quaternion::from(orientation_xyzw);
        let length = quaternion.norm();
        if (length - 1.0).abs() > length_tolerance {
            return Err(PoseError::NoRotation { length, tolerance: length_tolerance });
        }
        let orientation = Quat::new_normalize(quaternion);
        Ok(Self { position_m: position_m.into(), orientation })
    }

    /// Scene position of a point given in the tool frame, m.
    #[must_use]
    pub fn transform(&self, local_m: &Vec3) -> Vec3 {
        self.position_m + self.orientation * local_m
    }

    /// Pose in the scene frame of what has the pose `place` in the tool frame.
    #[must_use]
    pub(crate) fn of_carried(&self, place: &Self) -> Self {
        Self { position_m: self.transform(&place.position_m), orientation: self.orientation * place.orientation }
    }

    /// Tool-frame position of a point given in the scene frame, m.
    #[must_use]
    pub(crate) fn to_local(self, scene_m: &Vec3) -> Vec3 {
        self.orientation.inverse_transform_vector(&(scene_m - self.position_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const AT: [f64; 3] = [0.1, 0.2, 0.3];

    #[test]
    fn numbers_that_state_no_pose_are_refused() {
        let refused = |position_m, xyzw| Pose::from_numbers(position_m, xyzw, 0.01).unwrap_err();
        assert_eq!(refused([0.0, f64::NAN, 0.0], [0.0, 0.0, 0.0, 1.0]), PoseError::PositionNotFinite);
        assert_eq!(refused(AT, [f64::INFINITY, 0.0, 0.0, 1.0]), PoseError::OrientationNotFinite);
        assert_eq!(refused(AT, [0.0, 0.0, 0.0, 0.5]), PoseError::NoRotation { length: 0.5, tolerance: 0.01 });
        assert!(matches!(refused(AT, [1e300; 4]), PoseError::NoRotation { .. }));
    }

    #[test]
    fn a_nearly_unit_quaternion_is_normalised() {
        let pose = Pose::from_numbers(AT, [0.0, 0.0, 0.0, 1.005], 0.01).unwrap();
        assert_eq!(pose, Pose { position_m: AT.into(), orientation: Quat::identity() });
    }

    proptest! {
        #[test]
        fn what_passes_is_finite_and_unit(
            position_m in prop::array::uniform3(prop::num::f64::ANY),
            orientation_xyzw in prop::array::uniform4(prop_oneof![prop::num::f64::ANY, -1.0..1.0]),
        ) {
            if let Ok(pose) = Pose::from_numbers(position_m, orientation_xyzw, 0.01) {
                prop_assert!(pose.position_m.iter().all(|v| v.is_finite()));
                prop_assert!((pose.orientation.norm() - 1.0).abs() < 1e-12);
            }
        }
    }
}
