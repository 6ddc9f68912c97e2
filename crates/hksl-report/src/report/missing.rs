//! Which runs a report does not have, or not whole.

use std::collections::{BTreeMap, BTreeSet};

use hksl_files::numbers::grouped;
use hksl_files::{Outline, Standing};

use super::collected::Collected;
use super::comparison::Comparison;
use super::options::Options;
use super::record::Record;

/// Runs of one variant and task that a comparison lacks, in one way.
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

/// Variant, task and seed.
pub(super) type Cell = (String, String, u64);

/// All runs that have not been evaluated where scores are compared, or are not done. Of those that have no folder, a
/// study says which there should be; without one, every method should have the seeds that any has, on each task that
/// any has. Curves of other people are never missing.
pub(super) fn missing(
    collected: &Collected,
    comparisons: &[Comparison<'_>],
    options: &Options,
    study: Option<&Outline>,
) -> Vec<Missing> {
    let mut states: BTreeMap<Cell, String> = BTreeMap::new();
    for comparison in comparisons {
        for record in comparison.records() {
            if let Some(state) = state(record, comparison.at) {
                states.entry(cell(record)).or_insert(state);
            }
        }
    }
    let there: BTreeSet<Cell> =
        comparisons.iter().flat_map(Comparison::records).map(cell).collect();
    let expected: BTreeSet<Cell> = match study {
        // Without those that the options leave out.
        Some(study) => {
            let wanted = |(variant, task, _): &&Cell| options.wants(variant, task);
            study.runs.iter().filter(wanted).cloned().collect()
        }
        None => comparisons.iter().flat_map(by_comparison).collect(),
    };
    for cell in expected.difference(&there) {
        // A run that cannot be read has a folder.
        let folder = format!("{}/{}/seed-{}", cell.1, cell.0, cell.2);
        let damaged = collected.left_out.iter().any(|(path, _)| path.ends_with(&folder));
        let state = if damaged { "damaged" } else { "no run" };
        states.insert(cell.clone(), state.to_owned());
    }
    let mut rows: BTreeMap<(String, String, String), Vec<u64>> = BTreeMap::new();
    for ((variant, task, seed), state) in states {
        rows.entry((task, variant, state)).or_default().push(seed);
    }
    let rows = rows.into_iter();
    rows.map(|((task, variant, state), seeds)| Missing { variant, task, seeds, state }).collect()
}

pub(super) fn cell(record: &Record) -> Cell {
    (record.variant.clone(), record.task_label(), record.seed)
}

fn by_comparison(comparison: &Comparison<'_>) -> BTreeSet<Cell> {
    let own: Vec<&Record> = comparison.records().filter(|record| record.run.is_some()).collect();
    let variants: BTreeSet<&str> = own.iter().map(|record| record.variant.as_str()).collect();
    let tasks: BTreeSet<String> = own.iter().map(|record| record.task_label()).collect();
    let seeds: BTreeSet<u64> = own.iter().map(|record| record.seed).collect();
    let mut cells = BTreeSet::new();
    for variant in variants {
        for task in &tasks {
            cells.extend(seeds.iter().map(|seed| (variant.to_owned(), task.clone(), *seed)));
        }
    }
    cells
}

/// What is to be said of a run that is not done, or lacks the evaluation at `at`.
fn state(record: &Record, at: u64) -> Option<String> {
    let standing = &record.run.as_ref()?.standing;
    let last = record.last_step();
    let evaluated = match last {
        Some(step) => format!("last evaluated at {}", grouped(step)),
        None => "not evaluated".to_owned(),
    };
    let state = match standing {
        Standing::Done { .. } if record.at(at).is_some() => return None,
        Standing::Done { .. } => "done",
        Standing::NotBegun => "not begun",
        Standing::Running { .. } => "running",
        Standing::Stopped { .. } => "stopped",
        Standing::Failed { reason } => {
            let reason = reason.lines().next().unwrap_or_default();
            return Some(format!("failed, {evaluated}: {reason}"));
        }
    };
    Some(format!("{state}, {evaluated}"))
}
