//! What figures that are taken on a machine say of it.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

const MIB: f64 = 1048576.0;

/// The processor's name and the number of cores that the machine lends.
#[must_use]
pub fn hardware() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}, {cores} cores", model.map_or("unknown processor", |(_, model)| model.trim()))
}

/// Share of the cores that steps may take; the rest is for the network and for what viewers are shown. On two cores it
/// admits 24 livers at 60 Hz, of which a quarter may be cut at once; with 26 more than 1 % of the steps were late (`make load`).
const STEPS_SHARE: f64 = 0.65;

/// Cores that steps may keep busy, of those that the machine lends.
#[must_use]
pub fn cores_for_steps() -> f64 {
    STEPS_SHARE * std::thread::available_parallelism().map_or(1, usize::from) as f64
}

/// Memory that this process may take, MiB: what the machine has or, where that is less, what its control groups or its
/// own limits (`ulimit -v`, `ulimit -d`) leave it; endless where nothing is told.
#[must_use]
pub fn memory_mib() -> f64 {
    let told = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let machine = kib(&told("/proc/meminfo"), "MemTotal:").map(|kib| kib / 1024.0);
    let groups = memory_files(&told("/proc/self/cgroup"));
    let groups = groups.iter().filter_map(|path| std::fs::read_to_string(path).ok()?.trim().parse::<f64>().ok());
    let (limits, status) = (told("/proc/self/limits"), told("/proc/self/status"));
    let own = [("Max address space", "VmSize:"), ("Max data size", "VmData:")];
    // What is taken already is not there for sessions.
    let own = own.map(|(limit, taken)| Some(bytes(&limits, limit)? / MIB - kib(&status, taken)? / 1024.0));
    let mib = groups.map(|bytes| bytes / MIB).chain(own.into_iter().flatten()).chain(machine);
    mib.fold(f64::INFINITY, f64::min).max(0.0)
}

/// Files with the limits of a process's control groups, from its own to the outermost: of version 2, and of version 1.
fn memory_files(told: &str) -> Vec<PathBuf> {
    let group = |line: &str| {
        let mut fields = line.splitn(3, ':').skip(1);
        let (controllers, path) = (fields.next()?, fields.next()?);
        let (root, file) = match controllers {
            "" => ("/sys/fs/cgroup", "memory.max"),
            "memory" => ("/sys/fs/cgroup/memory", "memory.limit_in_bytes"),
            _ => return None,
        };
        let group = Path::new(path.trim_start_matches('/'));
        Some(group.ancestors().map(|group| Path::new(root).join(group).join(file)).collect::<Vec<_>>())
    };
    told.lines().filter_map(group).flatten().collect()
}

/// The number of a line that begins so, in kB.
fn kib(told: &str, name: &str) -> Option<f64> {
    told.lines().find_map(|line| line.strip_prefix(name)?.trim().strip_suffix(" kB")?.parse().ok())
}

/// A limit of a process, bytes; `None` where it is unlimited.
fn bytes(limits: &str, name: &str) -> Option<f64> {
    limits.lines().find_map(|line| line.strip_prefix(name)?.split_whitespace().next()?.parse().ok())
}

/// Resident memory of this process at its highest, MiB: `VmHWM`.
///
/// # Errors
/// The system does not tell it; Linux does.
pub fn peak_memory_mib() -> Result<f64> {
    let status = std::fs::read_to_string("/proc/self/status").context("/proc/self/status: memory is told by Linux")?;
    Ok(kib(&status, "VmHWM:").context("/proc/self/status: VmHWM")? / 1024.0)
}

/// Memory that this process has now, bytes: `VmRSS`; `None` where the system does not tell.
#[must_use]
pub fn resident_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    Some((kib(&status, "VmRSS:")? * 1024.0) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_group_that_a_process_is_in_may_bound_its_memory() {
        let told = "5:cpu:/x\n4:memory:/docker/a\n0::/kerf.slice/serve\n";
        let expected = [
            "/sys/fs/cgroup/memory/docker/a/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/docker/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/memory.limit_in_bytes",
            "/sys/fs/cgroup/kerf.slice/serve/memory.max",
            "/sys/fs/cgroup/kerf.slice/memory.max",
            "/sys/fs/cgroup/memory.max",
        ];
        assert_eq!(memory_files(told), expected.map(PathBuf::from));
        assert_eq!(memory_files("0::/\n"), [PathBuf::from("/sys/fs/cgroup/memory.max")]);
    }

    #[test]
    fn limits_are_read_as_the_system_tells_them() {
        let limits = "Limit                     Soft Limit           Hard Limit           Units     \n\
                      Max data size             unlimited            unlimited            bytes     \n\
                      Max address space         1073741824           unlimited            bytes     \n";
        assert_eq!((bytes(limits, "Max address space"), bytes(limits, "Max data size")), (Some(1073741824.0), None));
    }
}
