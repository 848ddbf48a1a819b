//! A gamepad, for people without a haptic device: its sticks move the tool, and no force moves them.
//!
//! Linux's joystick interface: eight bytes an event. No library is needed for that.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::sync::atomic::AtomicBool;

use nalgebra::{UnitQuaternion, Vector3};

use super::{Device, DeviceError, DeviceInfo, DeviceState, Servo, nonblocking, paced, unmoved};
use crate::config::GamepadConfig;

/// Half the box that the tip reaches, m.
const REACH_M: f64 = 0.1;
/// Share of a stick's way about its middle that is nothing: sticks do not come back exactly.
const DEAD_ZONE: f64 = 0.1;
/// Axes by the interface's numbers: the left stick and the right one's second.
const LEFT_RIGHT: u8 = 0;
const NEAR_FAR: u8 = 1;
const DOWN_UP: u8 = 4;
/// Types of events; those of the first state have a further bit.
const BUTTON: u8 = 1;
const AXIS: u8 = 2;

/// A gamepad.
pub struct Gamepad {
    info: DeviceInfo,
    file: File,
    speed_m_per_s: f64,
    position_m: Vector3<f64>,
    /// Of the sticks, -1 to 1.
    tilt: Vector3<f64>,
    buttons: u32,
}

impl Gamepad {
    /// Opens a gamepad.
    ///
    /// # Errors
    /// The file and why it cannot be opened.
    pub fn open(config: &GamepadConfig) -> Result<Self, DeviceError> {
        let name = format!("gamepad {}", config.file.display());
        let file = nonblocking(&config.file, false).map_err(|error| DeviceError {
            device: name.clone(),
            what: format!("cannot be opened: {error}"),
            remedy: "plug it in, set `file` to it (Linux: /dev/input/js*), and see that you may read it".into(),
        })?;
        Ok(Self {
            info: unmoved(name, REACH_M),
            file,
            speed_m_per_s: config.speed_m_per_s,
            position_m: Vector3::zeros(),
            tilt: Vector3::zeros(),
            buttons: 0,
        })
    }

    /// Takes in what happened since the last call.
    fn read(&mut self) -> std::io::Result<()> {
        let mut event = [0; 8];
        loop {
            match self.file.read(&mut event) {
                Ok(8) => self.take(event),
                Ok(_) => return Ok(()),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            }
        }
    }

    fn take(&mut self, [.., low, high, kind, number]: [u8; 8]) {
        let value = i16::from_le_bytes([low, high]);
        let tilt = f64::from(value) / f64::from(i16::MAX);
        let tilt = tilt.signum() * ((tilt.abs() - DEAD_ZONE) / (1.0 - DEAD_ZONE)).clamp(0.0, 1.0);
        match (kind & (BUTTON | AXIS), number) {
            (AXIS, LEFT_RIGHT) => self.tilt.x = tilt,
            (AXIS, NEAR_FAR) => self.tilt.z = tilt,
            // Down is positive there.
            (AXIS, DOWN_UP) => self.tilt.y = -tilt,
            (BUTTON, 0..32) => {
                self.buttons = self.buttons & !(1 << number) | u32::from(value != 0) << number;
            }
            _ => {}
        }
    }

    fn step(&mut self, dt_s: f64) -> DeviceState {
        let before_m = self.position_m;
        let wanted_m = before_m + self.tilt * (self.speed_m_per_s * dt_s);
        self.position_m = wanted_m.map(|x| x.clamp(-REACH_M, REACH_M));
        DeviceState {
            position_m: self.position_m,
            orientation: UnitQuaternion::identity(),
            velocity_m_per_s: (self.position_m - before_m) / dt_s.max(1e-6),
            buttons: self.buttons,
            hold: None,
        }
    }
}

impl Device for Gamepad {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        let mut lost = None;
        paced::run(servo, stop, self.info.rate_hz, |dt_s, _| match self.read() {
            Ok(()) => Some(self.step(dt_s)),
            Err(error) => {
                lost = Some(error);
                None
            }
        });
        lost.map_or(Ok(()), |error| {
            Err(DeviceError {
                device: self.info.name.clone(),
                what: format!("is lost: {error}"),
                remedy: "plug it in again".into(),
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn gamepad(events: &[[u8; 8]]) -> Gamepad {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        events.iter().for_each(|event| file.write_all(event).unwrap());
        let config = GamepadConfig { file: file.path().into(), speed_m_per_s: 0.05 };
        let mut gamepad = Gamepad::open(&config).unwrap();
        gamepad.read().unwrap();
        gamepad
    }

    fn event(kind: u8, number: u8, value: i16) -> [u8; 8] {
        let [low, high] = value.to_le_bytes();
        [1, 2, 3, 4, low, high, kind, number]
    }

    #[test]
    fn sticks_move_the_tip_at_the_speed_as_far_as_it_reaches() {
        // The first state has a further bit in its type.
        let mut gamepad = gamepad(&[event(0x82, LEFT_RIGHT, i16::MAX), event(AXIS, DOWN_UP, -i16::MAX)]);
        let state = (0..1000).map(|_| gamepad.step(1e-3)).last().unwrap();
        assert!((state.position_m - Vector3::new(0.05, 0.05, 0.0)).norm() < 1e-9, "{state:?}");
        assert!((state.velocity_m_per_s - Vector3::new(0.05, 0.05, 0.0)).norm() < 1e-9, "{state:?}");
        let state = (0..5000).map(|_| gamepad.step(1e-3)).last().unwrap();
        assert_eq!((state.position_m.x, state.velocity_m_per_s.x), (REACH_M, 0.0));
    }

    #[test]
    fn a_stick_near_its_middle_moves_nothing() {
        let mut gamepad = gamepad(&[event(AXIS, NEAR_FAR, 3000)]);
        assert_eq!(gamepad.step(1.0).position_m, Vector3::zeros());
    }

    #[test]
    fn buttons_go_down_and_up() {
        let mut gamepad =
            gamepad(&[event(BUTTON, 0, 1), event(BUTTON, 3, 1), event(BUTTON, 0, 0), event(BUTTON, 40, 1)]);
        assert_eq!(gamepad.step(1e-3).buttons, 0b1000);
    }

    #[test]
    fn a_gamepad_that_is_not_there_is_told_with_its_file() {
        let config = GamepadConfig { file: "/nowhere/js0".into(), speed_m_per_s: 0.05 };
        let text = Gamepad::open(&config).err().unwrap().to_string();
        assert!(text.contains("gamepad /nowhere/js0: cannot be opened") && text.contains("plug it in"), "{text}");
    }
}
