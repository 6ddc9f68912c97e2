//! Runs of a study as arrays of Slurm jobs.
//!
//! Each array has a folder of its own, numbered, for its jobs read it when they start, which may be days later:
//! `runs.txt` has one run a line as shell words, and `job.sh` is what each job of the array runs with its line; `job` is
//! the number that Slurm gave it, and `cluster` its cluster, where Slurm names one. A run that is stopped by a signal
//! saves, exits 75, and is put into the queue again by its own job; nothing else needs to keep running.

mod ask;
mod script;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use super::{Error as SweepError, PlannedRun, Standing, Sweep};
use crate::shell::quoted;
use crate::{Error, Result};
use ask::{Number, Submitted};
use script::check_path;

/// One array, to be submitted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// The script.
    pub script: PathBuf,
    /// How many runs it has.
    pub runs: usize,
}

/// What is there to be submitted.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Jobs {
    /// The arrays, none larger than Slurm takes: runs that are neither done nor running nor in Slurm's queue.
    pub arrays: Vec<Job>,
    /// Runs in the queue by an earlier submission.
    pub queued: usize,
}

/// Where Slurm's number of a submission is kept.
const NUMBER: &str = "job";
/// Where the name of its cluster is kept, if sbatch told one.
const CLUSTER: &str = "cluster";
const RUNS: &str = "runs.txt";
const SCRIPT: &str = "job.sh";

/// Writes scripts and lists of runs, each array's into a new folder, and submits nothing.
///
/// # Errors
/// [`Sweep::check_begun`]'s; [`SweepError::SlurmPath`]; [`SweepError::Queue`] where Slurm does not say what it has of an
/// earlier submission; a folder that cannot be written.
pub fn write_jobs(sweep: &Sweep, binary: &Path) -> Result<Jobs> {
    sweep.check_begun()?;
    let all = sweep.own_folder().join("slurm");
    check_path(&all, "the study's folder", "choose another folder with --runs")?;
    check_path(binary, "this program", "install hksl under another path")?;
    fs::create_dir_all(&all).map_err(|source| Error::write(&all, source))?;
    let earlier = submissions(&all).map_err(|source| Error::read(&all, source))?;
    let waits = |run: &&PlannedRun| {
        !matches!(run.standing(), Standing::Done { .. } | Standing::Running { .. })
    };
    let waiting = sweep.runs.iter().filter(waits).map(|run| line(run, &sweep.runs_folder));
    let mut waiting: Vec<String> = waiting.collect();
    let mut queued = BTreeSet::new();
    for (_, submission) in &earlier {
        queued.extend(in_queue(submission, &sweep.study.name, &waiting)?);
    }
    let before = waiting.len();
    waiting.retain(|line| !queued.contains(line));
    let queued = before - waiting.len();
    if waiting.is_empty() {
        return Ok(Jobs { arrays: Vec::new(), queued });
    }
    let largest = ask::largest_array();
    if largest == 0 {
        let reason = "this Slurm does not accept job arrays (MaxArraySize = 0)".to_owned();
        return Err(SweepError::Sbatch { script: all, reason }.into());
    }
    let first = earlier.last().map_or(1, |(number, _)| number + 1);
    let arrays = waiting.chunks(largest).zip(first..).map(|(lines, number)| {
        let folder = all.join(number.to_string());
        fs::create_dir(&folder).map_err(|source| Error::write(&folder, source))?;
        let write = |name: &str, text: String| -> Result<PathBuf> {
            let path = folder.join(name);
            fs::write(&path, text).map_err(|source| Error::write(&path, source))?;
            Ok(path)
        };
        let list = write(RUNS, lines.iter().map(|line| format!("{line}\n")).collect())?;
        let text = script::script(&sweep.study, binary, &list, &folder, lines.len());
        Ok(Job { script: write(SCRIPT, text)?, runs: lines.len() })
    });
    Ok(Jobs { arrays: arrays.collect::<Result<_>>()?, queued })
}

/// Hands an array to sbatch, and notes its number beside it. With `after`, none of its jobs starts before those of that
/// array have ended. Returns what sbatch called it: `NUMBER` or `NUMBER;CLUSTER`.
///
/// # Errors
/// [`SweepError::Sbatch`] if there is no sbatch, or it refuses, or tells no number; a folder that cannot be written.
pub fn submit(job: &Job, after: Option<&str>) -> Result<String> {
    let refused =
        |reason: String| Error::from(SweepError::Sbatch { script: job.script.clone(), reason });
    let submitted = ask::sbatch(&job.script, after).map_err(refused)?;
    note(job.script.parent().unwrap_or(Path::new("")), &submitted)?;
    Ok(submitted.to_string())
}

/// Writes down what Slurm calls a submission.
fn note(folder: &Path, Submitted { number, cluster }: &Submitted) -> Result<()> {
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        fs::write(&path, format!("{text}\n")).map_err(|source| Error::write(&path, source))
    };
    // First: with a number and no cluster, another cluster would be asked.
    cluster.as_ref().map_or(Ok(()), |cluster| write(CLUSTER, cluster))?;
    write(NUMBER, number)
}

/// The folders of earlier submissions with their numbers, in order.
fn submissions(all: &Path) -> std::io::Result<Vec<(u32, PathBuf)>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(all)? {
        let path = entry?.path();
        let number = path.file_name().and_then(|name| name.to_str()?.parse().ok());
        found.extend(number.map(|number: u32| (number, path)));
    }
    found.sort();
    Ok(found)
}

/// The lines of a submission whose jobs Slurm still has. It is asked only if some of them wait to be submitted.
fn in_queue(submission: &Path, study: &str, waiting: &[String]) -> Result<Vec<String>> {
    let runs = submission.join(RUNS);
    let text = match fs::read_to_string(&runs) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        read => read.map_err(|source| Error::read(&runs, source))?,
    };
    let lines: Vec<&str> = text.lines().collect();
    if !lines.iter().any(|line| waiting.iter().any(|one| one == line)) {
        return Ok(Vec::new());
    }
    let unanswered = |reason: String| {
        Error::from(SweepError::Queue { submission: submission.to_owned(), reason })
    };
    let indices = match noted(submission)? {
        Number::Noted(submitted) => ask::indices_of(&submitted).map_err(unanswered)?,
        Number::Unreadable(text) => {
            return Err(unanswered(format!(
                "its file `{NUMBER}` contains {text:?} instead of a job number"
            )));
        }
        // Perhaps sbatch took it, and could not say so; or it was submitted by hand.
        Number::None => match ask::job_of(&submission.join(SCRIPT), study).map_err(unanswered)? {
            Some((submitted, indices)) => {
                note(submission, &submitted)?;
                indices
            }
            None => Vec::new(),
        },
    };
    let known = indices.into_iter().filter_map(|index| lines.get(index));
    Ok(known.map(|&line| line.to_owned()).collect())
}

/// What a submission's folder says of its job.
fn noted(submission: &Path) -> Result<Number> {
    let read = |name: &str| -> Result<Option<String>> {
        let path = submission.join(name);
        match hksl_files::text::read(&path) {
            Ok(text) => Ok(Some(text.trim().to_owned())),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(Error::read(&path, source)),
        }
    };
    let Some(text) = read(NUMBER)? else { return Ok(Number::None) };
    // By hand, people may copy all that sbatch printed.
    let Some(submitted) = Submitted::parse(&text) else { return Ok(Number::Unreadable(text)) };
    let cluster = submitted.cluster.or(read(CLUSTER)?);
    Ok(Number::Noted(Submitted { cluster, ..submitted }))
}

/// A run's arguments as shell words.
fn line(run: &PlannedRun, runs_folder: &Path) -> String {
    let words = run.arguments.iter().map(|word| quoted(word));
    let folder = quoted(&runs_folder.to_string_lossy());
    words.chain(["--runs".to_owned(), folder]).collect::<Vec<_>>().join(" ")
}
