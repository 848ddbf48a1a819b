//! From the device's frame to the scene's and back.

use kerf_script::Pose;
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use crate::config::MappingConfig;
use crate::device::DeviceState;

/// The hand that holds the device, in the scene's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hand {
    /// Where it holds the tool.
    pub pose: Pose,
    /// Of the tool's reference point, m/s.
    pub velocity_m_per_s: Vector3<f64>,
}

/// How a device lies in the scene, and where the clutch has moved it since.
#[derive(Clone, Copy, Debug)]
pub struct Mapping {
    /// From the device's axes to the scene's.
    turn: UnitQuaternion<f64>,
    scale: f64,
    force_scale: f64,
    device_origin_m: Vector3<f64>,
    scene_origin_m: Vector3<f64>,
    tool_orientation: UnitQuaternion<f64>,
    turns_tool: bool,
    /// Where the tool stands while the clutch is pressed.
    stands_at: Option<Pose>,
}

impl Mapping {
    /// As configured; the axes are those of a rotation, which [`crate::config::StationConfig`] has checked.
    #[must_use]
    pub fn new(config: &MappingConfig) -> Self {
        let [roll, pitch, yaw] = config.tool_orientation_rad;
        Self {
            turn: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(config.axes_matrix())),
            scale: config.scale,
            force_scale: config.force_scale,
            device_origin_m: config.device_origin_m.into(),
            scene_origin_m: config.scene_origin_m.into(),
            tool_orientation: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            turns_tool: config.turns_tool,
            stands_at: None,
        }
    }

    /// The hand in the scene's frame. While the clutch is pressed the tool stands, and goes on from there afterwards.
    pub fn hand(&mut self, state: &DeviceState, is_clutched: bool) -> Hand {
        let moved = self.turn * (state.position_m - self.device_origin_m) * self.scale;
        let orientation = match self.turns_tool {
            true => self.turn * state.orientation * self.turn.inverse() * self.tool_orientation,
            false => self.tool_orientation,
        };
        let free = Pose { position_m: self.scene_origin_m + moved, orientation };
        if is_clutched {
            let pose = *self.stands_at.get_or_insert(free);
            return Hand { pose, velocity_m_per_s: Vector3::zeros() };
        }
        if let Some(stood) = self.stands_at.take() {
            self.scene_origin_m = stood.position_m - moved;
        }
        let pose = Pose { position_m: self.scene_origin_m + moved, orientation };
        Hand { pose, velocity_m_per_s: self.turn * state.velocity_m_per_s * self.scale }
    }

    /// A force of the scene in the device's frame.
    #[must_use]
    pub fn force_on_device(&self, force_n: &Vector3<f64>) -> Vector3<f64> {
        self.turn.inverse() * force_n * self.force_scale
    }

    /// Scene metres per metre of the device.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Newtons of the device per newton of the scene.
    #[must_use]
    pub fn force_scale(&self) -> f64 {
        self.force_scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Axis;

    fn state(x: f64, y: f64, z: f64) -> DeviceState {
        DeviceState { position_m: Vector3::new(x, y, z), ..DeviceState::default() }
    }

    /// A device whose z is up, at twice its size and half its force.
    fn config() -> MappingConfig {
        MappingConfig {
            axes: [Axis::X, Axis::Z, Axis::MinusY],
            scale: 2.0,
            force_scale: 0.5,
            device_origin_m: [0.0, 0.0, 0.1],
            scene_origin_m: [0.0, 0.2, 0.0],
            ..MappingConfig::default()
        }
    }

    #[test]
    fn positions_are_turned_scaled_and_moved_and_forces_come_back() {
        let mut mapping = Mapping::new(&config());
        let hand = mapping.hand(&state(0.01, 0.02, 0.13), false);
        assert!((hand.pose.position_m - Vector3::new(0.02, 0.26, -0.04)).norm() < 1e-12, "{hand:?}");
        let force_n = mapping.force_on_device(&Vector3::new(1.0, 2.0, 3.0));
        assert!((force_n - Vector3::new(0.5, -1.5, 1.0)).norm() < 1e-12, "{force_n}");
    }

    #[test]
    fn the_stylus_turns_the_tool_about_the_same_axis() {
        let mut mapping = Mapping::new(&config());
        let about_up = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3);
        let hand = mapping.hand(&DeviceState { orientation: about_up, ..state(0.0, 0.0, 0.0) }, false);
        let expected = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.3);
        assert!(hand.pose.orientation.angle_to(&expected) < 1e-9);
    }

    #[test]
    fn while_clutched_the_tool_stands_and_then_goes_on_from_there() {
        let mut mapping = Mapping::new(&config());
        let before = mapping.hand(&state(0.0, 0.0, 0.1), false).pose.position_m;
        mapping.hand(&state(0.0, 0.0, 0.1), true);
        let during = mapping.hand(&state(0.05, 0.0, 0.1), true);
        assert_eq!((during.pose.position_m, during.velocity_m_per_s), (before, Vector3::zeros()));
        let after = mapping.hand(&state(0.05, 0.0, 0.1), false).pose.position_m;
        assert!((after - before).norm() < 1e-12);
        let on = mapping.hand(&state(0.06, 0.0, 0.1), false).pose.position_m;
        assert!((on - before - Vector3::new(0.02, 0.0, 0.0)).norm() < 1e-12);
    }
}
