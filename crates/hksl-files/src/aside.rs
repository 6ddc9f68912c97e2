//! Names for what is kept and no longer in use.

use std::path::{Path, PathBuf};

/// The first of `damaged-NAME`, `damaged-NAME-2` and so on in this folder that is free.
pub fn damaged(folder: &Path, name: &str) -> PathBuf {
    let mut path = folder.join(format!("damaged-{name}"));
    for count in 2.. {
        if !path.exists() {
            break;
        }
        path = folder.join(format!("damaged-{name}-{count}"));
    }
    path
}
