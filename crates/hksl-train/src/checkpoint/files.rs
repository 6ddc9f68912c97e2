//! Writing so that a reader sees the old or the new, never a half.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use candle_core::Tensor;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{Error, Result};

/// An empty folder beside `target`, to be filled and then published in its place.
pub(super) fn aside(target: &Path) -> Result<PathBuf> {
    let aside = with_prefix(target, ".new-");
    remove_folder(&aside)?;
    create_folder(&aside)?;
    Ok(aside)
}

/// Puts a filled folder in its place. Its files are on the disk already; the rename is made to last.
pub(super) fn publish(aside: &Path, target: &Path) -> Result<()> {
    sync_folder(aside)?;
    let old = with_prefix(target, ".old-");
    remove_folder(&old)?;
    if target.is_dir() {
        fs::rename(target, &old).map_err(|source| Error::write(target, source))?;
    }
    fs::rename(aside, target).map_err(|source| Error::write(target, source))?;
    if let Some(parent) = target.parent() {
        sync_folder(parent)?;
    }
    remove_folder(&old)
}

/// Writes a file and waits until it is on the disk.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let written = File::create(path).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    written.map_err(|source| Error::write(path, source))
}

/// Writes a file aside and renames it.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let aside = with_prefix(path, ".new-");
    write(&aside, bytes)?;
    fs::rename(&aside, path).map_err(|source| Error::write(path, source))
}

pub(super) fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    write(path, &to_json(path, value)?)
}

pub(super) fn write_json_whole(path: &Path, value: &impl Serialize) -> Result<()> {
    write_whole(path, &to_json(path, value)?)
}

fn to_json(path: &Path, value: &impl Serialize) -> Result<Vec<u8>> {
    serde_json::to_vec_pretty(value)
        .map_err(|error| Error::write(path, std::io::Error::other(error)))
}

pub(super) fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(|source| Error::read(path, source))
}

pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    serde_json::from_slice(&read(path)?).map_err(|error| Error::damaged(path, error))
}

pub(super) fn read_tensors(path: &Path) -> Result<BTreeMap<String, Tensor>> {
    hksl_core::from_safetensors(&read(path)?).map_err(|error| Error::damaged(path, error))
}

pub(super) fn create_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).map_err(|source| Error::write(path, source))
}

/// Removes a folder and what is in it; one that is not there is no error.
pub(super) fn remove_folder(path: &Path) -> Result<()> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::write(path, error))
        }
        _ => Ok(()),
    }
}

/// Waits until a folder's entries are on the disk.
pub(super) fn sync_folder(path: &Path) -> Result<()> {
    // Other systems than Unix cannot open folders, and need not.
    if cfg!(unix) {
        let synced = File::open(path).and_then(|folder| folder.sync_all());
        synced.map_err(|source| Error::write(path, source))?;
    }
    Ok(())
}

fn with_prefix(path: &Path, prefix: &str) -> PathBuf {
    let mut name = OsString::from(prefix);
    name.push(path.file_name().unwrap_or_default());
    path.with_file_name(name)
}
