//! What a report is asked for.

use crate::statistics::{PROFILE_REPLICATES, REPLICATES};

/// How runs are reported on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// Replicates of the bootstrap.
    pub replicates: usize,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// The environment step at which scores are compared; none for the runs' common budget.
    pub at: Option<u64>,
    /// Only evaluations at multiples of so many environment steps count; none for all.
    pub every: Option<u64>,
    /// Only these variants; none for all.
    pub methods: Vec<String>,
    /// Only these tasks, with their distractors as folders are named; none for all.
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
    /// Replicates of a profile's bootstrap.
    pub(super) fn profile_replicates(&self) -> usize {
        self.replicates.min(PROFILE_REPLICATES)
    }

    /// Whether runs of this variant on this task are asked for.
    pub(super) fn wants(&self, variant: &str, task: &str) -> bool {
        let wanted =
            |list: &[String], name: &str| list.is_empty() || list.iter().any(|one| one == name);
        wanted(&self.methods, variant) && wanted(&self.tasks, task)
    }
}
