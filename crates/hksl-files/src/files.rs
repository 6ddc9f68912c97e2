//! Writing so that a reader sees the old or the new, never a half; and reading so that damage is noticed.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::digest::sha256;
use crate::disk::{Disk, FileSystem};
use crate::{Error, Result};

/// Before the name of what is not complete yet.
const NEW: &str = ".new-";
/// Before the name of what is being replaced: without its successor, it is what counts.
const OLD: &str = ".old-";
/// Before the name of what is no longer needed.
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

    /// An empty folder beside `target`, to be filled and then published in its place.
    pub fn aside(&self, target: &Path) -> Result<PathBuf> {
        let aside = with_prefix(target, NEW);
        self.remove(&aside)?;
        self.create_folder(&aside)?;
        Ok(aside)
    }

    /// Puts a filled folder in its place. Its files are on the disk already; the rename is made to last.
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
            // What was there comes back; if even that fails, `restore` brings it.
            let _ = self.disk.rename(&old, target);
        }
        published?;
        self.remove(&old)
    }

    /// Makes a file or folder disappear in one step, then removes it.
    pub fn put_away(&self, path: &Path) -> Result<()> {
        let gone = with_prefix(path, GONE);
        self.remove(&gone)?;
        self.rename(path, &gone)?;
        self.remove(&gone)
    }

    /// Writes a file and waits until it is on the disk.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<FileRecord> {
        let written = self.disk.write(path, bytes).and_then(|()| self.disk.sync(path));
        written.map_err(|source| Error::write(path, source))?;
        Ok(FileRecord::of(bytes))
    }

    /// Writes a file aside, by a name that no other process has, waits until it is on the disk, and renames it.
    pub fn write_whole(&self, path: &Path, bytes: &[u8]) -> Result<FileRecord> {
        let aside = with_prefix(path, &format!("{NEW}{}-", std::process::id()));
        let written = self.write(&aside, bytes).and_then(|record| {
            self.rename(&aside, path)?;
            Ok(record)
        });
        // Half a file is of no use; that it cannot be removed either is not what went wrong.
        written.inspect_err(|_| drop(self.disk.remove(&aside)))
    }

    /// The same of a file that `make` writes to the path that it is given.
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

    /// Gives a file or folder another name, for good.
    pub fn rename(&self, from: &Path, to: &Path) -> Result<()> {
        self.disk.rename(from, to).map_err(|source| Error::write(to, source))?;
        to.parent().map_or(Ok(()), |parent| self.sync(parent))
    }

    /// Makes a folder, and those above it.
    pub fn create_folder(&self, path: &Path) -> Result<()> {
        self.disk.create_folder(path).map_err(|source| Error::write(path, source))
    }

    /// Removes a file or folder; one that is not there is no error.
    pub fn remove(&self, path: &Path) -> Result<()> {
        match self.disk.remove(path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(Error::write(path, error))
            }
            _ => Ok(()),
        }
    }

    /// Puts back what an interrupted save was about to replace.
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

    /// Removes what an interrupted save has left in a folder.
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

/// What a file must be to be the one that was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileRecord {
    /// Its length.
    pub bytes: u64,
    /// Its SHA-256, in hexadecimal digits.
    pub sha256: String,
}

impl FileRecord {
    /// That of these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, sha256: sha256(bytes) }
    }

    /// The bytes of the file at `path`.
    ///
    /// # Errors
    /// A file that cannot be read or is not the one that was written.
    pub fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let bytes = read(path)?;
        if bytes.len() as u64 != self.bytes {
            let reason = format!("it is {} bytes long, not {}", bytes.len(), self.bytes);
            return Err(Error::damaged(path, reason));
        }
        let found = Self::of(&bytes).sha256;
        if found != self.sha256 {
            let reason = format!("its SHA-256 is {found}, not {}", self.sha256);
            return Err(Error::damaged(path, reason));
        }
        Ok(bytes)
    }
}

/// A value as JSON, to be the file `path`.
pub fn to_json(path: &Path, value: &impl Serialize) -> Result<Vec<u8>> {
    serde_json::to_vec_pretty(value)
        .map_err(|error| Error::write(path, std::io::Error::other(error)))
}

/// The bytes of a file.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(|source| Error::read(path, source))
}

/// What these bytes, the file `path`'s, say as JSON.
pub fn from_json<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T> {
    serde_json::from_slice(bytes).map_err(|error| Error::damaged(path, error))
}

/// What is in a folder, by name; nothing if it is not there.
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
