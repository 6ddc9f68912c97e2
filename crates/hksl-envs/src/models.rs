//! Where dm_control's model files are looked for.

use std::env;
use std::path::{Path, PathBuf};

use crate::Error;

/// A variable that names the folder holding `suite/*.xml`; when set, no other folder is tried.
pub const FOLDER_VARIABLE: &str = "HKSL_MODELS";

/// Where `make setup` puts the models in the checkout that this was built from.
const CHECKOUT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../.native/models");

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
