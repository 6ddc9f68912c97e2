//! Build, processor, memory, and the folder for runs.

use std::path::Path;

use anyhow::Context;
use hksl_train::config::{Config, Request, resolve};

use super::finding::Finding;

const GIB: f64 = (1_u64 << 30) as f64;

/// What this program is.
pub fn build() -> Finding {
    let feature = |compiled: bool| if compiled { "yes" } else { "no" };
    let found = format!(
        "hksl {}, features: mujoco {}, cuda {}",
        env!("CARGO_PKG_VERSION"),
        feature(cfg!(feature = "mujoco")),
        feature(cfg!(feature = "cuda")),
    );
    if cfg!(debug_assertions) {
        return Finding::warn("build", format!("{found}, unoptimised"), "build with --release");
    }
    Finding::ok("build", found)
}

/// Cores and vector instructions.
pub fn processor() -> Finding {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let found = format!(
        "{}, {cores} logical core{}; {}",
        std::env::consts::ARCH,
        if cores == 1 { "" } else { "s" },
        vector_instructions()
    );
    if cores == 1 {
        return Finding::warn("CPU", found, "a run of the paper's size will take days");
    }
    Finding::ok("CPU", found)
}

#[cfg(target_arch = "x86_64")]
fn vector_instructions() -> String {
    let found: Vec<_> = [
        ("AVX2", std::is_x86_feature_detected!("avx2")),
        ("FMA", std::is_x86_feature_detected!("fma")),
        ("AVX-512F", std::is_x86_feature_detected!("avx512f")),
    ]
    .into_iter()
    .map(|(name, present)| if present { name.to_owned() } else { format!("no {name}") })
    .collect();
    found.join(", ")
}

#[cfg(not(target_arch = "x86_64"))]
fn vector_instructions() -> String {
    "vector instructions not examined".to_owned()
}

/// Memory, against what the replay of the largest task takes.
pub fn memory() -> Finding {
    let Ok(text) = std::fs::read_to_string("/proc/meminfo") else {
        return Finding::ok("memory", "unknown on this system");
    };
    let (Some(total), Some(available)) = (bytes(&text, "MemTotal"), bytes(&text, "MemAvailable"))
    else {
        return Finding::ok("memory", "unknown: /proc/meminfo does not say");
    };
    let found = format!("{:.1} GiB free of {:.1} GiB", available / GIB, total / GIB);
    match largest_replay() {
        Some((config, needed)) if needed > available => {
            let advice = format!(
                "a full replay of {} holds about {:.1} GiB of frames; lower --set \
                 replay.capacity={}, or close something",
                config.task,
                needed / GIB,
                config.replay.capacity,
            );
            Finding::warn("memory", found, advice)
        }
        _ => Finding::ok("memory", found),
    }
}

/// A figure of /proc/meminfo, which counts kibibytes.
fn bytes(text: &str, name: &str) -> Option<f64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    let kibibytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024.0)
}

/// The task of this build whose frames fill the most memory, and how many bytes.
fn largest_replay() -> Option<(Config, f64)> {
    let available = hksl_envs::tasks().iter().filter(|info| info.available);
    let sized = available.filter_map(|info| {
        let request = Request { task: Some(info.name.to_owned()), ..Request::default() };
        let config = resolve(&request).ok()?.config;
        let channels = if info.needs_mujoco { 3 } else { 1 };
        let frame = channels * config.environment.height * config.environment.width;
        let bytes = config.replay.capacity as f64 * frame as f64;
        Some((config, bytes))
    });
    sized.max_by(|(_, a), (_, b)| a.total_cmp(b))
}

/// Whether runs can be written there; leaves nothing behind.
pub fn runs_folder(folder: &Path) -> Finding {
    match try_to_write(folder) {
        Ok(()) if folder.is_dir() => {
            Finding::ok("runs folder", format!("{} can be written", folder.display()))
        }
        Ok(()) => Finding::ok("runs folder", format!("{} can be created", folder.display())),
        Err(error) => Finding::fail("runs folder", &error)
            .with_advice("choose another folder, or change its owner or permissions"),
    }
}

/// Writes and removes a file in the folder, or where its first missing part would be created.
fn try_to_write(folder: &Path) -> anyhow::Result<()> {
    let existing = folder.ancestors().find(|part| part.exists()).unwrap_or(Path::new("."));
    let existing = if existing.as_os_str().is_empty() { Path::new(".") } else { existing };
    let probe = existing.join(format!(".hksl-doctor-{}", std::process::id()));
    let written = std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe));
    written.with_context(|| format!("{} cannot be written", folder.display()))
}

#[cfg(test)]
mod tests {
    use crate::commands::doctor::finding::exit_code;
    use crate::exit::Code;

    use super::*;

    #[test]
    fn reads_kibibytes_by_name() {
        let text = "MemTotal:       16384 kB\nMemAvailable:    1024 kB\n";
        assert_eq!(bytes(text, "MemTotal"), Some(16384.0 * 1024.0));
        assert_eq!(bytes(text, "MemAvailable"), Some(1024.0 * 1024.0));
        assert_eq!(bytes(text, "Mem"), None);
        assert_eq!(bytes("MemTotal: many kB", "MemTotal"), None);
    }

    #[test]
    fn a_runs_folder_is_tried_and_left_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().join("a/b");
        assert!(runs_folder(&runs).is_fine());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let file = folder.path().join("file");
        std::fs::write(&file, b"").unwrap();
        let finding = runs_folder(&file.join("runs"));
        assert_eq!(exit_code(&[finding]), Code::Failure);
    }

    #[test]
    fn the_largest_replay_is_that_of_the_largest_frames() {
        let (config, bytes) = largest_replay().unwrap();
        let pixels = if cfg!(feature = "mujoco") { 84.0 * 84.0 * 3.0 } else { 35.0 * 15.0 };
        assert_eq!(bytes, 100_000.0 * pixels, "{}", config.task);
    }
}
