//! Which runs a report does not have, or not whole.

use std::collections::{BTreeMap, BTreeSet};

use super::{Comparison, Record};
use crate::numbers::grouped;
use crate::sweep::{Standing, Sweep};

/// Runs of one variant and task that are not done, in one way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// The variant.
    pub variant: String,
    /// The task with its distractor.
    pub task: String,
    /// The seeds.
    pub seeds: Vec<u64>,
    /// What is known of them: `no run`, or where they stand.
    pub state: String,
}

/// All runs that are not done. Of those that have no folder, a study says which there should be; without one, every
/// method should have the seeds that any has, on each task that any has. Curves of other people are never missing.
pub(super) fn missing(
    comparisons: &[Comparison<'_>],
    records: &[Record],
    study: Option<&Sweep>,
) -> Vec<Missing> {
    let mut rows: BTreeMap<(String, String, String), BTreeSet<u64>> = BTreeMap::new();
    let mut add = |variant: &str, task: &str, state: String, seed: u64| {
        rows.entry((variant.to_owned(), task.to_owned(), state)).or_default().insert(seed);
    };
    for record in records {
        if let Some(state) = record.run.as_ref().and_then(|run| state(&run.standing)) {
            add(&record.variant, &record.task_label(), state, record.seed);
        }
    }
    let no_run = || "no run".to_owned();
    match study {
        Some(sweep) => {
            let there: BTreeSet<_> = records.iter().map(cell).collect();
            for run in &sweep.runs {
                let variant = run.folder.path().parent().and_then(|parent| parent.file_name());
                let variant =
                    variant.map_or_else(String::new, |name| name.to_string_lossy().into_owned());
                let cell = (variant, run.config.task_label(), run.config.seed);
                if !there.contains(&cell) {
                    add(&cell.0, &cell.1, no_run(), cell.2);
                }
            }
        }
        None => {
            for comparison in comparisons {
                let own = |variant: &str, task: &str| -> BTreeSet<u64> {
                    let runs = comparison.runs(variant, task).iter();
                    runs.filter(|run| run.run.is_some()).map(|run| run.seed).collect()
                };
                let of = |variant: &str| -> BTreeSet<u64> {
                    comparison.tasks.iter().flat_map(|task| own(variant, task)).collect()
                };
                let seeds: BTreeSet<u64> =
                    comparison.variants.iter().flat_map(|variant| of(variant)).collect();
                for variant in comparison.variants.iter().filter(|variant| !of(variant).is_empty())
                {
                    for task in &comparison.tasks {
                        let there = own(variant, task);
                        seeds
                            .difference(&there)
                            .for_each(|&seed| add(variant, task, no_run(), seed));
                    }
                }
            }
        }
    }
    let rows = rows.into_iter();
    rows.map(|((variant, task, state), seeds)| Missing {
        variant,
        task,
        seeds: seeds.into_iter().collect(),
        state,
    })
    .collect()
}

fn cell(record: &Record) -> (String, String, u64) {
    (record.variant.clone(), record.task_label(), record.seed)
}

/// What is to be said of a run that is not done.
fn state(standing: &Standing) -> Option<String> {
    match standing {
        Standing::Done { .. } => None,
        Standing::NotBegun => Some("not begun".to_owned()),
        Standing::Running { environment_step } => {
            Some(format!("running, at {}", grouped(*environment_step)))
        }
        Standing::Stopped { environment_step } => {
            Some(format!("stopped at {}", grouped(*environment_step)))
        }
        Standing::Failed { reason } => {
            Some(format!("failed: {}", reason.lines().next().unwrap_or_default()))
        }
    }
}
