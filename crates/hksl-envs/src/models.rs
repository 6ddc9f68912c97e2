//! Search and verification of dm_control's model files.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::{env, fs};

use hksl_files::digest::sha256;

use crate::Error;

/// Environment variable with the directory that contains `suite/*.xml`. If set, no other directory is searched.
pub const FOLDER_VARIABLE: &str = "HKSL_MODELS";

/// Directory of the models from `make setup`, in the checkout of the build.
const CHECKOUT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../.native/models");

/// Directory of the models in a package that contains this library.
static PACKAGE: OnceLock<PathBuf> = OnceLock::new();

/// Names the directory of the models for a program that is not the binary `hksl`, such as a Python package. Only the first
/// call has an effect.
pub fn set_package_folder(folder: PathBuf) {
    let _ = PACKAGE.set(folder);
}

/// Each file's SHA-256 in dm_control 1.0.50, as `sha256sum` writes it, relative to `suite/`.
const SUMS: &str = include_str!("../models.sha256");

/// Directory of included files.
const COMMON: &str = "common/";

/// Finds a model file, given relative to the model directory (such as `suite/cartpole.xml`).
///
/// Searches the directory in [`FOLDER_VARIABLE`] if it is set. Otherwise searches the directory of
/// [`set_package_folder`], `../share/hksl/models` relative to the directory of the binary, and the checkout of the build.
///
/// # Errors
/// [`Error::MissingModel`] with the directories searched.
pub fn find(file: &str) -> Result<PathBuf, Error> {
    let tried = folders();
    match tried.iter().map(|folder| folder.join(file)).find(|path| path.is_file()) {
        Some(path) => Ok(path),
        None => Err(Error::MissingModel { file: file.to_owned(), tried }),
    }
}

/// Checks that the model at `path` and its includes are those of dm_control 1.0.50. Another model would change states and
/// rewards.
///
/// # Errors
/// The first file that differs, and the reason.
pub fn check(path: &Path) -> Result<(), (PathBuf, String)> {
    let (folder, name) = (path.parent().unwrap_or(path), path.file_name().unwrap_or_default());
    for (sum, file) in SUMS.lines().filter_map(|line| line.split_once("  ")) {
        if !file.starts_with(COMMON) && name != file {
            continue;
        }
        let path = folder.join(file);
        let found = fs::read(&path).map(sha256);
        let found = found.map_err(|error| (path.clone(), error.to_string()))?;
        if found != sum {
            let reason = format!(
                "it is not that of dm_control 1.0.50: its SHA-256 is {found}, expected {sum}"
            );
            return Err((path, reason));
        }
    }
    Ok(())
}

/// The directories that [`find`] searches, in order.
pub fn folders() -> Vec<PathBuf> {
    if let Some(folder) = env::var_os(FOLDER_VARIABLE).filter(|value| !value.is_empty()) {
        return vec![PathBuf::from(folder)];
    }
    let installed = env::current_exe()
        .ok()
        .and_then(|binary| Some(binary.parent()?.parent()?.join("share/hksl/models")));
    let package = PACKAGE.get().cloned();
    package.into_iter().chain(installed).chain([plain(Path::new(CHECKOUT))]).collect()
}

/// Resolves `..` components of an existing directory, for readable messages.
fn plain(folder: &Path) -> PathBuf {
    folder.canonicalize().unwrap_or_else(|_| folder.to_owned())
}
