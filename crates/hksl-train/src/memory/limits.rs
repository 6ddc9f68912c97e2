//! The limits that a process has of itself, as `ulimit` sets them.

#[cfg(unix)]
use rustix::process::{Resource, getrlimit};

use super::{LimitedBy, MemoryLimit, meminfo};

/// The limit that leaves the least, and what it leaves: address space and data, less what this process has of them.
#[cfg(unix)]
pub(super) fn of_process() -> Option<(MemoryLimit, u64)> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let limits = [
        (Resource::As, "VmSize:", LimitedBy::AddressSpace),
        (Resource::Data, "VmData:", LimitedBy::Data),
    ];
    let found = limits.into_iter().filter_map(|(resource, used, by)| {
        let bytes = getrlimit(resource).current?;
        Some((MemoryLimit { bytes, by }, left(bytes, &status, used)))
    });
    found.min_by_key(|(_, left)| *left)
}

/// Other systems have no such limits.
#[cfg(not(unix))]
pub(super) fn of_process() -> Option<(MemoryLimit, u64)> {
    None
}

fn left(limit: u64, status: &str, used: &str) -> u64 {
    limit.saturating_sub(meminfo(status, used).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_in_use_is_taken_off() {
        let status = "VmPeak:\t   90000 kB\nVmSize:\t   80000 kB\nVmData:\t   30000 kB\n";
        assert_eq!(left(100_000 * 1024, status, "VmSize:"), 20_000 * 1024);
        assert_eq!(left(100_000 * 1024, status, "VmData:"), 70_000 * 1024);
        assert_eq!(left(1024, status, "VmSize:"), 0);
        assert_eq!(left(1024, "", "VmSize:"), 1024);
    }
}
