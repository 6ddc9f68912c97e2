//! Lock that allows one writing process per run.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::Path;
use std::time::Duration;

use crate::{Error, Result};

const FILE: &str = "lock";

/// The lock of a run's folder. The system releases it when the process ends, even if it is killed.
#[derive(Debug)]
pub struct RunLock {
    /// Holds the lock for as long as it is open.
    file: File,
}

impl RunLock {
    /// Takes the lock of the run in this folder.
    ///
    /// # Errors
    /// [`Error::Locked`] while another process has it; [`Error::NoLocks`]; a folder that cannot be written.
    pub(crate) fn take(folder: &Path) -> Result<Self> {
        let path = folder.join(FILE);
        let wrap = |source| Error::write(&path, source);
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(&path).map_err(wrap)?;
        match patiently(&file) {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                // The contents only help to find the process.
                let _ = file.read_to_string(&mut holder);
                let holder = holder.trim().to_owned();
                return Err(Error::Locked { folder: folder.to_owned(), holder });
            }
            Err(TryLockError::Error(source)) => {
                return Err(Error::NoLocks { folder: folder.to_owned(), source });
            }
        }
        let written = file.set_len(0).and_then(|()| file.rewind());
        let written =
            written.and_then(|()| writeln!(file, "process {}{}", std::process::id(), on_host()));
        written.map_err(wrap)?;
        Ok(Self { file })
    }
}

impl RunLock {
    /// Whether a process holds the lock of the run in this folder.
    pub(crate) fn is_taken(folder: &Path) -> bool {
        let Ok(file) = File::open(folder.join(FILE)) else { return false };
        // The holder writes its id into the file; a killed process leaves it there. This check takes a shared lock, which
        // is released when the file is closed.
        let nobody = file.metadata().is_ok_and(|file| file.len() == 0);
        !nobody && matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock))
    }
}

/// Takes the lock, and retries briefly in case another process is only checking it.
fn patiently(file: &File) -> std::result::Result<(), TryLockError> {
    for _ in 0..10 {
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(10)),
            other => return other,
        }
    }
    file.try_lock()
}

impl Drop for RunLock {
    fn drop(&mut self) {
        // An empty file means unlocked; closing the file releases the lock.
        let _ = self.file.set_len(0);
    }
}

/// Host name of this process, because several machines may share a folder.
fn on_host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    if name.trim().is_empty() { String::new() } else { format!(" on {}", name.trim()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time_and_free_again() {
        let folder = tempfile::tempdir().unwrap();
        let first = RunLock::take(folder.path()).unwrap();
        let message = RunLock::take(folder.path()).unwrap_err().to_string();
        assert!(message.contains(&format!("process {}", std::process::id())), "{message}");
        assert!(RunLock::is_taken(folder.path()));
        drop(first);
        assert!(!RunLock::is_taken(folder.path()));
        // A process that checks the file of a dead process holds it only briefly.
        std::fs::write(folder.path().join(FILE), "process 1 on nowhere\n").unwrap();
        let looked_at = File::open(folder.path().join(FILE)).unwrap();
        looked_at.try_lock_shared().unwrap();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                std::thread::sleep(Duration::from_millis(30));
                drop(looked_at);
            });
            RunLock::take(folder.path()).unwrap();
        });
        assert!(!RunLock::is_taken(folder.path()));
        // The file of a dead process does not block the run.
        std::fs::write(folder.path().join(FILE), "process 1 on nowhere\n").unwrap();
        RunLock::take(folder.path()).unwrap();
    }
}
