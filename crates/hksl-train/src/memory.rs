//! The machine's memory, and how much of it new work can have.

/// Bytes of memory, as the system tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SystemMemory {
    /// What the machine has.
    pub total: u64,
    /// What new work can have: what the machine has free, or what this process's control group leaves of its limit
    /// if that is less.
    pub available: u64,
    /// The limit of this process's control group, where it has one.
    pub limit: Option<u64>,
}

impl SystemMemory {
    /// Asks the system; none where it does not tell.
    pub fn read() -> Option<Self> {
        let machine = Self::of_machine(&std::fs::read_to_string("/proc/meminfo").ok()?)?;
        Some(match control_group() {
            Some((limit, left)) => {
                Self { available: left.min(machine.available), limit: Some(limit), ..machine }
            }
            None => machine,
        })
    }

    fn of_machine(text: &str) -> Option<Self> {
        let (total, available) = (meminfo(text, "MemTotal:")?, meminfo(text, "MemAvailable:")?);
        Some(Self { total, available, limit: None })
    }
}

/// A figure of /proc/meminfo, which counts kibibytes.
fn meminfo(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// The limit of the control group (version 2), and what it leaves, file caches counted as free; none without a limit.
fn control_group() -> Option<(u64, u64)> {
    let group = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let group = group.lines().find_map(|line| line.strip_prefix("0::"))?.to_owned();
    let read = |file: &str| {
        std::fs::read_to_string(format!("/sys/fs/cgroup{}/{file}", group.trim_end_matches('/')))
            .ok()
    };
    let limit: u64 = read("memory.max")?.trim().parse().ok()?;
    let used: u64 = read("memory.current")?.trim().parse().ok()?;
    Some((limit, left(limit, used, &read("memory.stat")?)))
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
        let machine = SystemMemory::of_machine("MemTotal: 90 kB\nMemAvailable:   12 kB\n");
        let expected = SystemMemory { total: 92160, available: 12288, limit: None };
        assert_eq!(machine, Some(expected));
        assert_eq!(SystemMemory::of_machine("MemTotal: 9 kB\n"), None);
        assert_eq!(SystemMemory::of_machine("MemTotal: 9 kB\nMemAvailable: many kB\n"), None);
        assert_eq!(left(1000, 700, "anon 600\ninactive_file 100\n"), 400);
        assert_eq!(left(1000, 2000, ""), 0);
    }
}
