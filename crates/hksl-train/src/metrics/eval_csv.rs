//! `eval.csv`: one row an evaluation.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use hksl_files::{EvaluationRow, readable_evaluations};

use super::jsonl::{Opened, open_at};
use crate::{Error, Result};

/// An open `eval.csv`.
#[derive(Debug)]
pub struct EvalCsv {
    path: PathBuf,
    file: File,
    length: u64,
}

impl EvalCsv {
    /// Opens the file and truncates it to its first `length` bytes, as recorded by a checkpoint of this environment
    /// step. A damaged file is moved aside with a warning, and a new one is started with its readable rows up to that
    /// step, for example if a spreadsheet has changed the line endings.
    ///
    /// # Errors
    /// A file that cannot be read or written.
    pub fn open(path: &Path, length: u64, environment_step: u64) -> Result<Self> {
        let Opened { file, length, aside } = open_at(path, length)?;
        let mut csv = Self { path: path.to_owned(), file, length };
        let rows = aside.as_deref().map(readable_evaluations).unwrap_or_default();
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

#[cfg(test)]
mod tests {
    use hksl_files::read_evaluations;

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
