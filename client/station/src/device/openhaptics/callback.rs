//! What the vendor's scheduler calls at each tick of a device.

#![allow(unsafe_code, reason = "called by a foreign library, and a servo that lives on another thread's stack")]

use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use kerf_load::clock;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::abi::{self, ErrorInfo, Handle, error, get};
use super::driver::Driver;
use crate::device::{DeviceState, Servo};

/// What a device says before is not to be believed, ns.
const SETTLING_NS: u64 = 50_000_000;
/// How long forces are held back after the device cut them off, ns.
const RECOVERY_NS: u64 = 500_000_000;
/// Ticks between two looks at the calibration of a device that is calibrated.
const CALIBRATION_TICKS: u64 = 100;

/// What the callback of a device works with; the thread that runs the device reads the atomics.
pub struct Shared {
    pub driver: &'static Driver,
    pub handle: Handle,
    pub calibration_style: u32,
    pub peak_force_n: f64,
    /// Ticks that there were.
    pub ticks: AtomicU64,
    /// Of the last look.
    pub calibration: AtomicU32,
    /// Whether the servo panicked.
    pub has_panicked: AtomicBool,
    /// Code and internal number of what ended it; 0: it goes on.
    fatal: AtomicU64,
    seat: Mutex<Seat>,
}

/// The servo, as long as the device runs.
#[derive(Default)]
struct Seat {
    servo: Option<ServoPointer>,
    /// When the first tick was, or the last one for long.
    since_ns: u64,
    last_ns: u64,
    held_until_ns: u64,
    hold: Option<&'static str>,
}

struct ServoPointer(*mut (dyn Servo + 'static));

// SAFETY: a `Servo` is `Send`, and the pointer is only used by whoever holds the seat's lock.
unsafe impl Send for ServoPointer {}

impl Shared {
    pub fn new(driver: &'static Driver, handle: Handle, calibration_style: u32, peak_force_n: f64) -> Self {
        Self {
            driver,
            handle,
            calibration_style,
            peak_force_n,
            ticks: AtomicU64::new(0),
            calibration: AtomicU32::new(abi::CALIBRATION_NEEDS_UPDATE),
            has_panicked: AtomicBool::new(false),
            fatal: AtomicU64::new(0),
            seat: Mutex::new(Seat::default()),
        }
    }

    /// What ended it.
    pub fn fatal(&self) -> Option<ErrorInfo> {
        let packed = self.fatal.load(Ordering::Acquire);
        let error =
            ErrorInfo { code: (packed >> 32) as u32, internal: (packed as u32).cast_signed(), handle: self.handle };
        (error.code != 0).then_some(error)
    }

    /// Has the servo called until the answer is dropped.
    pub fn seat<'a>(&'a self, servo: &'a mut dyn Servo) -> Seated<'a> {
        let pointer: *mut (dyn Servo + 'a) = servo;
        // SAFETY: only the lifetime changes. `Seated` borrows the servo and takes the pointer away when it is dropped,
        // under the lock that the callback holds while it uses it. It is not leaked: nothing outside this crate has it.
        let pointer = unsafe { std::mem::transmute::<*mut (dyn Servo + 'a), *mut (dyn Servo + 'static)>(pointer) };
        *self.lock() = Seat { servo: Some(ServoPointer(pointer)), ..Seat::default() };
        Seated(self)
    }

    fn lock(&self) -> MutexGuard<'_, Seat> {
        self.seat.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The force of a tick, N; zero whenever anything is in doubt.
    fn tick(&self) -> Vector3<f64> {
        // Held by another only while a servo takes or leaves its seat: the tick goes by without a force then.
        let Ok(mut seat) = self.seat.try_lock() else { return Vector3::zeros() };
        let now_ns = clock::now_ns();
        if now_ns.saturating_sub(seat.last_ns) > SETTLING_NS {
            seat.since_ns = now_ns;
        }
        seat.last_ns = now_ns;
        let is_settled = now_ns - seat.since_ns >= SETTLING_NS;
        let calibration = self.check_calibration();
        let hold = if !is_settled {
            Some("the device has only just begun")
        } else if calibration != abi::CALIBRATION_OK {
            Some(calibration_words(self.calibration_style))
        } else {
            seat.hold.filter(|_| now_ns < seat.held_until_ns)
        };
        let state = DeviceState { hold, ..self.read() };
        if !state.position_m.iter().chain(&state.velocity_m_per_s).all(|value| value.is_finite()) {
            return Vector3::zeros();
        }
        let Some(servo) = &mut seat.servo else { return Vector3::zeros() };
        // SAFETY: the servo lives as long as it has the seat, and the lock is held.
        let servo = unsafe { &mut *servo.0 };
        let Ok(force_n) = catch_unwind(AssertUnwindSafe(|| servo.tick(now_ns, &state))) else {
            self.has_panicked.store(true, Ordering::Release);
            seat.servo = None;
            return Vector3::zeros();
        };
        let norm_n = force_n.norm();
        let may_push = is_settled && calibration == abi::CALIBRATION_OK && norm_n.is_finite();
        if may_push { force_n * (self.peak_force_n / norm_n.max(self.peak_force_n)) } else { Vector3::zeros() }
    }

    /// Takes the calibration over where the library asks for that.
    fn check_calibration(&self) -> u32 {
        let known = self.calibration.load(Ordering::Relaxed);
        if known == abi::CALIBRATION_OK && !self.ticks.load(Ordering::Relaxed).is_multiple_of(CALIBRATION_TICKS) {
            return known;
        }
        let hd = &self.driver.hd;
        let running_styles = self.calibration_style & (abi::STYLE_AUTO | abi::STYLE_INKWELL);
        let mut found = hd.check_calibration();
        if found == abi::CALIBRATION_NEEDS_UPDATE && running_styles != 0 {
            hd.update_calibration(if running_styles & abi::STYLE_INKWELL != 0 {
                abi::STYLE_INKWELL
            } else {
                abi::STYLE_AUTO
            });
            found = hd.check_calibration();
        }
        self.calibration.store(found, Ordering::Relaxed);
        found
    }

    fn read(&self) -> DeviceState {
        let hd = &self.driver.hd;
        let metres = |millimetres: [f64; 3]| Vector3::from(millimetres) * 1e-3;
        let columns: [f64; 16] = hd.doubles(get::TRANSFORM);
        let matrix = Matrix3::from_fn(|row, column| columns[4 * column + row]);
        // A frame that is none (all zeros from a device that failed) leaves the stylus unturned.
        let is_frame = (matrix.determinant() - 1.0).abs() < 0.1;
        DeviceState {
            position_m: metres(hd.doubles(get::POSITION)),
            orientation: if is_frame {
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
            } else {
                UnitQuaternion::identity()
            },
            velocity_m_per_s: metres(hd.doubles(get::VELOCITY)),
            buttons: hd.integer(get::BUTTONS).cast_unsigned(),
            hold: None,
        }
    }

    /// Empties the error stack: what ends the device, what holds its forces back for a while, what does neither.
    fn sort_errors(&self) {
        let Some(found) = self.driver.take_error(self.handle) else { return };
        match found.code {
            error::WARM_MOTORS..=error::FORCE_ERROR => {
                if let Ok(mut seat) = self.seat.try_lock() {
                    seat.held_until_ns = clock::now_ns() + RECOVERY_NS;
                    seat.hold = Some(match found.code {
                        error::WARM_MOTORS => "the motors are too warm: let them rest",
                        _ => "the device cut off a force or a speed that is too great",
                    });
                }
            }
            error::TIMER_ERROR => {}
            _ => {
                let packed = u64::from(found.code) << 32 | u64::from(found.internal.cast_unsigned());
                self.fatal.store(packed, Ordering::Release);
            }
        }
    }
}

/// What the user has to do.
pub fn calibration_words(style: u32) -> &'static str {
    if style & abi::STYLE_INKWELL != 0 {
        "not calibrated: put the stylus into the inkwell, wait until its light is steady, and take it out"
    } else if style & abi::STYLE_AUTO != 0 {
        "not calibrated: move the stylus about through its whole reach"
    } else {
        "not calibrated: hold the stylus in its reset position and start the station again"
    }
}

/// A servo that has its seat.
pub struct Seated<'a>(&'a Shared);

impl Drop for Seated<'_> {
    fn drop(&mut self) {
        // Waits for a tick that is under way.
        self.0.lock().servo = None;
    }
}

/// What the scheduler calls; `data` is a [`Shared`]. Never unwinds, and has a force of its own in every frame.
pub extern "system" fn callback(data: *mut c_void) -> u32 {
    // SAFETY: the device keeps what it scheduled this with until it is unscheduled.
    let shared = unsafe { &*data.cast_const().cast::<Shared>() };
    let hd = &shared.driver.hd;
    hd.begin_frame(shared.handle);
    let force_n = match shared.fatal() {
        // A panic in what is our own code is a servo's that goes on unwinding: nothing here keeps a lock.
        None => catch_unwind(AssertUnwindSafe(|| shared.tick())).unwrap_or_else(|_| {
            shared.has_panicked.store(true, Ordering::Release);
            Vector3::zeros()
        }),
        Some(_) => Vector3::zeros(),
    };
    hd.set_force(force_n.into());
    hd.end_frame(shared.handle);
    shared.ticks.fetch_add(1, Ordering::Relaxed);
    shared.sort_errors();
    abi::CALLBACK_CONTINUE
}
