//! `eval.csv`: one row an evaluation.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::jsonl::{Opened, open_at};
use crate::csv_table::{CsvTable, Row};
use crate::{Error, Result};

/// All columns of [`EvaluationRow`].
pub(crate) const EVALUATION_COLUMNS: [&str; 12] = [
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

/// What a learning curve needs of an evaluation; the labels, where the file has them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Point {
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

/// An open `eval.csv`.
#[derive(Debug)]
pub struct EvalCsv {
    path: PathBuf,
    file: File,
    length: u64,
}

impl EvalCsv {
    /// Opens the file and cuts it to its first `length` bytes, those that a checkpoint of this environment step vouches
    /// for. One that does not have them is put aside and begun anew, with a warning: no run hangs on it. Rows up to that
    /// step that can still be read are kept, as where a spreadsheet has changed the ends of lines.
    ///
    /// # Errors
    /// A file that cannot be read or written.
    pub fn open(path: &Path, length: u64, environment_step: u64) -> Result<Self> {
        let Opened { file, length, aside } = open_at(path, length)?;
        let mut csv = Self { path: path.to_owned(), file, length };
        let rows = aside.as_deref().map(readable).unwrap_or_default();
        for row in rows.iter().filter(|row| row.environment_step <= environment_step) {
            csv.write(row)?;
        }
        Ok(csv)
    }

    /// Bytes written so far.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Appends one row, after the header if it is the first.
    pub fn write(&mut self, row: &EvaluationRow) -> Result<()> {
        let mut writer =
            csv::WriterBuilder::new().has_headers(self.length == 0).from_writer(Vec::new());
        let wrap = |error: csv::Error| Error::write(&self.path, std::io::Error::other(error));
        writer.serialize(row).map_err(wrap)?;
        let text = writer.into_inner().map_err(|error| wrap(error.into_error().into()))?;
        self.file.write_all(&text).map_err(|source| Error::write(&self.path, source))?;
        self.length += text.len() as u64;
        Ok(())
    }

    /// Waits until everything is on the disk.
    pub fn sync(&self) -> Result<()> {
        self.file.sync_data().map_err(|source| Error::write(&self.path, source))
    }
}

/// All rows of an `eval.csv`.
///
/// # Errors
/// [`Error::Damaged`]: a file that cannot be read, or a row that does not fit.
pub fn read_evaluations(path: &Path) -> Result<Vec<EvaluationRow>> {
    let mut table = CsvTable::open(path)?;
    let mut rows = Vec::new();
    while let Some(row) = table.next()? {
        rows.push(EvaluationRow::of(&row)?);
    }
    Ok(rows)
}

/// The learning curve in an `eval.csv`, which may be an older version's, and the columns that are ignored.
///
/// # Errors
/// A file that cannot be read, a row that does not fit.
pub(crate) fn read_points(path: &Path) -> Result<(Vec<Point>, Vec<String>)> {
    let mut table = CsvTable::open(path)?;
    let ignored = table.others(&EVALUATION_COLUMNS);
    let mut points = Vec::new();
    while let Some(row) = table.next()? {
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

/// The rows of a damaged `eval.csv` that are whole.
fn readable(path: &Path) -> Vec<EvaluationRow> {
    let bytes = std::fs::read(path).unwrap_or_default();
    // A last line without an end may have been cut within a number.
    let end = bytes.iter().rposition(|byte| b"\r\n".contains(byte)).map_or(0, |last| last + 1);
    let Ok(mut table) = CsvTable::new(&bytes[..end], path) else { return Vec::new() };
    let mut rows = Vec::new();
    while let Ok(Some(row)) = table.next() {
        rows.extend(EvaluationRow::of(&row));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_under_one_header() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("eval.csv");
        let row = |step: u64| EvaluationRow {
            agent: "hksl".into(),
            task: "t".into(),
            distractor: "none".into(),
            seed: 1,
            environment_step: 8 * step,
            agent_step: step,
            episodes: 2,
            episode_return: 0.1 + 0.2,
            episode_return_std: 0.5,
            episode_return_min: 0.0,
            episode_return_max: 1.0,
            wall_seconds: 3.0,
        };
        let mut csv = EvalCsv::open(&path, 0, 0).unwrap();
        csv.write(&row(0)).unwrap();
        let length = csv.length();
        csv.write(&row(9)).unwrap();
        let mut csv = EvalCsv::open(&path, length, 0).unwrap();
        csv.write(&row(1)).unwrap();
        assert_eq!(read_evaluations(&path).unwrap(), [row(0), row(1)]);
        let text = std::fs::read_to_string(&path).unwrap();
        // Saved by a spreadsheet, with the row after the checkpoint's.
        std::fs::write(&path, text.replace('\n', "\r\n")).unwrap();
        let csv = EvalCsv::open(&path, length, 0).unwrap();
        assert_eq!(csv.length(), length);
        assert_eq!(read_evaluations(&path).unwrap(), [row(0)]);
        // Cut within its last number, one row spoilt before.
        let lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let spoilt = lines[1].replacen("hksl,t,none,1,", "hksl,t,none,one,", 1);
        let cut = lines[2].strip_suffix(".0").unwrap();
        std::fs::write(&path, [&lines[0], &spoilt, &lines[1], cut].join("\n")).unwrap();
        EvalCsv::open(&path, 10_000, 100).unwrap();
        assert_eq!(read_evaluations(&path).unwrap(), [row(0)]);
        assert!(
            text.starts_with("agent,task,distractor,seed,environment_step,agent_step,"),
            "{text}"
        );
    }
}
