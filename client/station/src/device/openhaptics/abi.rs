//! The vendor's library libHD: the functions, numbers and types that are used of it, declared by ourselves.
//!
//! Each function is called through [`Hd`]. They are safe to call in any order with any numbers (the library answers
//! what is wrong by its error stack), so the only promises that `unsafe` stands for here are that a symbol has the type
//! that it is declared with, and that pointers point to as much as is asked for.

#![allow(unsafe_code, reason = "a foreign library")]

use std::ffi::{CStr, CString, c_char, c_ulong, c_void};
use std::path::Path;

use libloading::Library;

/// A device, as the library calls it.
pub type Handle = u32;
/// No device.
pub const INVALID_HANDLE: Handle = u32::MAX;
/// What a callback answers to be called again.
pub const CALLBACK_CONTINUE: u32 = 1;
/// Priority of a callback; higher is earlier.
pub const DEFAULT_PRIORITY: u16 = 32767;
/// The capability to render forces.
pub const FORCE_OUTPUT: u32 = 0x4000;
/// Styles of calibration, bits.
pub const STYLE_ENCODER_RESET: u32 = 1;
/// It calibrates itself as it is moved.
pub const STYLE_AUTO: u32 = 2;
/// The stylus is put into the inkwell.
pub const STYLE_INKWELL: u32 = 4;
/// Where the user does what the library asks for.
pub const CALIBRATION_OK: u32 = 0x5000;
/// The library has to be told to take the calibration over.
pub const CALIBRATION_NEEDS_UPDATE: u32 = 0x5001;

/// What can be asked for.
pub mod get {
    #![allow(missing_docs, reason = "the vendor's names")]
    pub const BUTTONS: u32 = 0x2000;
    pub const POSITION: u32 = 0x2050;
    pub const VELOCITY: u32 = 0x2051;
    pub const TRANSFORM: u32 = 0x2052;
    pub const VERSION: u32 = 0x2500;
    pub const MODEL: u32 = 0x2501;
    pub const DRIVER_VERSION: u32 = 0x2502;
    pub const SERIAL_NUMBER: u32 = 0x2504;
    pub const USABLE_WORKSPACE: u32 = 0x2551;
    pub const CALIBRATION_STYLE: u32 = 0x2555;
    pub const UPDATE_RATE: u32 = 0x2600;
    pub const MAX_STIFFNESS: u32 = 0x2602;
    pub const MAX_FORCE: u32 = 0x2603;
    pub const MAX_DAMPING: u32 = 0x2609;
    pub const FORCE: u32 = 0x2700;
}

/// Numbers of errors.
pub mod error {
    #![allow(missing_docs, reason = "the vendor's names")]
    pub const WARM_MOTORS: u32 = 0x200;
    pub const FORCE_ERROR: u32 = 0x204;
    pub const DEVICE_FAULT: u32 = 0x300;
    pub const ALREADY_INITIATED: u32 = 0x301;
    pub const COMM_ERROR: u32 = 0x302;
    pub const COMM_CONFIG_ERROR: u32 = 0x303;
    pub const TIMER_ERROR: u32 = 0x304;
    pub const INVALID_LICENSE: u32 = 0x600;
}

/// An error. Twelve bytes, returned by value.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorInfo {
    /// Its number; 0: none.
    pub code: u32,
    /// The driver's own number.
    pub internal: i32,
    /// The device that it is about.
    pub handle: Handle,
}

/// What the scheduler calls.
pub type Callback = extern "system" fn(*mut c_void) -> u32;

macro_rules! functions {
    ($($field:ident: $symbol:literal, fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The library's functions.
        struct Functions {
            $($field: unsafe extern "system" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            /// Looks all of them up; the names of those that are missing, if any are.
            fn look_up(library: &Library) -> Result<Self, Vec<&'static str>> {
                let mut missing = Vec::new();
                $(
                    // SAFETY: the symbol has this type by the vendor's documents; the library is never unloaded.
                    let $field = unsafe {
                        library.get::<unsafe extern "system" fn($($argument),*) $(-> $result)?>($symbol)
                    };
                    if $field.is_err() {
                        missing.push($symbol);
                    }
                )*
                match ($($field,)*) {
                    ($(Ok($field),)*) => Ok(Self { $($field: *$field,)* }),
                    _ => Err(missing),
                }
            }
        }
    };
}

functions! {
    init_device: "hdInitDevice", fn(*const c_char) -> Handle;
    disable_device: "hdDisableDevice", fn(Handle);
    make_current: "hdMakeCurrentDevice", fn(Handle);
    begin_frame: "hdBeginFrame", fn(Handle);
    end_frame: "hdEndFrame", fn(Handle);
    get_error: "hdGetError", fn() -> ErrorInfo;
    get_error_string: "hdGetErrorString", fn(u32) -> *const c_char;
    enable: "hdEnable", fn(u32);
    get_integers: "hdGetIntegerv", fn(u32, *mut i32);
    get_doubles: "hdGetDoublev", fn(u32, *mut f64);
    set_doubles: "hdSetDoublev", fn(u32, *const f64);
    get_string: "hdGetString", fn(u32) -> *const c_char;
    check_calibration: "hdCheckCalibration", fn() -> u32;
    update_calibration: "hdUpdateCalibration", fn(u32);
    start_scheduler: "hdStartScheduler", fn();
    stop_scheduler: "hdStopScheduler", fn();
    schedule: "hdScheduleAsynchronous", fn(Callback, *mut c_void, u16) -> c_ulong;
    unschedule: "hdUnschedule", fn(c_ulong);
}

/// The library, loaded for good: the driver fails when it is loaded a second time.
pub struct Hd(Functions);

impl Hd {
    /// Loads the library from a path, or by a name that the system looks for in its folders.
    ///
    /// # Errors
    /// What the system's loader says, or which symbols are missing.
    pub fn load(path: &Path) -> Result<Self, String> {
        let library = open(path).map_err(|error| match std::error::Error::source(&error) {
            Some(source) => source.to_string(),
            None => error.to_string(),
        })?;
        let functions = Functions::look_up(&library)
            .map_err(|missing| format!("is a library, but not the vendor's: it has no {}", missing.join(", no ")))?;
        std::mem::forget(library);
        Ok(Self(functions))
    }

    /// Takes hold of a device; `None` is the default one.
    pub fn init_device(&self, name: Option<&CString>) -> Handle {
        // The driver reads its joints' calibration with the process's decimal sign.
        // SAFETY: both texts end with a zero and outlive the calls.
        unsafe {
            libc::setlocale(libc::LC_NUMERIC, c"C".as_ptr());
            (self.0.init_device)(name.map_or(std::ptr::null(), |name| name.as_ptr()))
        }
    }

    /// Asks for `N` numbers of the current device, zeros where it does not answer.
    pub fn doubles<const N: usize>(&self, what: u32) -> [f64; N] {
        // Sixteen is the most that anything asked for has: a wrong N cannot overrun.
        let mut values = [0.0; 16];
        // SAFETY: there is room for sixteen.
        unsafe { (self.0.get_doubles)(what, values.as_mut_ptr()) };
        std::array::from_fn(|i| values[i])
    }

    /// Asks for a number of the current device, 0 where it does not answer.
    pub fn integer(&self, what: u32) -> i32 {
        let mut values = [0; 16];
        // SAFETY: there is room for sixteen; what is asked for has one.
        unsafe { (self.0.get_integers)(what, values.as_mut_ptr()) };
        values[0]
    }

    /// Sets the force of the current frame, N.
    pub fn set_force(&self, force_n: [f64; 3]) {
        // SAFETY: a force has three numbers.
        unsafe { (self.0.set_doubles)(get::FORCE, force_n.as_ptr()) }
    }

    /// Asks for a text about the current device.
    pub fn string(&self, what: u32) -> Option<String> {
        // SAFETY: the library answers nothing or a text that ends with a zero.
        unsafe { text((self.0.get_string)(what)) }
    }

    /// The newest error, taken off the stack.
    pub fn pop_error(&self) -> Option<ErrorInfo> {
        // SAFETY: no pointers.
        let error = unsafe { (self.0.get_error)() };
        (error.code != 0).then_some(error)
    }

    /// An error in the library's words and numbers.
    pub fn describe(&self, error: &ErrorInfo) -> String {
        // SAFETY: as for `string`.
        let words = unsafe { text((self.0.get_error_string)(error.code)) }.unwrap_or_default();
        format!("{words} (error {:#x}, internal {})", error.code, error.internal)
    }

    /// Has a callback called at each tick; `data` goes to it.
    pub fn schedule(&self, callback: Callback, data: *mut c_void) -> c_ulong {
        // SAFETY: the library only hands `data` on.
        unsafe { (self.0.schedule)(callback, data, DEFAULT_PRIORITY) }
    }
}

macro_rules! plain {
    ($($(#[$doc:meta])* $name:ident($($argument:ident: $type:ty)?) $(-> $result:ty)?;)*) => {
        impl Hd {
            $(
                $(#[$doc])*
                pub fn $name(&self $(, $argument: $type)?) $(-> $result)? {
                    // SAFETY: no pointers.
                    unsafe { (self.0.$name)($($argument)?) }
                }
            )*
        }
    };
}

plain! {
    /// Lets a device go.
    disable_device(handle: Handle);
    /// What is asked for is of this device from now on.
    make_current(handle: Handle);
    /// Begins a frame of a device, which becomes the current one.
    begin_frame(handle: Handle);
    /// Ends a frame: the force goes out.
    end_frame(handle: Handle);
    /// Enables a capability of the current device.
    enable(capability: u32);
    /// How the current device's calibration is.
    check_calibration() -> u32;
    /// Takes the current device's calibration over.
    update_calibration(style: u32);
    /// Lets the scheduler call.
    start_scheduler();
    /// When this returns no callback is called any more.
    stop_scheduler();
    /// A callback is not called any more.
    unschedule(task: c_ulong);
}

/// # Safety
/// A text that ends with a zero, or null.
unsafe fn text(pointer: *const c_char) -> Option<String> {
    // SAFETY: as the caller promises.
    (!pointer.is_null()).then(|| unsafe { CStr::from_ptr(pointer) }.to_string_lossy().into_owned())
}

/// Symbols are visible to all: the vendor's library loads further ones that look for its own.
#[cfg(unix)]
fn open(path: &Path) -> Result<Library, libloading::Error> {
    use libloading::os::unix;
    // SAFETY: the library's own start is trusted as it is the vendor's.
    unsafe { unix::Library::open(Some(path), unix::RTLD_LAZY | unix::RTLD_GLOBAL) }.map(Into::into)
}

#[cfg(not(unix))]
fn open(path: &Path) -> Result<Library, libloading::Error> {
    // SAFETY: the library's own start is trusted as it is the vendor's.
    unsafe { Library::new(path) }
}
