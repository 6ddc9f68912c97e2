//! Numbers in rows and columns.

use super::{Error, Findings, Missing, Question, Record};
use crate::Result;

/// A table: what a CSV file holds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Table {
    /// Names of the columns.
    pub heading: Vec<String>,
    /// The rows, as wide as the heading.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    pub(super) fn new(heading: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> Self {
        let heading = heading.iter().map(|name| (*name).to_owned()).collect();
        Self { heading, rows: rows.into_iter().collect() }
    }

    /// The table as CSV.
    ///
    /// # Errors
    /// None in practice: it is written into memory.
    pub fn csv(&self) -> Result<Vec<u8>> {
        let refused = |reason: String| Error::Page { reason };
        let mut writer = csv::Writer::from_writer(Vec::new());
        for row in std::iter::once(&self.heading).chain(&self.rows) {
            writer.write_record(row).map_err(|error| refused(error.to_string()))?;
        }
        Ok(writer.into_inner().map_err(|error| refused(error.to_string()))?)
    }
}

/// A comparison in a column.
fn comparison(findings: &Findings<'_>) -> String {
    let suite = findings.comparison.suite.name();
    match findings.comparison.question {
        Question::Methods => suite.to_owned(),
        Question::Ablations => format!("{suite}, ablations"),
    }
}

pub(super) fn aggregates(all: &[Findings<'_>]) -> Table {
    let rows = all.iter().flat_map(|findings| {
        let name = comparison(findings);
        findings.aggregates.iter().map(move |(variant, estimates)| {
            let estimate = |wanted: &str| {
                let found = estimates.iter().find(|(name, _)| *name == wanted);
                found.map_or_else(String::new, |(_, estimate)| {
                    format!("{:.3} [{:.3}, {:.3}]", estimate.point, estimate.low, estimate.high)
                })
            };
            let numbers = ["IQM", "median", "mean", "optimality gap"].map(estimate);
            [vec![name.clone(), (*variant).to_owned()], numbers.to_vec()].concat()
        })
    });
    Table::new(&["comparison", "method", "IQM", "median", "mean", "optimality gap"], rows)
}

pub(super) fn scores(all: &[Findings<'_>]) -> Table {
    let rows = all.iter().flat_map(|findings| {
        let (name, at) = (comparison(findings), findings.comparison.at);
        findings.scores.iter().map(move |score| {
            let numbers =
                [score.mean, score.deviation, score.iqm.point, score.iqm.low, score.iqm.high];
            let start = [
                name.clone(),
                score.task.clone(),
                score.variant.to_owned(),
                at.to_string(),
                score.runs.to_string(),
            ];
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
        vec![missing.task.clone(), missing.variant.clone(), seeds.join(" "), missing.state.clone()]
    };
    Table::new(&["task", "method", "seeds", "state"], missing.iter().map(row))
}

pub(super) fn runs(records: &[Record]) -> Table {
    let row = |record: &Record| {
        let last = record
            .points
            .last()
            .map(|point| (point.0.to_string(), point.1.to_string()))
            .unwrap_or_default();
        let commands = record.run.as_ref().map(|run| run.commands.join("\n")).unwrap_or_default();
        let (budget, seed) = (record.budget.to_string(), record.seed.to_string());
        let origin = record.origin.display().to_string();
        vec![
            record.task_label(),
            record.variant.clone(),
            seed,
            budget,
            last.0,
            last.1,
            origin,
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
        "origin",
        "commands",
    ];
    Table::new(&heading, records.iter().map(row))
}
