//! Scissors: two edges that pivot.
//!
//! Tool frame: origin = reference point = pivot, +x from there along the closed blades to their tips, +z the
//! pivot's axis. One edge comes down from +y, the other one up from -y, by half of the angle each.

use super::blade::Blade;
use super::pose::Pose;
use crate::scene::{BladeDesc, SceneError, ScissorsDesc};
use crate::{Quat, Vec3};
use serde::{Deserialize, Serialize};

/// Angle by which closed blades have crossed, rad: as real ones do, and the last of the tissue between them
/// would hold the front's compression otherwise.
const CROSSED_RAD: f64 = 0.1;

/// Two equal blades on a pivot.
#[derive(Clone, Debug, PartialEq)]
pub struct Scissors {
    /// Either blade; its edge begins at the pivot.
    pub blade: Blade,
    /// Angle between the blades where they are fully open, rad.
    pub max_angle_rad: f64,
}

impl Scissors {
    /// The scissors that a scene describes.
    ///
    /// # Errors
    /// Blades without length.
    pub fn new(desc: &ScissorsDesc) -> Result<Self, SceneError> {
        let blade = BladeDesc {
            edge_half_width_m: desc.edge_half_width_m,
            thickness_m: desc.thickness_m,
            // They cut between their edges.
            sharp_ends: false,
            ..BladeDesc::straight(desc.blade_length_m, desc.blade_height_m)
        };
        Ok(Self { blade: Blade::new(&blade)?, max_angle_rad: desc.max_angle_rad })
    }

    /// How the two blades are mounted.
    #[must_use]
    pub(crate) fn mounts(&self) -> [Mount; 2] {
        let [length_m, max_angle_rad] = [self.blade.edge.length_m(), self.max_angle_rad];
        [Side::Upper, Side::Lower].map(|side| Mount::Hinged { side, length_m, max_angle_rad })
    }
}

/// Which blade of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// Cuts towards -y.
    Upper,
    /// Cuts towards +y.
    Lower,
}

/// How an edge is mounted on its tool.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Mount {
    /// It is the tool's own edge.
    Fixed,
    /// One of the two edges that turn about the tool's z axis.
    Hinged {
        /// Which of them.
        side: Side,
        /// Length of the edge, m.
        length_m: f64,
        /// Angle between the two where they are fully open, rad.
        max_angle_rad: f64,
    },
}

impl Mount {
    /// Pose of the edge of a tool at `pose` whose jaws take the fraction `opening` of their full opening.
    #[must_use]
    pub(crate) fn edge_pose(&self, pose: &Pose, opening: f64) -> Pose {
        let Self::Hinged { side, length_m, max_angle_rad } = *self else { return *pose };
        let half_rad = 0.5 * (opening * (max_angle_rad + CROSSED_RAD) - CROSSED_RAD);
        let (turn, along) = match side {
            Side::Upper => (about_z(half_rad), Vec3::x()),
            // Half a turn about z: it cuts the other way, and its normal is the other blade's, so that both
            // cut the same plane.
            Side::Lower => {
                (about_z(-half_rad) * Quat::new_unchecked(nalgebra::Quaternion::new(0.0, 0.0, 0.0, 1.0)), -Vec3::x())
            }
        };
        let orientation = pose.orientation * turn;
        Pose { position_m: pose.position_m + orientation * along * (0.5 * length_m), orientation }
    }
}

/// A turn about z, by the vector library's own polynomials: the same bits on every machine.
fn about_z(angle_rad: f64) -> Quat {
    let (sin, cos) = wide::f64x4::splat(0.5 * angle_rad).sin_cos();
    Quat::new_normalize(nalgebra::Quaternion::new(cos.to_array()[0], 0.0, 0.0, sin.to_array()[0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_blades_start_at_the_pivot_and_open_by_half_of_the_angle_each() {
        let scissors = Scissors::new(&ScissorsDesc::new(0.04, 0.01)).unwrap();
        let pose = Pose { position_m: Vec3::new(0.1, 0.2, 0.3), orientation: Quat::from_euler_angles(0.4, 0.5, 0.6) };
        let half = 0.5 * scissors.max_angle_rad;
        for (mount, sign, pivot_at) in [(scissors.mounts()[0], 1.0, -0.02), (scissors.mounts()[1], -1.0, 0.02)] {
            let edge = mount.edge_pose(&pose, 1.0);
            assert!((edge.transform(&Vec3::new(pivot_at, 0.0, 0.0)) - pose.position_m).norm() < 1e-12);
            let tip = pose.to_local(&edge.transform(&Vec3::new(-pivot_at, 0.0, 0.0)));
            assert!((tip - Vec3::new(half.cos(), sign * half.sin(), 0.0) * 0.04).norm() < 1e-12, "{tip:?}");
            // They cut towards each other, in one plane.
            let forward = pose.orientation.inverse_transform_vector(&(edge.orientation * -Vec3::y()));
            assert!((forward - Vec3::new(half.sin(), -sign * half.cos(), 0.0)).norm() < 1e-12, "{forward:?}");
            assert!((edge.orientation * Vec3::z() - pose.orientation * Vec3::z()).norm() < 1e-12);
        }
        let closed = scissors.mounts().map(|mount| pose.to_local(&mount.edge_pose(&pose, 0.0).position_m).y);
        assert!(closed[0] < 0.0 && closed[1] > 0.0, "they have crossed: {closed:?}");
    }
}
