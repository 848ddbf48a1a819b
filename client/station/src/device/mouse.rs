//! The mouse in a terminal, for people without a haptic device: its pointer moves the tool, and no force moves it.
//!
//! Terminals tell the pointer's cell as text (xterm's modes 1003 and 1006). A cell is coarse, so the tip follows the
//! pointer gently.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::sync::atomic::AtomicBool;

use nalgebra::{UnitQuaternion, Vector3};
use rustix::termios::{LocalModes, OptionalActions, Termios, tcgetattr, tcsetattr};

use super::{Device, DeviceError, DeviceInfo, DeviceState, Servo, nonblocking, paced, unmoved};
use crate::config::MouseConfig;

/// Half the box that the tip reaches, m.
const REACH_M: f64 = 0.1;
/// A cell is about twice as high as wide.
const CELL_ASPECT: f64 = 2.0;
/// Time constant with which the tip follows the pointer, s.
const FOLLOW_S: f64 = 0.05;
/// All motions of the pointer are told, as text; and no more.
const BEGIN: &[u8] = b"\x1b[?1003h\x1b[?1006h";
const END: &[u8] = b"\x1b[?1006l\x1b[?1003l";
/// Longest text of an event: what is longer is none.
const MAX_EVENT: usize = 32;

/// The mouse.
pub struct Mouse {
    info: DeviceInfo,
    terminal: File,
    /// How the terminal was before.
    before: Termios,
    pointer: Pointer,
}

impl Mouse {
    /// Has the terminal tell of its mouse.
    ///
    /// # Errors
    /// There is no terminal, or it cannot be set up.
    pub fn open(config: &MouseConfig) -> Result<Self, DeviceError> {
        let failed = |error: io::Error| DeviceError {
            device: "mouse".into(),
            what: format!("there is no terminal to read it from: {error}"),
            remedy: "start the station in a terminal".into(),
        };
        // An open file of its own: whoever else reads or writes the terminal still waits for it.
        let mut terminal = nonblocking("/dev/tty".as_ref(), true).map_err(failed)?;
        let before = tcgetattr(&terminal).map_err(|error| failed(error.into()))?;
        let mut modes = before.clone();
        // Events come at once and are not shown; Ctrl-C goes on working.
        modes.local_modes -= LocalModes::ICANON | LocalModes::ECHO;
        tcsetattr(&terminal, OptionalActions::Now, &modes).map_err(|error| failed(error.into()))?;
        terminal.write_all(BEGIN).map_err(failed)?;
        Ok(Self { info: unmoved("mouse".into(), REACH_M), terminal, before, pointer: Pointer::new(config.cell_m) })
    }
}

impl Drop for Mouse {
    fn drop(&mut self) {
        // Best effort: a terminal that is gone needs no putting back.
        let _ = self.terminal.write_all(END);
        let _ = tcsetattr(&self.terminal, OptionalActions::Flush, &self.before);
    }
}

impl Device for Mouse {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        let Self { info, terminal, pointer, .. } = self;
        let mut lost = None;
        paced::run(servo, stop, info.rate_hz, |dt_s, _| {
            let mut bytes = [0; 256];
            match terminal.read(&mut bytes) {
                Ok(count) => bytes[..count].iter().for_each(|byte| pointer.take(*byte)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) => {
                    lost = Some(error);
                    return None;
                }
            }
            Some(pointer.step(dt_s))
        });
        lost.map_or(Ok(()), |error| {
            Err(DeviceError {
                device: info.name.clone(),
                what: format!("the terminal is gone: {error}"),
                remedy: "start the station in a terminal".into(),
            })
        })
    }
}

/// The pointer, and the tip that follows it.
struct Pointer {
    cell_m: f64,
    /// Bytes of an event that has begun; a fixed room.
    event: [u8; MAX_EVENT],
    length: usize,
    /// The cell where it was first.
    origin: Option<[f64; 2]>,
    wanted_m: Vector3<f64>,
    position_m: Vector3<f64>,
    buttons: u32,
}

impl Pointer {
    fn new(cell_m: f64) -> Self {
        Self {
            cell_m,
            event: [0; MAX_EVENT],
            length: 0,
            origin: None,
            wanted_m: Vector3::zeros(),
            position_m: Vector3::zeros(),
            buttons: 0,
        }
    }

    /// Takes in a byte of the terminal's.
    fn take(&mut self, byte: u8) {
        match byte {
            b'\x1b' => self.length = 0,
            b'M' | b'm' => {
                let text = std::str::from_utf8(&self.event[..self.length]).ok();
                let numbers = text.and_then(|text| text.strip_prefix("[<")).and_then(|text| {
                    let mut numbers = text.split(';').map(|number| number.parse::<u32>().ok());
                    Some([numbers.next()??, numbers.next()??, numbers.next()??])
                });
                if let Some([code, column, row]) = numbers {
                    self.moved(code, column, row, byte == b'M');
                }
                self.length = 0;
            }
            _ if self.length < MAX_EVENT => {
                self.event[self.length] = byte;
                self.length += 1;
            }
            _ => {}
        }
    }

    /// The pointer is in a cell; `code` says what happened there.
    fn moved(&mut self, code: u32, column: u32, row: u32, is_down: bool) {
        let cell = [f64::from(column), CELL_ASPECT * f64::from(row)];
        let origin = *self.origin.get_or_insert(cell);
        self.wanted_m.x = (cell[0] - origin[0]) * self.cell_m;
        self.wanted_m.y = (origin[1] - cell[1]) * self.cell_m;
        // Bits 2 to 4 are keys, bit 5 is a motion, bit 6 the wheel.
        match (code & 0b110_0000, code & 0b11) {
            (0, button @ 0..3) => self.buttons = self.buttons & !(1 << button) | u32::from(is_down) << button,
            (0b100_0000, 0) => self.wanted_m.z -= self.cell_m,
            (0b100_0000, 1) => self.wanted_m.z += self.cell_m,
            _ => {}
        }
        self.wanted_m = self.wanted_m.map(|x| x.clamp(-REACH_M, REACH_M));
    }

    fn step(&mut self, dt_s: f64) -> DeviceState {
        let moved_m = (self.wanted_m - self.position_m) * (1.0 - (-dt_s / FOLLOW_S).exp());
        self.position_m += moved_m;
        DeviceState {
            position_m: self.position_m,
            orientation: UnitQuaternion::identity(),
            velocity_m_per_s: moved_m / dt_s.max(1e-6),
            buttons: self.buttons,
            hold: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(text: &str) -> Pointer {
        let mut pointer = Pointer::new(1e-3);
        text.bytes().for_each(|byte| pointer.take(byte));
        pointer
    }

    #[test]
    fn the_tip_follows_the_pointer_with_its_time_constant() {
        // Ten cells to the right, five up.
        let mut pointer = after("\x1b[<35;10;20M\x1b[<35;20;15M");
        let state = (0..50).map(|_| pointer.step(1e-3)).last().unwrap();
        let share = 1.0 - (-1.0_f64).exp();
        assert!((state.position_m - Vector3::new(0.01, 0.01, 0.0) * share).norm() < 1e-9, "{state:?}");
        let state = (0..1000).map(|_| pointer.step(1e-3)).last().unwrap();
        assert!((state.position_m - Vector3::new(0.01, 0.01, 0.0)).norm() < 1e-9, "{state:?}");
    }

    #[test]
    fn buttons_the_wheel_and_what_is_no_event() {
        let mut pointer = after("\x1b[<0;1;1M\x1b[<2;1;1M\x1b[<0;1;1m\x1b[<64;1;1M\x1b[<64;1;1Mq\x1b[A\x1b[<;;M");
        assert_eq!(pointer.step(1e-3).buttons, 0b100);
        assert_eq!(pointer.wanted_m, Vector3::new(0.0, 0.0, -2e-3));
        let endless = "1".repeat(1000);
        assert_eq!(after(&format!("\x1b[<{endless}M")).wanted_m, Vector3::zeros());
    }
}
