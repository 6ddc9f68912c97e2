//! Options of a report.

use crate::statistics::{PROFILE_REPLICATES, REPLICATES};

/// Options of a report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// Bootstrap replicates.
    pub replicates: usize,
    /// Bootstrap seed.
    pub seed: u64,
    /// Environment step at which scores are compared; `None` for the runs' common budget.
    pub at: Option<u64>,
    /// Uses only evaluations at multiples of this number of environment steps; `None` for all.
    pub every: Option<u64>,
    /// Selected variants; empty for all.
    pub methods: Vec<String>,
    /// Selected tasks with distractors, as in folder names; empty for all.
    pub tasks: Vec<String>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            replicates: REPLICATES,
            seed: 1,
            at: None,
            every: None,
            methods: Vec::new(),
            tasks: Vec::new(),
        }
    }
}

impl Options {
    /// Bootstrap replicates of a performance profile.
    pub(super) fn profile_replicates(&self) -> usize {
        self.replicates.min(PROFILE_REPLICATES)
    }

    /// Whether this variant on this task is selected.
    pub(super) fn wants(&self, variant: &str, task: &str) -> bool {
        let wanted =
            |list: &[String], name: &str| list.is_empty() || list.iter().any(|one| one == name);
        wanted(&self.methods, variant) && wanted(&self.tasks, task)
    }
}
