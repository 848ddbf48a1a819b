//! What figures that are taken on a machine say of it.

use anyhow::{Context, Result};

/// The processor's name and the number of cores that the machine lends.
#[must_use]
pub fn hardware() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}, {cores} cores", model.map_or("unknown processor", |(_, model)| model.trim()))
}

/// Cores that the machine lends.
#[must_use]
pub fn cores() -> f64 {
    std::thread::available_parallelism().map_or(1, usize::from) as f64
}

/// Memory that the machine has or, where that is less, its container may take, MiB; endless where neither is told.
#[must_use]
pub fn memory_mib() -> f64 {
    let told = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let kib = told.lines().find_map(|line| line.strip_prefix("MemTotal:")?.trim().strip_suffix(" kB")?.parse().ok());
    let container = std::fs::read_to_string("/sys/fs/cgroup/memory.max").unwrap_or_default();
    let bytes: Option<f64> = container.trim().parse().ok();
    f64::min(kib.unwrap_or(f64::INFINITY) / 1024.0, bytes.unwrap_or(f64::INFINITY) / 1048576.0)
}

/// Resident memory of this process at its highest, MiB: `VmHWM`.
///
/// # Errors
/// The system does not tell it; Linux does.
pub fn peak_memory_mib() -> Result<f64> {
    let status = std::fs::read_to_string("/proc/self/status").context("/proc/self/status: memory is told by Linux")?;
    let kib =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<f64>().ok());
    Ok(kib.context("/proc/self/status: VmHWM")? / 1024.0)
}
