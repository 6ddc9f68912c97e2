//! What there is to report on.

use std::path::PathBuf;

use hksl_files::Names;

use super::record::Record;

/// What was found.
#[derive(Debug, Clone, Default)]
pub struct Collected {
    /// The runs, in the order of the sources, within a folder by path.
    pub records: Vec<Record>,
    /// What cannot be reported on, and why: a damaged run, a task that is not ours.
    pub left_out: Vec<(PathBuf, String)>,
    /// What there is to compare, in the order in which it is shown.
    pub names: Names,
}

/// Path and reason in one.
pub(super) fn sentence((path, reason): &(PathBuf, String)) -> String {
    let path = path.display().to_string();
    if reason.contains(&path) { reason.clone() } else { format!("{path}: {reason}") }
}
