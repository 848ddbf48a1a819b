//! The devices, the error stack and the tasks.

use std::ffi::{c_ulong, c_void};

/// Numbers of the vendor's errors and states.
pub mod code {
    #![allow(missing_docs, reason = "the vendor's names")]
    pub const INVALID_ENUM: u32 = 0x100;
    pub const INVALID_OPERATION: u32 = 0x102;
    pub const BAD_HANDLE: u32 = 0x104;
    pub const WARM_MOTORS: u32 = 0x200;
    pub const DEVICE_FAULT: u32 = 0x300;
    pub const DEVICE_ALREADY_INITIATED: u32 = 0x301;
    pub const COMM_ERROR: u32 = 0x302;
    pub const ILLEGAL_BEGIN: u32 = 0x400;
    pub const ILLEGAL_END: u32 = 0x401;
    pub const FRAME_ERROR: u32 = 0x402;
    pub const INVALID_HANDLE: u32 = 0xFFFF_FFFF;
    pub const CALIBRATION_OK: u32 = 0x5000;
    pub const CALIBRATION_NEEDS_UPDATE: u32 = 0x5001;
    pub const CALIBRATION_NEEDS_MANUAL_INPUT: u32 = 0x5002;
}

/// An error, as the vendor lays it out.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorInfo {
    /// Which, of [`code`].
    pub code: u32,
    /// The driver's own number.
    pub internal: i32,
    /// The device that it is about.
    pub handle: u32,
}

/// What is called at each tick.
pub(crate) type Callback = extern "system" fn(*mut c_void) -> u32;

#[derive(Clone, Copy)]
pub(crate) struct Task {
    pub id: c_ulong,
    pub callback: Callback,
    pub data: usize,
    pub priority: u16,
}

/// A simulated device.
#[derive(Clone, Debug)]
pub struct Device {
    /// What it is asked for by; the first device also answers to no name.
    pub name: String,
    /// Whether it is plugged in.
    pub is_plugged: bool,
    /// How many more times it says that it is in use.
    pub refusals: u32,
    /// Of [`code`].
    pub calibration: u32,
    /// 1: encoders are reset, 2: by itself, 4: in the inkwell.
    pub calibration_style: i32,
    /// Of the tip, mm.
    pub position_mm: [f64; 3],
    /// Of the tip, mm/s.
    pub velocity_mm_per_s: [f64; 3],
    /// Columns of the stylus's frame.
    pub transform: [f64; 16],
    /// Bit i: button i is down.
    pub buttons: i32,
    /// What the motors render, N.
    pub force_n: [f64; 3],
    /// The greatest that they ever rendered, N.
    pub greatest_force_n: f64,
    /// Frames that came to their end.
    pub frames: u64,
    /// Whether it is in use.
    pub is_open: bool,
    pub(crate) is_force_on: bool,
    pub(crate) frame: Option<[f64; 3]>,
}

impl Device {
    /// A device that is plugged in and calibrated.
    #[must_use]
    pub fn new(name: &str) -> Self {
        let mut transform = [0.0; 16];
        (0..4).for_each(|i| transform[5 * i] = 1.0);
        Self {
            name: name.into(),
            is_plugged: true,
            refusals: 0,
            calibration: code::CALIBRATION_OK,
            calibration_style: 4,
            position_mm: [0.0, -65.5, -88.1],
            velocity_mm_per_s: [0.0; 3],
            transform,
            buttons: 0,
            force_n: [0.0; 3],
            greatest_force_n: 0.0,
            frames: 0,
            is_open: false,
            is_force_on: false,
            frame: None,
        }
    }
}

/// All that the library knows.
pub struct World {
    /// The devices; the handle is the index.
    pub devices: Vec<Device>,
    /// Ticks a second, Hz.
    pub rate_hz: f64,
    /// Errors, the newest last.
    pub errors: Vec<ErrorInfo>,
    /// Codes of all errors that there ever were.
    pub history: Vec<u32>,
    pub(crate) tasks: Vec<Task>,
    pub(crate) last_task: c_ulong,
    pub(crate) is_running: bool,
    pub(crate) thread: Option<std::thread::JoinHandle<()>>,
}

impl World {
    pub(crate) const fn new() -> Self {
        Self {
            devices: Vec::new(),
            rate_hz: 1000.0,
            errors: Vec::new(),
            history: Vec::new(),
            tasks: Vec::new(),
            last_task: 0,
            is_running: false,
            thread: None,
        }
    }

    /// Whether the scheduler runs.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.is_running
    }

    /// Puts an error on the stack.
    pub fn fail(&mut self, code: u32, handle: u32) {
        self.errors.push(ErrorInfo { code, internal: -1, handle });
        self.history.push(code);
    }

    /// The device of a handle, if it is open and plugged in; an error if not.
    pub(crate) fn device(&mut self, handle: u32) -> Option<&mut Device> {
        let found = self.devices.get(handle as usize).filter(|device| device.is_open);
        match found.map(|device| device.is_plugged) {
            None => self.fail(code::BAD_HANDLE, handle),
            Some(false) => {
                let device = &mut self.devices[handle as usize];
                (device.frame, device.force_n) = (None, [0.0; 3]);
                self.fail(code::COMM_ERROR, handle);
            }
            Some(true) => return self.devices.get_mut(handle as usize),
        }
        None
    }

    pub(crate) fn init(&mut self, name: Option<&str>) -> u32 {
        let named = |device: &Device| name.is_none_or(|name| device.name == name);
        let Some(index) = self.devices.iter().position(named) else {
            self.fail(code::DEVICE_FAULT, code::INVALID_HANDLE);
            return code::INVALID_HANDLE;
        };
        let device = &mut self.devices[index];
        let fault = if !device.is_plugged {
            code::COMM_ERROR
        } else if device.is_open || device.refusals > 0 {
            device.refusals = device.refusals.saturating_sub(1);
            code::DEVICE_ALREADY_INITIATED
        } else {
            device.is_open = true;
            return index as u32;
        };
        self.fail(fault, code::INVALID_HANDLE);
        code::INVALID_HANDLE
    }

    pub(crate) fn begin_frame(&mut self, handle: u32) {
        let Some(device) = self.device(handle) else { return };
        if device.frame.replace([0.0; 3]).is_some() {
            self.fail(code::ILLEGAL_BEGIN, handle);
        }
    }

    pub(crate) fn end_frame(&mut self, handle: u32) {
        let is_running = self.is_running;
        let Some(device) = self.device(handle) else { return };
        let Some(force_n) = device.frame.take() else { return self.fail(code::ILLEGAL_END, handle) };
        device.force_n = if device.is_force_on && is_running { force_n } else { [0.0; 3] };
        let norm_n = device.force_n.iter().map(|f| f * f).sum::<f64>().sqrt();
        device.greatest_force_n = device.greatest_force_n.max(norm_n);
        device.frames += 1;
    }

    /// The scheduler stops: motors go slack.
    pub(crate) fn go_slack(&mut self) {
        self.devices.iter_mut().for_each(|device| device.force_n = [0.0; 3]);
    }
}
