//! Launches runs of a study as Slurm job arrays.
//!
//! Each array has its own numbered folder, because its jobs read it when they start, perhaps days later. `runs.txt` has
//! one run per line as shell words; `job.sh` is the script, in which each job of the array runs its line; `job`
//! contains the job number, and `cluster` the cluster if Slurm names one. A run that is stopped by a signal saves and
//! exits with 75, and its job requeues itself, so no other process needs to keep running.

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

/// A job array to submit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// The script.
    pub script: PathBuf,
    /// Number of its runs.
    pub runs: usize,
}

/// Job arrays to submit.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Jobs {
    /// Arrays of runs that are neither done nor running nor queued, each within Slurm's size limit.
    pub arrays: Vec<Job>,
    /// Runs that earlier submissions have in the queue.
    pub queued: usize,
}

/// File with the job number of a submission.
const NUMBER: &str = "job";
/// File with the cluster of a submission, if sbatch named one.
const CLUSTER: &str = "cluster";
const RUNS: &str = "runs.txt";
const SCRIPT: &str = "job.sh";

/// Writes the script and the list of runs of each array into a new folder. Does not submit them.
///
/// # Errors
/// As [`Sweep::check_begun`]; [`SweepError::SlurmPath`]; [`SweepError::Queue`] if Slurm does not report the jobs of an
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

/// Submits an array with sbatch and saves its job number in its folder. With `after`, its jobs start only after those
/// of that array have ended. Returns the job, as `NUMBER` or `NUMBER;CLUSTER`.
///
/// # Errors
/// [`SweepError::Sbatch`] if sbatch is missing, fails or prints no job number; a folder that cannot be written.
pub fn submit(job: &Job, after: Option<&str>) -> Result<String> {
    let refused =
        |reason: String| Error::from(SweepError::Sbatch { script: job.script.clone(), reason });
    let submitted = ask::sbatch(&job.script, after).map_err(refused)?;
    note(job.script.parent().unwrap_or(Path::new("")), &submitted)?;
    Ok(submitted.to_string())
}

/// Saves the job number and the cluster of a submission.
fn note(folder: &Path, Submitted { number, cluster }: &Submitted) -> Result<()> {
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        fs::write(&path, format!("{text}\n")).map_err(|source| Error::write(&path, source))
    };
    // The cluster first: with a number alone, squeue would ask the default cluster.
    cluster.as_ref().map_or(Ok(()), |cluster| write(CLUSTER, cluster))?;
    write(NUMBER, number)
}

/// Numbers and folders of earlier submissions, in order.
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

/// Lines of a submission whose jobs are still in the queue. Queries Slurm only if some of these runs are to be
/// submitted.
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
        // Perhaps sbatch accepted the script but could not report it, or a user submitted it.
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

/// Reads the job number and cluster of a submission.
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
    // Users may have copied the whole output of sbatch.
    let Some(submitted) = Submitted::parse(&text) else { return Ok(Number::Unreadable(text)) };
    let cluster = submitted.cluster.or(read(CLUSTER)?);
    Ok(Number::Noted(Submitted { cluster, ..submitted }))
}

/// Arguments of a run as shell words.
fn line(run: &PlannedRun, runs_folder: &Path) -> String {
    let words = run.arguments.iter().map(|word| quoted(word));
    let folder = quoted(&runs_folder.to_string_lossy());
    words.chain(["--runs".to_owned(), folder]).collect::<Vec<_>>().join(" ")
}
