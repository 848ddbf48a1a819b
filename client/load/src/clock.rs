//! The monotonic clock, and sleeping until one of its readings.

#[cfg(feature = "virtual-time")]
thread_local! {
    static VIRTUAL: std::cell::Cell<Option<fn() -> u64>> = const { std::cell::Cell::new(None) };
}

/// From now on this thread reads another clock, or the system's again.
#[cfg(feature = "virtual-time")]
pub fn follow(clock: Option<fn() -> u64>) {
    VIRTUAL.set(clock);
}

/// Nanoseconds since an arbitrary origin, monotonic.
#[cfg(target_os = "linux")]
#[must_use]
pub fn now_ns() -> u64 {
    #[cfg(feature = "virtual-time")]
    if let Some(clock) = VIRTUAL.get() {
        return clock();
    }
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// Sleeps until the clock reads `deadline_ns`; returns at once when it is past.
#[cfg(target_os = "linux")]
pub fn sleep_until_ns(deadline_ns: u64) {
    let deadline = rustix::time::Timespec {
        tv_sec: (deadline_ns / 1_000_000_000) as i64,
        tv_nsec: (deadline_ns % 1_000_000_000) as _,
    };
    // An absolute deadline: a signal that interrupts the sleep does not move it.
    while rustix::thread::clock_nanosleep_absolute(rustix::thread::ClockId::Monotonic, &deadline)
        == Err(rustix::io::Errno::INTR)
    {}
}

/// Nanoseconds since the first call, monotonic.
#[cfg(not(target_os = "linux"))]
#[must_use]
pub fn now_ns() -> u64 {
    static ORIGIN: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    ORIGIN.get_or_init(std::time::Instant::now).elapsed().as_nanos() as u64
}

/// Sleeps until the clock reads `deadline_ns`; returns at once when it is past.
#[cfg(not(target_os = "linux"))]
pub fn sleep_until_ns(deadline_ns: u64) {
    std::thread::sleep(std::time::Duration::from_nanos(deadline_ns.saturating_sub(now_ns())));
}
