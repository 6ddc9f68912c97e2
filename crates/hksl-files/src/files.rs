//! Atomic writes, and reads that detect damage.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::digest::sha256;
use crate::disk::{Disk, FileSystem};
use crate::{Error, Result};

/// Prefix of an incomplete file or folder.
const NEW: &str = ".new-";
/// Prefix of a replaced file or folder, restored if its successor is missing.
const OLD: &str = ".old-";
/// Prefix of a file or folder that is being removed.
const GONE: &str = ".gone-";

/// Writes to a disk.
#[derive(Debug)]
pub struct Files {
    disk: Box<dyn Disk>,
}

impl Default for Files {
    /// Writes to the file system.
    fn default() -> Self {
        Self::on(Box::new(FileSystem))
    }
}

impl Files {
    /// Writes to this disk.
    pub fn on(disk: Box<dyn Disk>) -> Self {
        Self { disk }
    }

    /// Creates an empty folder next to `target`, to be filled and then published in its place.
    pub fn aside(&self, target: &Path) -> Result<PathBuf> {
        let aside = with_prefix(target, NEW);
        self.remove(&aside)?;
        self.create_folder(&aside)?;
        Ok(aside)
    }

    /// Moves a filled folder to its place. Its files must be synced; the rename is synced here.
    pub fn publish(&self, aside: &Path, target: &Path) -> Result<()> {
        self.sync(aside)?;
        let old = with_prefix(target, OLD);
        self.remove(&old)?;
        let replaces = target.is_dir();
        if replaces {
            self.rename(target, &old)?;
        }
        let published = self.rename(aside, target);
        if published.is_err() && replaces && !target.exists() {
            // Move the old folder back; if that fails too, `restore` does it later.
            let _ = self.disk.rename(&old, target);
        }
        published?;
        self.remove(&old)
    }

    /// Removes a file or folder atomically: renames it, then deletes it.
    pub fn put_away(&self, path: &Path) -> Result<()> {
        let gone = with_prefix(path, GONE);
        self.remove(&gone)?;
        self.rename(path, &gone)?;
        self.remove(&gone)
    }

    /// Writes and syncs a file.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<FileRecord> {
        let written = self.disk.write(path, bytes).and_then(|()| self.disk.sync(path));
        written.map_err(|source| Error::write(path, source))?;
        Ok(FileRecord::of(bytes))
    }

    /// Writes and syncs a file under a name unique to this process, then renames it.
    pub fn write_whole(&self, path: &Path, bytes: &[u8]) -> Result<FileRecord> {
        let aside = with_prefix(path, &format!("{NEW}{}-", std::process::id()));
        let written = self.write(&aside, bytes).and_then(|record| {
            self.rename(&aside, path)?;
            Ok(record)
        });
        // Remove the partial file; a failure to do so is not the original error.
        written.inspect_err(|_| drop(self.disk.remove(&aside)))
    }

    /// As [`Self::write_whole`], for a file that `make` writes to the given path.
    pub fn write_with(
        &self,
        path: &Path,
        make: impl FnOnce(&Path) -> std::io::Result<()>,
    ) -> Result<()> {
        let aside = with_prefix(path, &format!("{NEW}{}-", std::process::id()));
        let written = make(&aside).map_err(|source| Error::write(path, source));
        let written = written.and_then(|()| self.sync(&aside));
        let written = written.and_then(|()| self.rename(&aside, path));
        written.inspect_err(|_| drop(self.disk.remove(&aside)))
    }

    /// Renames a file or folder and syncs the rename.
    pub fn rename(&self, from: &Path, to: &Path) -> Result<()> {
        self.disk.rename(from, to).map_err(|source| Error::write(to, source))?;
        to.parent().map_or(Ok(()), |parent| self.sync(parent))
    }

    /// Creates a folder and its parents.
    pub fn create_folder(&self, path: &Path) -> Result<()> {
        self.disk.create_folder(path).map_err(|source| Error::write(path, source))
    }

    /// Removes a file or folder, if it exists.
    pub fn remove(&self, path: &Path) -> Result<()> {
        match self.disk.remove(path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(Error::write(path, error))
            }
            _ => Ok(()),
        }
    }

    /// Restores folders that an interrupted save was about to replace.
    pub fn restore(&self, folder: &Path) -> Result<()> {
        for path in entries(folder)? {
            if let Some(replaced) = name(&path).strip_prefix(OLD) {
                let target = path.with_file_name(replaced);
                if !target.exists() {
                    self.rename(&path, &target)?;
                }
            }
        }
        Ok(())
    }

    /// Removes the remains of an interrupted save from a folder.
    pub fn clean(&self, folder: &Path) -> Result<()> {
        self.restore(folder)?;
        for path in entries(folder)? {
            if [NEW, OLD, GONE].iter().any(|prefix| name(&path).starts_with(prefix)) {
                self.remove(&path)?;
            }
        }
        Ok(())
    }

    fn sync(&self, path: &Path) -> Result<()> {
        self.disk.sync(path).map_err(|source| Error::write(path, source))
    }
}

/// Length and hash of a written file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileRecord {
    /// Its length.
    pub bytes: u64,
    /// Its SHA-256, in hexadecimal digits.
    pub sha256: String,
}

impl FileRecord {
    /// The record of these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, sha256: sha256(bytes) }
    }

    /// The bytes of the file at `path`.
    ///
    /// # Errors
    /// A file that cannot be read or does not match the record.
    pub fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let bytes = read(path)?;
        if bytes.len() as u64 != self.bytes {
            let reason = format!("it has {} bytes instead of {}", bytes.len(), self.bytes);
            return Err(Error::damaged(path, reason));
        }
        let found = Self::of(&bytes).sha256;
        if found != self.sha256 {
            let reason = format!("its SHA-256 is {found} instead of {}", self.sha256);
            return Err(Error::damaged(path, reason));
        }
        Ok(bytes)
    }
}

/// Serialises a value as JSON for the file `path`.
pub fn to_json(path: &Path, value: &impl Serialize) -> Result<Vec<u8>> {
    serde_json::to_vec_pretty(value)
        .map_err(|error| Error::write(path, std::io::Error::other(error)))
}

/// The bytes of a file.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(|source| Error::read(path, source))
}

/// Parses the bytes of the file `path` as JSON.
pub fn from_json<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T> {
    serde_json::from_slice(bytes).map_err(|error| Error::damaged(path, error))
}

/// Entries of a folder, sorted by name; empty if the folder does not exist.
pub fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let wrap = |source| Error::read(folder, source);
    let found = match fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        found => found.map_err(wrap)?,
    };
    let found = found.map(|entry| Ok(entry.map_err(wrap)?.path()));
    let mut found: Vec<PathBuf> = found.collect::<Result<_>>()?;
    found.sort();
    Ok(found)
}

/// The last part of a path.
pub fn name(path: &Path) -> &str {
    path.file_name().and_then(|name| name.to_str()).unwrap_or_default()
}

fn with_prefix(path: &Path, prefix: &str) -> PathBuf {
    let mut name = OsString::from(prefix);
    name.push(path.file_name().unwrap_or_default());
    path.with_file_name(name)
}
