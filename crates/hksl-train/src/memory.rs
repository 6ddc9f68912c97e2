//! The machine's memory, and how much of it new work can have.

mod limits;
pub(crate) mod process;

use std::fmt;
use std::path::Path;

/// Bytes of memory, as the system tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SystemMemory {
    /// What the machine has.
    pub total: u64,
    /// What new work can have: what the machine has free, or what is left of the tightest limit if that is less.
    pub available: u64,
    /// The limit that leaves the least, where there is one: of this process's control group or one above it, of its
    /// address space, or of its data.
    pub limit: Option<MemoryLimit>,
}

/// A limit of memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryLimit {
    /// Bytes in all.
    pub bytes: u64,
    /// What sets it.
    pub by: LimitedBy,
}

/// What limits a process's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LimitedBy {
    /// A control group: a container or a batch system's job.
    ControlGroup,
    /// `ulimit -v`: everything that is mapped, files included.
    AddressSpace,
    /// `ulimit -d`: everything that is allocated.
    Data,
}

impl fmt::Display for LimitedBy {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::ControlGroup => "the memory limit of the container or the job",
            Self::AddressSpace => "the address space limit (ulimit -v)",
            Self::Data => "the data segment limit (ulimit -d)",
        })
    }
}

impl SystemMemory {
    /// Asks the system; none where it does not tell.
    pub fn read() -> Option<Self> {
        let machine = Self::of_machine(&std::fs::read_to_string("/proc/meminfo").ok()?)?;
        let group = control_group().map(|(bytes, left)| {
            let by = LimitedBy::ControlGroup;
            (MemoryLimit { bytes, by }, left)
        });
        let tightest = group.into_iter().chain(limits::of_process()).min_by_key(|(_, left)| *left);
        Some(match tightest {
            Some((limit, left)) => {
                Self { available: left.min(machine.available), limit: Some(limit), ..machine }
            }
            None => machine,
        })
    }

    /// The limit, if it and not the machine decides what is available.
    pub fn binding_limit(&self) -> Option<MemoryLimit> {
        self.limit.filter(|limit| limit.bytes < self.total)
    }

    fn of_machine(text: &str) -> Option<Self> {
        let (total, available) = (meminfo(text, "MemTotal:")?, meminfo(text, "MemAvailable:")?);
        Some(Self { total, available, limit: None })
    }
}

/// A figure of /proc/meminfo or /proc/self/status, which count kibibytes.
fn meminfo(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// The files of a control group's memory, by version of the interface.
struct Names {
    limit: &'static str,
    used: &'static str,
    /// In `memory.stat`: file caches that can be given up.
    cached: &'static str,
}

const VERSION_1: Names = Names {
    limit: "memory.limit_in_bytes",
    used: "memory.usage_in_bytes",
    cached: "total_inactive_file ",
};
const VERSION_2: Names =
    Names { limit: "memory.max", used: "memory.current", cached: "inactive_file " };

/// The limit of the control group that leaves the least, and what it leaves, file caches counted as free; none without
/// a limit. A batch system may limit the job and not the process's own group, so all groups above count.
fn control_group() -> Option<(u64, u64)> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let found = groups.lines().filter_map(|line| {
        let (controllers, group) = line.split_once(':')?.1.split_once(':')?;
        let (base, names) = match controllers {
            "" => ("/sys/fs/cgroup", VERSION_2),
            _ if controllers.split(',').any(|of| of == "memory") => {
                ("/sys/fs/cgroup/memory", VERSION_1)
            }
            _ => return None,
        };
        tightest(Path::new(base), Path::new(group.trim_start_matches('/')), &names)
    });
    found.min_by_key(|(_, left)| *left)
}

/// The same of a group and those above it, up to the root.
fn tightest(base: &Path, group: &Path, names: &Names) -> Option<(u64, u64)> {
    let found = group.ancestors().filter_map(|group| {
        let read = |file: &str| std::fs::read_to_string(base.join(group).join(file)).ok();
        let number = |file: &str| read(file)?.trim().parse::<u64>().ok();
        // `max` where there is none, or in version 1 a number beyond any machine.
        let limit = number(names.limit).filter(|limit| *limit < 1 << 60)?;
        let statistics = read("memory.stat").unwrap_or_default();
        Some((limit, left(limit, number(names.used)?, &statistics, names.cached)))
    });
    found.min_by_key(|(_, left)| *left)
}

fn left(limit: u64, used: u64, statistics: &str, cached: &str) -> u64 {
    let cached = statistics.lines().find_map(|line| line.strip_prefix(cached));
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
        let cached = VERSION_2.cached;
        assert_eq!(left(1000, 700, "anon 600\ninactive_file 100\n", cached), 400);
        assert_eq!(left(1000, 2000, "", cached), 0);
    }

    #[test]
    fn the_group_that_leaves_the_least_counts() {
        let base = tempfile::tempdir().unwrap();
        let group = Path::new("job/step/task");
        let write = |of: &str, file: &str, text: &str| {
            let folder = base.path().join(of);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join(file), text).unwrap();
        };
        assert_eq!(tightest(base.path(), group, &VERSION_2), None);
        for (of, limit, used) in [("job", "1000\n", "600\n"), ("job/step/task", "max\n", "500\n")] {
            write(of, VERSION_2.limit, limit);
            write(of, VERSION_2.used, used);
        }
        assert_eq!(tightest(base.path(), group, &VERSION_2), Some((1000, 400)));
        write("job/step", VERSION_2.limit, "900\n");
        write("job/step", VERSION_2.used, "600\n");
        assert_eq!(tightest(base.path(), group, &VERSION_2), Some((900, 300)));
        // In version 1 no limit is a large one.
        write("", VERSION_1.limit, "9223372036854771712\n");
        write("", VERSION_1.used, "600\n");
        assert_eq!(tightest(base.path(), group, &VERSION_1), None);
    }
}
