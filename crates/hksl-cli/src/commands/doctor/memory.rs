//! Checks memory against the needs of the largest run.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use hksl_train::config::{Config, Request, resolve};
use hksl_train::memory::SystemMemory;
use hksl_train::{Plan, Registry, Resume, RunFolder, RunId, preview};

use super::finding::Finding;
use crate::numbers::bytes;

/// Estimated needs of the run with the largest replay buffer.
#[derive(Debug)]
pub struct LargestRun {
    /// Its task.
    pub task: String,
    /// Bytes of memory, if the system tells.
    pub memory: Option<u64>,
    /// Bytes of disk.
    pub disk: u64,
}

impl LargestRun {
    /// The largest run among the tasks of this build; none if no task works.
    pub fn of_this_build() -> Option<Self> {
        by_replay().iter().find_map(Self::of)
    }

    fn of(config: &Config) -> Option<Self> {
        // No run can have this name, so no existing run is read.
        let id = RunId { name: Some(".doctor".to_owned()), ..RunId::default() };
        let plan = Plan {
            config,
            folder: &RunFolder::of(Path::new(""), config, &id),
            factories: &Registry,
            device: candle_core::Device::Cpu,
            command: String::new(),
            resume: Resume::Never,
            stop: &AtomicBool::new(false),
        };
        let summary = preview(&plan).ok()?;
        let memory = summary.memory_bytes();
        Some(Self { task: summary.task, memory, disk: summary.disk_bytes })
    }
}

/// This build's tasks, in descending order of replay buffer size.
fn by_replay() -> Vec<Config> {
    let available = hksl_envs::tasks().iter().filter(|info| info.available);
    let mut sized: Vec<_> = available
        .filter_map(|info| {
            // Orthogonal initialisation takes seconds, and only the sizes matter here.
            let sets = vec!["hksl.initialisation=uniform".to_owned()];
            let request = Request { task: Some(info.name.to_owned()), sets, ..Request::default() };
            let config = resolve(&request).ok()?.config;
            let channels = if info.needs_mujoco { 3 } else { 1 };
            let [height, width] = config.frame_size();
            let frame = (channels * height * width) as u64;
            let stored = config.budget_agent_steps().min(config.replay.capacity as u64);
            Some((stored * frame, config))
        })
        .collect();
    sized.sort_by_key(|(pixels, _)| std::cmp::Reverse(*pixels));
    sized.into_iter().map(|(_, config)| config).collect()
}

/// Checks whether the largest run fits.
pub fn examine(memory: Option<SystemMemory>, largest: Option<&LargestRun>) -> Finding {
    let Some(memory) = memory else { return Finding::ok("memory", "unknown on this system") };
    let SystemMemory { total, available, .. } = memory;
    let limit = memory.binding_limit();
    let mut found = format!("{} free of {}", bytes(available), bytes(total));
    if let Some(limit) = limit {
        found.push_str(&format!(", this process limited to {}", bytes(limit.bytes)));
    }
    let Some((task, needed)) = largest.and_then(|run| Some((&run.task, run.memory?))) else {
        return Finding::ok("memory", found);
    };
    found.push_str(&format!("; a run of {task} needs about {}", bytes(needed)));
    if needed <= available {
        return Finding::ok("memory", found);
    }
    let limited = limit.map_or_else(String::new, |limit| format!(", or raise {}", limit.by));
    let advice = format!(
        "close other programs, keep replay buffers on disk (--set replay.storage=file), or lower \
         replay.capacity{limited}"
    );
    Finding::warn("memory", found, advice)
}

#[cfg(test)]
mod tests {
    use hksl_train::memory::{LimitedBy, MemoryLimit};

    use super::*;

    #[test]
    fn memory_is_held_against_the_largest_run() {
        let run = LargestRun { task: "walker-walk".into(), memory: Some(3_000_000_000), disk: 0 };
        let memory =
            |available| Some(SystemMemory { total: 8_000_000_000, available, limit: None });
        assert!(examine(memory(3_000_000_000), Some(&run)).is_fine());
        assert!(!examine(memory(2_999_999_999), Some(&run)).is_fine());
        assert!(examine(memory(0), None).is_fine());
        assert!(examine(None, Some(&run)).is_fine());
    }

    #[test]
    fn a_limit_is_told_where_it_is_less_than_the_machine_has() {
        let text = |limit| {
            let limit = Some(MemoryLimit { bytes: limit, by: LimitedBy::Data });
            let memory = SystemMemory { total: 8_000_000_000, available: 1, limit };
            let mut out = Vec::new();
            examine(Some(memory), None).write(&mut out).unwrap();
            String::from_utf8(out).unwrap()
        };
        assert!(text(2_000_000_000).contains("limited to 2.0 GB"));
        assert!(!text(9_000_000_000).contains("limited"));
    }

    #[test]
    fn the_largest_run_has_the_largest_frames() {
        let config = by_replay().into_iter().next().unwrap();
        let pixels = if cfg!(feature = "mujoco") { 3 * 84 * 84 } else { 35 * 15 };
        let run = LargestRun::of(&config).unwrap();
        assert!(run.disk > 50_000 * pixels && run.memory.unwrap() > 50_000 * pixels, "{run:?}");
        assert_eq!(run.task, config.task);
    }
}
