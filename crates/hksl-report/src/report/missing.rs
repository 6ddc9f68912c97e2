//! Missing and unfinished runs of a report.

use std::collections::{BTreeMap, BTreeSet};

use hksl_files::numbers::grouped;
use hksl_files::{Outline, Standing};

use super::collected::Collected;
use super::comparison::Comparison;
use super::options::Options;
use super::record::Record;

/// Runs of one variant and task that a comparison lacks for the same reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// The variant.
    pub variant: String,
    /// The task with its distractor.
    pub task: String,
    /// The seeds.
    pub seeds: Vec<u64>,
    /// Their state: `no run`, or their status.
    pub state: String,
}

/// Variant, task and seed.
pub(super) type Cell = (String, String, u64);

/// All runs that are unfinished or lack the evaluation of the comparison. The expected runs are those of the study or,
/// without one, every seed of any method on every task of any method. Published curves are never missing.
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
        // The options may exclude some of them.
        Some(study) => {
            let wanted = |(variant, task, _): &&Cell| options.wants(variant, task);
            study.runs.iter().filter(wanted).cloned().collect()
        }
        None => comparisons.iter().flat_map(by_comparison).collect(),
    };
    for cell in expected.difference(&there) {
        // A damaged run has a folder but no record.
        let folder = format!("{}/{}/seed-{}", cell.1, cell.0, cell.2);
        let damaged = collected.skipped.iter().any(|(path, _)| path.ends_with(&folder));
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

/// The state of a run that is unfinished or lacks the evaluation at `at`.
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
