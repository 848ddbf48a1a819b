//! What this machine allows.

use super::{Finding, Outcome};

/// All of it.
pub fn findings() -> Vec<Finding> {
    let mut findings = vec![priority()];
    #[cfg(target_os = "linux")]
    findings.extend(ports());
    findings
}

/// Whether a thread may have real-time priority.
#[cfg(unix)]
fn priority() -> Finding {
    use thread_priority::unix::{set_thread_priority_and_policy, thread_native_id};
    use thread_priority::{RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy};
    // A thread of its own: this one keeps its priority.
    let asked = std::thread::spawn(|| {
        let half = ThreadPriority::Crossplatform(50.try_into().expect("between 0 and 99"));
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        set_thread_priority_and_policy(thread_native_id(), half, policy)
    });
    match asked.join().expect("asking does not panic") {
        Ok(()) => Finding::good("real-time priority", "allowed"),
        Err(error) => Finding::other(
            Outcome::Note,
            "real-time priority",
            format!("not allowed ({error:?}): on a busy machine the servo may come late"),
            "add `@yourgroup - rtprio 50` to /etc/security/limits.conf and log in again",
        ),
    }
}

#[cfg(not(unix))]
fn priority() -> Finding {
    Finding::good("real-time priority", "left to the device's driver")
}

/// Serial ports, behind which the devices of OpenHaptics are.
#[cfg(target_os = "linux")]
fn ports() -> Vec<Finding> {
    use std::os::unix::ffi::OsStrExt;

    use rustix::fs::{Access, access};
    let entries = std::fs::read_dir("/dev").into_iter().flatten().flatten();
    let is_port = |name: &[u8]| name.starts_with(b"ttyACM") || name.starts_with(b"ttyUSB");
    let mut paths: Vec<_> = entries.filter(|entry| is_port(entry.file_name().as_bytes())).map(|e| e.path()).collect();
    paths.sort();
    let allowed = |path: &std::path::PathBuf| match access(path, Access::READ_OK | Access::WRITE_OK) {
        Ok(()) => Finding::good(format!("port {}", path.display()), "may be opened"),
        Err(error) => Finding::other(
            Outcome::Note,
            format!("port {}", path.display()),
            format!("may not be opened ({error}): a device on it will not be found"),
            "add yourself to the port's group (`ls -l` names it, mostly dialout) and log in again",
        ),
    };
    paths.iter().map(allowed).collect()
}
