//! The process, by the names that all of Prometheus's clients give it; read from `/proc`, and left out where it is not.

use std::fmt;
use std::fs::{read_dir, read_to_string};

use prometheus_client::registry::Unit::{Bytes, Seconds};

use super::page::Page;

/// Ticks a second in which the kernel tells times to programs: 100 on all x86 and Arm machines.
const TICKS_PER_S: f64 = 100.0;
/// Bytes of a page of memory on x86-64.
const PAGE_BYTES: u64 = 4096;

pub fn write(page: &mut Page<'_>) -> fmt::Result {
    let told = |path: &str| read_to_string(path).unwrap_or_default();
    if let Some(own) = Process::parse(&told("/proc/self/stat")) {
        page.counter(("process_cpu", Some(Seconds), "Processor time of the process."), own.cpu_s)?;
        page.gauge(("process_resident_memory", Some(Bytes), "Memory that the process has."), own.resident_bytes)?;
        page.gauge(("process_virtual_memory", Some(Bytes), "Addresses that the process has."), own.virtual_bytes)?;
        let boot_s =
            told("/proc/stat").lines().find_map(|line| line.strip_prefix("btime ")?.trim().parse::<f64>().ok());
        let help = "When the process began, seconds since 1970.";
        page.gauge(("process_start_time", Some(Seconds), help), boot_s.unwrap_or_default() + own.since_boot_s)?;
    }
    let open = read_dir("/proc/self/fd").map_or(0, Iterator::count);
    page.gauge(("process_open_fds", None, "File descriptors that are open."), open)?;
    let limit = max_fds(&told("/proc/self/limits"));
    page.gauge(("process_max_fds", None, "File descriptors that may be open."), limit.unwrap_or(f64::INFINITY))
}

/// What `/proc/self/stat` says.
#[derive(Debug, PartialEq)]
struct Process {
    cpu_s: f64,
    since_boot_s: f64,
    virtual_bytes: u64,
    resident_bytes: u64,
}

impl Process {
    fn parse(stat: &str) -> Option<Self> {
        // The second field is the program's name in parentheses, whatever is in it; the third comes first here.
        let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
        let field = |number: usize| fields.get(number - 3)?.parse::<u64>().ok();
        let seconds = |ticks: u64| ticks as f64 / TICKS_PER_S;
        Some(Self {
            cpu_s: seconds(field(14)? + field(15)?),
            since_boot_s: seconds(field(22)?),
            virtual_bytes: field(23)?,
            resident_bytes: field(24)? * PAGE_BYTES,
        })
    }
}

fn max_fds(limits: &str) -> Option<f64> {
    let line = limits.lines().find_map(|line| line.strip_prefix("Max open files"))?;
    line.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_read_whatever_its_name() {
        let stat = "7 (a) b) S 1 7 7 0 -1 4194560 9 0 0 0 150 50 0 0 20 0 3 0 1200 8192000 25 18446744073709551615";
        let expected = Process { cpu_s: 2.0, since_boot_s: 12.0, virtual_bytes: 8_192_000, resident_bytes: 25 * 4096 };
        assert_eq!(Process::parse(stat), Some(expected));
        assert_eq!(Process::parse("7 (a) S 1"), None);
    }

    #[test]
    fn descriptors_are_limited_or_not() {
        assert_eq!(max_fds("Max processes  1  1\nMax open files            1024   4096  files\n"), Some(1024.0));
        assert_eq!(max_fds("Max open files            unlimited   unlimited  files\n"), None);
    }
}
