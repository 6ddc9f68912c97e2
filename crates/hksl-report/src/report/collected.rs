//! Runs and curves to report on.

use std::path::PathBuf;

use hksl_files::Names;

use super::record::Record;

/// Runs and curves that were found.
#[derive(Debug, Clone, Default)]
pub struct Collected {
    /// Runs in the order of the sources, within a folder by path.
    pub records: Vec<Record>,
    /// Paths that were left out, with the reason, such as a damaged run or an unknown task.
    pub skipped: Vec<(PathBuf, String)>,
    /// Known methods, ablations, tasks and distractors, in display order.
    pub names: Names,
}

/// Combines path and reason.
pub(super) fn sentence((path, reason): &(PathBuf, String)) -> String {
    let path = path.display().to_string();
    if reason.contains(&path) { reason.clone() } else { format!("{path}: {reason}") }
}
