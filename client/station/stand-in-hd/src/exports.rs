//! The vendor's functions. Safe code does the work: here pointers are read and written, and nothing else.

use std::cell::Cell;
use std::ffi::{CStr, c_char, c_ulong, c_void};

use crate::world::{Callback, ErrorInfo, Task, code};
use crate::{CONTROL, scheduler};

thread_local! {
    static CURRENT: Cell<u32> = const { Cell::new(code::INVALID_HANDLE) };
}

fn current() -> u32 {
    CURRENT.get()
}

#[unsafe(no_mangle)]
unsafe extern "system" fn hdInitDevice(name: *const c_char) -> u32 {
    // SAFETY: the caller gives no name or a text that ends with a zero.
    let name = (!name.is_null()).then(|| unsafe { CStr::from_ptr(name) }.to_string_lossy().into_owned());
    let handle = CONTROL.world().init(name.as_deref());
    CURRENT.set(handle);
    handle
}

#[unsafe(no_mangle)]
extern "system" fn hdDisableDevice(handle: u32) {
    let mut world = CONTROL.world();
    match world.devices.get_mut(handle as usize) {
        Some(device) => (device.is_open, device.is_force_on, device.frame) = (false, false, None),
        None => world.fail(code::BAD_HANDLE, handle),
    }
}

#[unsafe(no_mangle)]
extern "system" fn hdMakeCurrentDevice(handle: u32) {
    CURRENT.set(handle);
}

#[unsafe(no_mangle)]
extern "system" fn hdBeginFrame(handle: u32) {
    CURRENT.set(handle);
    CONTROL.world().begin_frame(handle);
}

#[unsafe(no_mangle)]
extern "system" fn hdEndFrame(handle: u32) {
    CONTROL.world().end_frame(handle);
}

#[unsafe(no_mangle)]
extern "system" fn hdGetError() -> ErrorInfo {
    CONTROL.world().errors.pop().unwrap_or_default()
}

#[unsafe(no_mangle)]
extern "system" fn hdGetErrorString(error: u32) -> *const c_char {
    match error {
        code::COMM_ERROR => c"Communication error",
        code::DEVICE_FAULT => c"Device fault",
        code::DEVICE_ALREADY_INITIATED => c"Device already initialized",
        _ => c"Error",
    }
    .as_ptr()
}

#[unsafe(no_mangle)]
extern "system" fn hdEnable(capability: u32) {
    let mut world = CONTROL.world();
    let Some(device) = world.device(current()) else { return };
    match capability {
        0x4000 => device.is_force_on = true,
        _ => world.fail(code::INVALID_ENUM, current()),
    }
}

#[unsafe(no_mangle)]
unsafe extern "system" fn hdGetIntegerv(name: u32, out: *mut i32) {
    let mut world = CONTROL.world();
    let rate_hz = world.rate_hz;
    let Some(device) = world.device(current()) else { return };
    let value = match name {
        0x2000 => device.buttons,
        0x2555 => device.calibration_style,
        0x2600 => rate_hz as i32,
        _ => return world.fail(code::INVALID_ENUM, current()),
    };
    // SAFETY: the caller has room for one integer.
    unsafe { out.write(value) };
}

#[unsafe(no_mangle)]
unsafe extern "system" fn hdGetDoublev(name: u32, out: *mut f64) {
    let mut world = CONTROL.world();
    let Some(device) = world.device(current()) else { return };
    let is_in_frame = device.frame.is_some();
    let values: &[f64] = match name {
        0x2050 => &device.position_mm,
        0x2051 => &device.velocity_mm_per_s,
        0x2052 => &device.transform,
        0x2551 => &[-80.0, -60.0, -35.0, 80.0, 60.0, 35.0],
        0x2602 => &[0.5],
        0x2603 => &[3.3],
        0x2604 => &[0.88],
        0x2609 => &[0.005],
        _ => return world.fail(code::INVALID_ENUM, current()),
    };
    // SAFETY: the caller has room for what it asks for.
    unsafe { out.copy_from_nonoverlapping(values.as_ptr(), values.len()) };
    if !is_in_frame && name < 0x2500 {
        world.fail(code::FRAME_ERROR, current());
    }
}

#[unsafe(no_mangle)]
unsafe extern "system" fn hdSetDoublev(name: u32, values: *const f64) {
    let mut world = CONTROL.world();
    let Some(device) = world.device(current()) else { return };
    match (name, &mut device.frame) {
        // SAFETY: the caller gives three numbers.
        (0x2700, Some(force_n)) => *force_n = unsafe { values.cast::<[f64; 3]>().read() },
        (0x2700, None) => world.fail(code::FRAME_ERROR, current()),
        _ => world.fail(code::INVALID_ENUM, current()),
    }
}

#[unsafe(no_mangle)]
extern "system" fn hdGetString(name: u32) -> *const c_char {
    match name {
        0x2500 => c"3.4.0 stand-in",
        0x2501 => c"PHANTOM Omni",
        0x2502 => c"4.0.0",
        0x2503 => c"stand-in",
        0x2504 => c"10402100017",
        _ => {
            CONTROL.world().fail(code::INVALID_ENUM, current());
            return std::ptr::null();
        }
    }
    .as_ptr()
}

#[unsafe(no_mangle)]
extern "system" fn hdCheckCalibration() -> u32 {
    CONTROL.world().device(current()).map_or(code::CALIBRATION_NEEDS_UPDATE, |device| device.calibration)
}

#[unsafe(no_mangle)]
extern "system" fn hdUpdateCalibration(style: u32) {
    let mut world = CONTROL.world();
    let is_running = world.is_running;
    let Some(device) = world.device(current()) else { return };
    // Encoders are reset before the scheduler runs, all else while it runs.
    if device.calibration_style & style as i32 == 0 || (style == 1) == is_running {
        world.fail(code::INVALID_OPERATION, current());
    } else if device.calibration == code::CALIBRATION_NEEDS_UPDATE {
        device.calibration = code::CALIBRATION_OK;
    }
}

#[unsafe(no_mangle)]
extern "system" fn hdStartScheduler() {
    scheduler::start();
}

#[unsafe(no_mangle)]
extern "system" fn hdStopScheduler() {
    scheduler::stop();
}

#[unsafe(no_mangle)]
extern "system" fn hdScheduleAsynchronous(callback: Callback, data: *mut c_void, priority: u16) -> c_ulong {
    let mut world = CONTROL.world();
    world.last_task += 1;
    let task = Task { id: world.last_task, callback, data: data as usize, priority };
    world.tasks.push(task);
    task.id
}

#[unsafe(no_mangle)]
extern "system" fn hdUnschedule(task: c_ulong) {
    CONTROL.world().tasks.retain(|other| other.id != task);
}
