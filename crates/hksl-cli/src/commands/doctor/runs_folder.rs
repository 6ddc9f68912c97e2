//! Checks the runs folder: access, file locks, write speed and free space.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use super::finding::Finding;
use super::memory::LargestRun;
use crate::numbers::bytes;

const MEBIBYTE: usize = 1 << 20;
/// Mebibytes to write, enough to measure a disk.
const MOST: u64 = 64;
/// Time after which no further write starts. A pending write takes about as long again.
const PATIENCE: Duration = Duration::from_millis(500);
/// Bytes per second below which saving is slow.
const SLOW: f64 = 20e6;
/// Number of files to create for the timing.
const FILES: u32 = 5;

/// How fast a folder can be written.
#[derive(Debug)]
struct Speed {
    /// Bytes written and synced.
    bytes: u64,
    /// Duration of these writes.
    writing: Duration,
    /// Duration of creating and syncing one named file.
    making: Duration,
}

impl Speed {
    fn bytes_per_second(&self) -> f64 {
        self.bytes as f64 / self.writing.as_secs_f64().max(1e-9)
    }
}

/// Checks the folder and leaves no files behind.
pub fn examine(folder: &Path, largest: Option<&LargestRun>) -> Vec<Finding> {
    let place = existing_part(folder);
    let speed = measure(place).with_context(|| format!("cannot write {}", folder.display()));
    let speed = match speed {
        Ok(speed) => speed,
        Err(error) => {
            let advice = "choose another folder with --runs, change its owner or permissions, or \
                          free space on its disk";
            return vec![Finding::fail("runs folder", &error, advice)];
        }
    };
    let verb = if folder.is_dir() { "written" } else { "created" };
    let shown = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    vec![
        Finding::ok("runs folder", format!("{} can be {verb}", shown.display())),
        judge_locks(place),
        judge_speed(&speed),
        judge_space(free_space(place), largest),
    ]
}

/// The folder, or its nearest existing ancestor.
fn existing_part(folder: &Path) -> &Path {
    let existing = folder.ancestors().find(|part| part.exists());
    existing.filter(|part| !part.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn measure(folder: &Path) -> io::Result<Speed> {
    // Unnamed where the system supports it, so that it cannot be left behind.
    let mut file = tempfile::tempfile_in(folder)?;
    let (bytes, writing) = fill(&mut file, PATIENCE)?;
    let start = Instant::now();
    for _ in 0..FILES {
        let named = tempfile::Builder::new().prefix(".hksl-doctor-").tempfile_in(folder)?;
        named.as_file().sync_all()?;
    }
    Ok(Speed { bytes, writing, making: start.elapsed() / FILES })
}

/// Writes until `patience` is over or enough is written. Returns the bytes and the duration.
fn fill(file: &mut File, patience: Duration) -> io::Result<(u64, Duration)> {
    // Random bytes cannot be compressed by the file system.
    let mut piece = vec![0; MEBIBYTE];
    ChaCha8Rng::seed_from_u64(0).fill_bytes(&mut piece);
    let start = Instant::now();
    let (mut written, mut next) = (0, 1);
    loop {
        for _ in 0..next {
            file.write_all(&piece)?;
        }
        file.sync_data()?;
        written += next;
        let time = start.elapsed();
        if written >= MOST || time >= patience {
            return Ok((written * MEBIBYTE as u64, time));
        }
        // Doubling the total keeps writes to a slow disk short.
        next = written;
    }
}

/// Checks file locks, which keep two processes from writing one run.
fn judge_locks(folder: &Path) -> Finding {
    let locked = tempfile::tempfile_in(folder).and_then(|file| Ok(file.try_lock()?));
    match locked.context("files cannot be locked in this folder") {
        Ok(()) => Finding::ok("file locks", "supported"),
        Err(error) => {
            let advice = "choose a folder on another file system with --runs, or mount this one with locks \
                          (Lustre: flock; NFS 3: a running lock service)";
            Finding::fail("file locks", &error, advice)
        }
    }
}

fn judge_speed(speed: &Speed) -> Finding {
    let found = format!(
        "{}/s ({} in {:.2} s), creating a file takes {:.1} ms",
        bytes(speed.bytes_per_second() as u64),
        bytes(speed.bytes),
        speed.writing.as_secs_f64(),
        speed.making.as_secs_f64() * 1e3
    );
    if speed.bytes_per_second() < SLOW {
        let advice = "saving waits for this disk: choose a faster one with --runs, or save \
                      less often (--set checkpoint.minutes=60)";
        return Finding::warn("write speed", found, advice);
    }
    Finding::ok("write speed", found)
}

#[cfg(unix)]
fn free_space(folder: &Path) -> Option<u64> {
    let statistics = rustix::fs::statvfs(folder).ok()?;
    Some(statistics.f_bavail.saturating_mul(statistics.f_frsize))
}

#[cfg(not(unix))]
fn free_space(_: &Path) -> Option<u64> {
    None
}

fn judge_space(free: Option<u64>, largest: Option<&LargestRun>) -> Finding {
    let Some(free) = free else { return Finding::ok("disk space", "unknown on this system") };
    let found = format!("{} free", bytes(free));
    let Some(LargestRun { task, disk, .. }) = largest else {
        return Finding::ok("disk space", found);
    };
    let found = format!("{found}; a run of {task} needs up to {}", bytes(*disk));
    if free < *disk {
        let advice = "free space, choose another disk with --runs, or lower replay.capacity";
        return Finding::warn("disk space", found, advice);
    }
    Finding::ok("disk space", found)
}

#[cfg(test)]
mod tests {
    use crate::commands::doctor::finding::exit_code;
    use crate::exit::Code;

    use super::*;

    #[test]
    fn a_runs_folder_is_tried_and_left_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let findings = examine(&folder.path().join("a/b"), None);
        assert_eq!((findings.len(), exit_code(&findings)), (4, Code::Done));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let file = folder.path().join("file");
        std::fs::write(&file, b"").unwrap();
        for not_a_folder in [file.clone(), file.join("runs")] {
            assert_eq!(exit_code(&examine(&not_a_folder, None)), Code::Failure);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_is_counted_was_written_and_a_slow_disk_is_soon_left_alone() {
        for (patience, mebibytes) in [(Duration::ZERO, 1), (Duration::MAX, MOST)] {
            let mut file = tempfile::tempfile().unwrap();
            assert_eq!(fill(&mut file, patience).unwrap().0, mebibytes * MEBIBYTE as u64);
            assert_eq!(file.metadata().unwrap().len(), mebibytes * MEBIBYTE as u64);
        }
    }

    #[test]
    fn a_slow_disk_and_a_full_one_are_told() {
        let speed = |bytes| Speed {
            bytes,
            writing: Duration::from_secs(1),
            making: Duration::from_millis(1),
        };
        assert!(judge_speed(&speed(20_000_000)).is_fine());
        assert!(!judge_speed(&speed(19_999_999)).is_fine());
        let run = LargestRun { task: "t".into(), memory: Some(0), disk: 1_000_000_000 };
        assert!(judge_space(Some(1_000_000_000), Some(&run)).is_fine());
        assert!(!judge_space(Some(999_999_999), Some(&run)).is_fine());
        assert!(judge_space(None, Some(&run)).is_fine());
        assert!(judge_space(Some(0), None).is_fine());
    }

    #[cfg(unix)]
    #[test]
    fn free_space_is_that_of_the_folders_disk() {
        let folder = tempfile::tempdir().unwrap();
        assert!(free_space(folder.path()).unwrap() > 0);
        assert_eq!(free_space(&folder.path().join("absent")), None);
    }

    #[test]
    fn the_part_that_exists_is_tried() {
        assert_eq!(existing_part(Path::new("no-such-folder/runs")), Path::new("."));
        assert_eq!(existing_part(Path::new("/no-such-folder/runs")), Path::new("/"));
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(existing_part(folder.path()), folder.path());
    }
}
