//! Whether the machine has the memory that a run will take.

use super::Summary;
use crate::config::ReplayStorage;
use crate::{Error, Result};

/// What the process takes before it learns: code, drawing, MuJoCo.
const PROCESS_BYTES: u64 = 150_000_000;

impl Summary {
    /// Bytes of memory that the run will take at most, estimated; on a GPU most of it there.
    pub fn memory_bytes(&self) -> u64 {
        let replay = match self.replay_storage {
            ReplayStorage::Memory => self.replay_bytes,
            ReplayStorage::File => 0,
        };
        replay + self.learning_bytes + PROCESS_BYTES
    }

    /// # Errors
    /// [`Error::Memory`] if a run on the CPU needs more than is free.
    pub(super) fn check_memory(&self) -> Result<()> {
        match self.available_bytes {
            Some(available) if self.device == "cpu" && available < self.memory_bytes() => {
                let needed = self.memory_bytes();
                let replay = needed - self.learning_bytes - PROCESS_BYTES;
                Err(Error::Memory { needed, replay, available })
            }
            _ => Ok(()),
        }
    }
}

/// Bytes of memory that new work can have: what the machine has free, or what this process's control group
/// leaves of its limit if that is less.
pub(super) fn available() -> Option<u64> {
    let machine = meminfo(&std::fs::read_to_string("/proc/meminfo").ok()?)?;
    Some(control_group().map_or(machine, |group| group.min(machine)))
}

fn meminfo(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// What the control group (version 2) leaves, file caches counted as free; none without a limit.
fn control_group() -> Option<u64> {
    let group = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let group = group.lines().find_map(|line| line.strip_prefix("0::"))?.to_owned();
    let read = |file: &str| {
        std::fs::read_to_string(format!("/sys/fs/cgroup{}/{file}", group.trim_end_matches('/')))
            .ok()
    };
    let limit: u64 = read("memory.max")?.trim().parse().ok()?;
    let used: u64 = read("memory.current")?.trim().parse().ok()?;
    Some(left(limit, used, &read("memory.stat")?))
}

fn left(limit: u64, used: u64, statistics: &str) -> u64 {
    let cached = statistics.lines().find_map(|line| line.strip_prefix("inactive_file "));
    let cached: u64 = cached.and_then(|text| text.trim().parse().ok()).unwrap_or(0);
    limit.saturating_sub(used.saturating_sub(cached))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_what_the_system_says() {
        assert_eq!(meminfo("MemTotal: 9 kB\nMemAvailable:   12 kB\n"), Some(12288));
        assert_eq!(meminfo("MemTotal: 9 kB\n"), None);
        assert_eq!(left(1000, 700, "anon 600\ninactive_file 100\n"), 400);
        assert_eq!(left(1000, 2000, ""), 0);
    }
}
