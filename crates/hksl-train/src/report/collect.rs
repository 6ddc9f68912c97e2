//! Finds runs and curves.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::curves_csv::{self, Format};
use super::{Error as ReportError, Record};
use crate::folder::RunFolder;
use crate::{Error, Result};

/// What was found.
#[derive(Debug, Clone, Default)]
pub struct Collected {
    /// The runs, in the order of the sources, within a folder by path.
    pub records: Vec<Record>,
    /// What cannot be reported on, and why: a damaged run, a task that is not ours.
    pub left_out: Vec<(PathBuf, String)>,
}

/// All runs in these folders and in those within them, and the curves in CSV files: these may be named themselves, or
/// lie in the folders, outside of runs. Their columns are those of drqv2's published curves (`agent`, `task`, `seed`,
/// `frame`, `episode_reward`) or those of `eval.csv`; other CSV files in folders are passed over.
///
/// # Errors
/// [`ReportError::Empty`]; a source that cannot be read; a file named itself that has other columns.
pub fn collect(sources: &[PathBuf]) -> Result<Collected> {
    let mut found = Found::default();
    for source in sources {
        if source.is_dir() {
            found.walk(source)?;
        } else {
            let format = curves_csv::format(source)?;
            let format = format.ok_or_else(|| Error::damaged(source, curves_csv::EXPECTED))?;
            found.add_file(source, format)?;
        }
    }
    let runs: Vec<_> = found.runs.par_iter().map(|run| (run.path(), Record::of_run(run))).collect();
    let mut collected = Collected::default();
    for (path, record) in runs {
        match record {
            Ok(record) => collected.records.push(record),
            Err(error) => collected.left_out.push((path.to_owned(), error.to_string())),
        }
    }
    for (file, format) in &found.files {
        match curves_csv::read(file, *format, &mut collected) {
            Err(error) if !sources.contains(file) => {
                collected.left_out.push((file.clone(), error.to_string()));
            }
            read => read?,
        }
    }
    if collected.records.is_empty() && collected.left_out.is_empty() {
        return Err(ReportError::Empty { sources: sources.to_vec() }.into());
    }
    Ok(collected)
}

#[derive(Default)]
struct Found {
    runs: Vec<RunFolder>,
    files: Vec<(PathBuf, Format)>,
    /// Where we have been: a folder that is named twice, or that a link leads back to, counts once.
    seen: BTreeSet<PathBuf>,
}

impl Found {
    fn walk(&mut self, folder: &Path) -> Result<()> {
        let wrap = |source| Error::read(folder, source);
        if !self.seen.insert(fs::canonicalize(folder).map_err(wrap)?) {
            return Ok(());
        }
        if let Ok(run) = RunFolder::existing(folder) {
            self.runs.push(run);
            return Ok(());
        }
        let mut paths = Vec::new();
        for entry in fs::read_dir(folder).map_err(wrap)? {
            paths.push(entry.map_err(wrap)?.path());
        }
        paths.sort();
        for path in paths {
            if path.is_dir() {
                self.walk(&path)?;
            } else if path.extension().is_some_and(|extension| extension == "csv")
                && let Some(format) = curves_csv::format(&path)?
            {
                self.add_file(&path, format)?;
            }
        }
        Ok(())
    }

    fn add_file(&mut self, file: &Path, format: Format) -> Result<()> {
        let place = fs::canonicalize(file).map_err(|source| Error::read(file, source))?;
        if self.seen.insert(place) {
            self.files.push((file.to_owned(), format));
        }
        Ok(())
    }
}
