//! Tables.

use super::comparison::Comparison;
use super::error::{Error, Result};
use super::findings::Findings;
use super::missing::Missing;
use super::record::Record;
use super::suite::Suite;
use crate::statistics::Estimate;

/// A table, written as CSV.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Table {
    /// Column names.
    pub heading: Vec<String>,
    /// Rows, as wide as the heading.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    pub(super) fn new(heading: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> Self {
        let heading = heading.iter().map(|name| (*name).to_owned()).collect();
        Self { heading, rows: rows.into_iter().collect() }
    }

    /// Formats the table as CSV.
    ///
    /// # Errors
    /// None in practice: it writes to memory.
    pub fn csv(&self) -> Result<Vec<u8>> {
        let refused = |reason: String| Error::Page { reason };
        let mut writer = csv::Writer::from_writer(Vec::new());
        for row in std::iter::once(&self.heading).chain(&self.rows) {
            writer.write_record(row).map_err(|error| refused(error.to_string()))?;
        }
        writer.into_inner().map_err(|error| refused(error.to_string()))
    }
}

/// Formatted aggregates by comparison and method.
pub(super) fn summary(all: &[Findings<'_>]) -> Table {
    let rows = all.iter().flat_map(|findings| {
        let of = &findings.comparison;
        findings.aggregates.iter().map(move |(variant, estimates)| {
            let estimate = |wanted: &str| {
                let found = estimates.iter().find(|(name, _)| *name == wanted);
                found.map_or_else(String::new, |(_, estimate)| written(*estimate, of.suite))
            };
            let numbers = ["IQM", "median", "mean", "optimality gap"].map(estimate);
            [vec![of.stem(), (*variant).to_owned()], numbers.to_vec()].concat()
        })
    });
    Table::new(&["comparison", "method", "IQM", "median", "mean", "optimality gap"], rows)
}

/// Formats an estimate as `0.585 [0.579, 0.591]`, or without an interval for single runs, where it is empty.
pub(super) fn written(estimate: Estimate, suite: Suite) -> String {
    let [point, low, high] =
        [estimate.point, estimate.low, estimate.high].map(|number| suite.written(number));
    if estimate.low == estimate.high { point } else { format!("{point} [{low}, {high}]") }
}

/// Aggregates of all comparisons in full precision.
pub(super) fn aggregates(all: &[Findings<'_>]) -> Table {
    let rows = all.iter().flat_map(|findings| {
        let of = &findings.comparison;
        findings.aggregates.iter().flat_map(move |(variant, estimates)| {
            estimates.iter().map(move |(kind, estimate)| {
                let numbers = [estimate.point, estimate.low, estimate.high];
                let start =
                    [of.stem(), (*variant).to_owned(), of.at.to_string(), (*kind).to_owned()];
                [start.to_vec(), numbers.map(|number| number.to_string()).to_vec()].concat()
            })
        })
    });
    let heading = ["comparison", "method", "environment_step", "aggregate", "point", "low", "high"];
    Table::new(&heading, rows)
}

pub(super) fn scores(all: &[Findings<'_>]) -> Table {
    let rows = all.iter().flat_map(|findings| {
        let of = &findings.comparison;
        findings.scores.iter().map(move |score| {
            let numbers =
                [score.mean, score.deviation, score.iqm.point, score.iqm.low, score.iqm.high];
            let (at, runs) = (of.at.to_string(), score.runs.to_string());
            let start = [of.stem(), score.task.clone(), score.variant.to_owned(), at, runs];
            [start.to_vec(), numbers.map(|number| number.to_string()).to_vec()].concat()
        })
    });
    let heading = [
        "comparison",
        "task",
        "method",
        "environment_step",
        "runs",
        "mean_return",
        "std_return",
        "iqm_return",
        "iqm_low",
        "iqm_high",
    ];
    Table::new(&heading, rows)
}

pub(super) fn missing(missing: &[Missing]) -> Table {
    let row = |missing: &Missing| {
        let seeds: Vec<String> = missing.seeds.iter().map(u64::to_string).collect();
        let (task, variant) = (missing.task.clone(), missing.variant.clone());
        vec![task, variant, seeds.join(" "), missing.state.clone()]
    };
    Table::new(&["task", "method", "seeds", "state"], missing.iter().map(row))
}

pub(super) fn runs(records: &[Record], comparisons: &[&Comparison<'_>]) -> Table {
    let row = |record: &Record| {
        let last = record.points.last();
        let last = last.map(|point| (point.0.to_string(), point.1.to_string())).unwrap_or_default();
        let counted = comparisons.iter().any(|of| {
            of.suite == record.suite
                && of.compared.contains(&record.variant.as_str())
                && of.common.contains(&record.task_label())
                && record.at(of.at).is_some()
        });
        let commands = record.run.as_ref().map(|run| run.commands.join("\n")).unwrap_or_default();
        vec![
            record.task_label(),
            record.variant.clone(),
            record.seed.to_string(),
            record.budget.to_string(),
            last.0,
            last.1,
            counted.to_string(),
            record.origin.display().to_string(),
            commands,
        ]
    };
    let heading = [
        "task",
        "method",
        "seed",
        "budget",
        "environment_step",
        "episode_return",
        "in_aggregates",
        "origin",
        "commands",
    ];
    Table::new(&heading, records.iter().map(row))
}
