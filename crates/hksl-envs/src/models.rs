//! Where dm_control's model files are looked for, and whether they are what they should be.

use std::path::{Path, PathBuf};
use std::{env, fs};

use hksl_files::digest::sha256;

use crate::Error;

/// A variable that names the folder holding `suite/*.xml`; when set, no other folder is tried.
pub const FOLDER_VARIABLE: &str = "HKSL_MODELS";

/// Where `make setup` puts the models in the checkout that this was built from.
const CHECKOUT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../.native/models");

/// Each file's SHA-256 in dm_control 1.0.50, as `sha256sum` writes it, relative to `suite/`.
const SUMS: &str = include_str!("../models.sha256");

/// What the models include from.
const COMMON: &str = "common/";

/// The path of one model file, given relative to the models' folder (`suite/cartpole.xml`).
///
/// Looked for under [`FOLDER_VARIABLE`] if that is set; else beside an installed binary
/// (`../share/hksl/models` from its folder), then in the checkout this was built from.
///
/// # Errors
/// [`Error::MissingModel`] with the folders tried.
pub fn find(file: &str) -> Result<PathBuf, Error> {
    let tried = folders();
    match tried.iter().map(|folder| folder.join(file)).find(|path| path.is_file()) {
        Some(path) => Ok(path),
        None => Err(Error::MissingModel { file: file.to_owned(), tried }),
    }
}

/// What keeps the model at `path`, with what it includes, from being dm_control 1.0.50's, and the file at fault: with
/// another, states and rewards would be those of another task.
///
/// # Errors
/// The file and the reason.
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

/// The folders that [`find`] tries, in order.
pub fn folders() -> Vec<PathBuf> {
    if let Some(folder) = env::var_os(FOLDER_VARIABLE).filter(|value| !value.is_empty()) {
        return vec![PathBuf::from(folder)];
    }
    let installed = env::current_exe()
        .ok()
        .and_then(|binary| Some(binary.parent()?.parent()?.join("share/hksl/models")));
    installed.into_iter().chain([plain(Path::new(CHECKOUT))]).collect()
}

/// Without the `..` parts, where the folder exists: messages read better.
fn plain(folder: &Path) -> PathBuf {
    folder.canonicalize().unwrap_or_else(|_| folder.to_owned())
}
