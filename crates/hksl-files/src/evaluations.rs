//! The rows of `eval.csv`, one per evaluation.

use std::path::Path;

use serde::Serialize;

use crate::{CsvTable, Result, Row};

/// All columns of [`EvaluationRow`].
pub const EVALUATION_COLUMNS: [&str; 12] = [
    "agent",
    "task",
    "distractor",
    "seed",
    "environment_step",
    "agent_step",
    "episodes",
    "episode_return",
    "episode_return_std",
    "episode_return_min",
    "episode_return_max",
    "wall_seconds",
];

/// One evaluation, as `eval.csv` holds it; its fields are the columns.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EvaluationRow {
    /// Method, with its ablation if it has one.
    pub agent: String,
    /// Task.
    pub task: String,
    /// Distractor, `none` where there is none.
    pub distractor: String,
    /// Seed of the run.
    pub seed: u64,
    /// Environment steps learnt from.
    pub environment_step: u64,
    /// Agent steps learnt from.
    pub agent_step: u64,
    /// Episodes of the evaluation.
    pub episodes: usize,
    /// Mean of their returns.
    pub episode_return: f64,
    /// Standard deviation of their returns (ddof 0).
    pub episode_return_std: f64,
    /// Smallest of their returns.
    pub episode_return_min: f64,
    /// Largest of their returns.
    pub episode_return_max: f64,
    /// Seconds since the run began, pauses between a stop and a resume left out.
    pub wall_seconds: f64,
}

impl EvaluationRow {
    fn of(row: &Row<'_>) -> Result<Self> {
        Ok(Self {
            agent: row.text("agent")?.to_owned(),
            task: row.text("task")?.to_owned(),
            distractor: row.text("distractor")?.to_owned(),
            seed: row.whole("seed")?,
            environment_step: row.whole("environment_step")?,
            agent_step: row.whole("agent_step")?,
            episodes: row.whole("episodes")? as usize,
            episode_return: row.number("episode_return")?,
            episode_return_std: row.number("episode_return_std")?,
            episode_return_min: row.number("episode_return_min")?,
            episode_return_max: row.number("episode_return_max")?,
            wall_seconds: row.number("wall_seconds")?,
        })
    }
}

/// A point of a learning curve, with the labels that the file has.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Method, with its ablation if it has one.
    pub agent: Option<String>,
    /// Task.
    pub task: Option<String>,
    /// Distractor.
    pub distractor: Option<String>,
    /// Seed of the run.
    pub seed: Option<u64>,
    /// Environment steps learnt from.
    pub environment_step: u64,
    /// Mean return.
    pub episode_return: f64,
}

/// All rows of an `eval.csv`.
///
/// # Errors
/// [`crate::Error::Damaged`]: a file that cannot be read, or a row that does not fit.
pub fn read_evaluations(path: &Path) -> Result<Vec<EvaluationRow>> {
    let mut table = CsvTable::open(path)?;
    let mut rows = Vec::new();
    while let Some(row) = table.next_row()? {
        rows.push(EvaluationRow::of(&row)?);
    }
    Ok(rows)
}

/// The learning curve in an `eval.csv`, which may be of an older version, and its ignored columns.
///
/// # Errors
/// A file that cannot be read, a row that does not fit.
pub fn read_points(path: &Path) -> Result<(Vec<Point>, Vec<String>)> {
    let mut table = CsvTable::open(path)?;
    let ignored = table.others(&EVALUATION_COLUMNS);
    let mut points = Vec::new();
    while let Some(row) = table.next_row()? {
        let label = |name: &str| row.some(name).map(str::to_owned);
        points.push(Point {
            agent: label("agent"),
            task: label("task"),
            distractor: label("distractor"),
            seed: row.some("seed").map(|_| row.whole("seed")).transpose()?,
            environment_step: row.whole("environment_step")?,
            episode_return: row.number("episode_return")?,
        });
    }
    Ok((points, ignored))
}

/// The intact rows of a damaged `eval.csv`.
pub fn readable_evaluations(path: &Path) -> Vec<EvaluationRow> {
    let bytes = std::fs::read(path).unwrap_or_default();
    // A last line without a line break may be truncated.
    let end = bytes.iter().rposition(|byte| b"\r\n".contains(byte)).map_or(0, |last| last + 1);
    let Ok(mut table) = CsvTable::new(&bytes[..end], path) else { return Vec::new() };
    let mut rows = Vec::new();
    while let Ok(Some(row)) = table.next_row() {
        rows.extend(EvaluationRow::of(&row));
    }
    rows
}
