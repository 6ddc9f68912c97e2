//! Finds runs and curves.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use hksl_files::{Account, Names, RunFolder};
use rayon::prelude::*;

use super::collected::{Collected, sentence};
use super::curves_csv::{self, Format};
use super::error::{Error, Result};
use super::record::Record;

/// Largest number of skipped files to name.
const NAMED: usize = 6;

/// Finds all runs in these folders and their subfolders, and all curves in CSV files, given or outside of runs in the
/// folders. CSV files have the columns of drqv2's published curves (`agent`, `task`, `seed`, `frame`, `episode_reward`)
/// or of `eval.csv`; other files in folders are skipped and listed. Unreadable entries of folders are left out.
/// `account` returns what the training program knows of a run, given its folder and budget; `names` are the names that
/// this program knows.
///
/// # Errors
/// [`Error::Empty`], [`Error::AllLeftOut`], [`Error::NoCurves`] for a given file; a source that cannot be read.
pub fn collect(
    sources: &[PathBuf],
    names: Names,
    account: impl Fn(&RunFolder, u64) -> Account + Sync,
) -> Result<Collected> {
    let mut found = Found::default();
    for source in sources {
        if source.is_dir() {
            fs::read_dir(source).map_err(|error| hksl_files::Error::read(source, error))?;
            found.walk(source);
            found.without_data(source);
        } else {
            let format = curves_csv::format(source)?;
            let format =
                format.map_err(|lacking| Error::NoCurves { path: source.clone(), lacking })?;
            found.add_file(source, format);
        }
    }
    let record = |run: &RunFolder| Record::of_run(run, &names, &account);
    let runs: Vec<_> = found.runs.par_iter().map(|run| (run.path(), record(run))).collect();
    let mut collected = Collected { skipped: found.skipped, ..Collected::default() };
    for (path, record) in runs {
        match record {
            Ok((record, remarks)) => {
                collected.records.push(record);
                let of_run = |said| (path.to_owned(), said);
                collected.skipped.extend(remarks.into_iter().map(of_run));
            }
            Err(error) => collected.skipped.push((path.to_owned(), told(&error))),
        }
    }
    for (file, format) in &found.files {
        match curves_csv::read(file, *format, &names) {
            Ok(curves) => {
                collected.records.extend(curves.records);
                collected.skipped.extend(curves.skipped);
            }
            Err(error) if !sources.contains(file) => {
                collected.skipped.push((file.clone(), told(&error)))
            }
            Err(error) => return Err(error),
        }
    }
    curves_csv::name_apart(&mut collected.records);
    collected.names = names;
    if !collected.records.is_empty() {
        return Ok(collected);
    }
    Err(match &collected.skipped[..] {
        [] => Error::Empty { sources: sources.to_vec() },
        skipped => Error::AllLeftOut { reasons: skipped.iter().map(sentence).collect() },
    })
}

/// Whether a file name has the extension of a table.
fn is_a_table(path: &Path) -> bool {
    let is = |extension: &str| {
        path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
    };
    is("csv") || is("tsv")
}

/// Whether a folder is a sweep's or an earlier report, which contain no runs.
fn is_our_own(folder: &Path) -> bool {
    let has = |name: &str| folder.join(name).exists();
    let sweeps = folder.file_name().is_some_and(|name| name == "sweeps");
    sweeps || (has("index.html") && has("tables/runs.csv") && has("figures"))
}

/// Formats an error with its cause.
fn told(error: &Error) -> String {
    match std::error::Error::source(error) {
        Some(source) => format!("{error}: {source}"),
        None => error.to_string(),
    }
}

#[derive(Default)]
struct Found {
    runs: Vec<RunFolder>,
    files: Vec<(PathBuf, Format)>,
    skipped: Vec<(PathBuf, String)>,
    /// Files without runs or curves.
    without_data: Vec<PathBuf>,
    /// Visited folders and files: folders given twice, or reached through a link, count once.
    seen: BTreeSet<PathBuf>,
}

impl Found {
    fn walk(&mut self, folder: &Path) {
        let place = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
        if !self.seen.insert(place) {
            return;
        }
        if let Ok(run) = RunFolder::existing(folder) {
            self.runs.push(run);
            return;
        }
        let mut paths = match fs::read_dir(folder) {
            Ok(entries) => entries.filter_map(|entry| Some(entry.ok()?.path())).collect::<Vec<_>>(),
            Err(error) => return self.skipped.push((folder.to_owned(), error.to_string())),
        };
        paths.sort();
        for path in paths {
            if path.is_dir() {
                if !is_our_own(&path) {
                    self.walk(&path);
                }
                continue;
            }
            if !is_a_table(&path) {
                self.without_data.push(path);
                continue;
            }
            match curves_csv::format(&path) {
                Ok(Ok(format)) => self.add_file(&path, format),
                // A single missing column is probably a mistake; a file that lacks more is no table of curves.
                Ok(Err(lacking)) if lacking.len() == 1 => {
                    self.skipped.push((path, format!("it lacks the column {}", lacking[0])));
                }
                Ok(Err(_)) => self.without_data.push(path),
                Err(error) => self.skipped.push((path, told(&error))),
            }
        }
    }

    /// Summarises the files without runs or curves in one line.
    fn without_data(&mut self, folder: &Path) {
        let files = std::mem::take(&mut self.without_data);
        let name = |path: &PathBuf| path.strip_prefix(folder).unwrap_or(path).display().to_string();
        let names: Vec<String> = files.iter().map(name).take(NAMED).collect();
        let more = match files.len().saturating_sub(NAMED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        if !names.is_empty() {
            let said = format!(
                "{}: skipped files without runs or curves: {}{more}",
                folder.display(),
                names.join(", ")
            );
            self.skipped.push((folder.to_owned(), said));
        }
    }

    fn add_file(&mut self, file: &Path, format: Format) {
        let place = fs::canonicalize(file).unwrap_or_else(|_| file.to_owned());
        if self.seen.insert(place) {
            self.files.push((file.to_owned(), format));
        }
    }
}
