//! What the process holds in memory.

/// Bytes to a page: Linux on x86-64 and on most of AArch64.
const PAGE_BYTES: u64 = 4096;

/// Resident set of the process, bytes; `None` where the system does not tell in Linux's way.
#[must_use]
pub fn resident_bytes() -> Option<u64> {
    let pages = std::fs::read_to_string("/proc/self/statm").ok()?;
    Some(pages.split_whitespace().nth(1)?.parse::<u64>().ok()? * PAGE_BYTES)
}
