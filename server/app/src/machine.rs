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
