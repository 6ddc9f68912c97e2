//! Runs of a study as an array of Slurm jobs.
//!
//! Each submission has a folder of its own, numbered, for its jobs read it when they start, which may be days later:
//! `runs.txt` has one run a line as shell words, and `job.sh` is what each job of the array runs with its line; `job` is
//! the number that Slurm gave it. A run that is stopped by a signal saves, exits 75, and is put into the queue again by
//! its own job; nothing else needs to keep running.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::{Error as SweepError, PlannedRun, SlurmSection, Standing, Sweep};
use crate::{Error, Result};

/// Seconds before a job's time limit at which it is told to save.
const WARNING_SECONDS: u32 = 180;

/// What is there to be submitted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// The script.
    pub script: PathBuf,
    /// Lines of `runs.txt`, counted from 0, that are neither done nor running nor in Slurm's queue.
    pub pending: Vec<usize>,
    /// Runs in the queue by an earlier submission.
    pub queued: usize,
}

/// Where Slurm's number of a submission is kept.
const NUMBER: &str = "job";
const RUNS: &str = "runs.txt";

/// What Slurm made of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Submission {
    /// What sbatch printed: the job's number.
    pub job: String,
}

/// Writes the script and the list of runs, into a new folder, and submits nothing; none if no run is left to submit.
///
/// # Errors
/// [`Sweep::check_begun`]'s; a folder that cannot be written.
pub fn write_job(sweep: &Sweep, binary: &Path) -> Result<Option<Job>> {
    sweep.check_begun()?;
    let all = sweep.own_folder().join("slurm");
    fs::create_dir_all(&all).map_err(|source| Error::write(&all, source))?;
    let earlier = submissions(&all).map_err(|source| Error::read(&all, source))?;
    let queued: BTreeSet<String> = earlier.iter().flat_map(|(_, path)| in_queue(path)).collect();
    let lines: Vec<String> = sweep.runs.iter().map(|run| line(run, &sweep.runs_folder)).collect();
    let goes = |index: usize| {
        let standing = sweep.runs[index].standing();
        !matches!(standing, Standing::Done { .. } | Standing::Running { .. })
    };
    let (queued, pending): (Vec<usize>, Vec<usize>) = (0..lines.len())
        .filter(|&index| goes(index))
        .partition(|&index| queued.contains(&lines[index]));
    if pending.is_empty() {
        return Ok(None);
    }
    let folder = all.join(earlier.last().map_or(1, |(number, _)| number + 1).to_string());
    fs::create_dir(&folder).map_err(|source| Error::write(&folder, source))?;
    let write = |name: &str, text: String| -> Result<PathBuf> {
        let path = folder.join(name);
        fs::write(&path, text).map_err(|source| Error::write(&path, source))?;
        Ok(path)
    };
    let list = write(RUNS, lines.iter().map(|line| format!("{line}\n")).collect())?;
    let script = write("job.sh", script(sweep, binary, &list, &folder, &pending))?;
    Ok(Some(Job { script, pending, queued: queued.len() }))
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

/// The lines of a submission whose jobs Slurm still has; none if Slurm does not know it any more, or is not there.
fn in_queue(submission: &Path) -> Vec<String> {
    let Ok(number) = fs::read_to_string(submission.join(NUMBER)) else { return Vec::new() };
    let arguments = ["--noheader", "--array", "--format=%K", "--jobs", number.trim()];
    let Ok(output) = Command::new("squeue").args(arguments).output() else { return Vec::new() };
    let runs = fs::read_to_string(submission.join(RUNS)).unwrap_or_default();
    let lines: Vec<&str> = runs.lines().collect();
    let listed = String::from_utf8_lossy(&output.stdout).into_owned();
    let indices = listed.lines().filter_map(|index| index.trim().parse::<usize>().ok());
    indices.filter_map(|index| lines.get(index).map(|&line| line.to_owned())).collect()
}

/// Hands the job to sbatch, and notes the number beside it.
///
/// # Errors
/// [`SweepError::Sbatch`] if there is no sbatch, or it refuses; a folder that cannot be written.
pub fn submit(submitted: &Job) -> Result<Submission> {
    let refused = |reason: String| {
        Error::from(SweepError::Sbatch { script: submitted.script.clone(), reason })
    };
    let output = Command::new("sbatch")
        .arg("--parsable")
        .arg(&submitted.script)
        .output()
        .map_err(|error| refused(format!("sbatch cannot be run: {error}")))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        return Err(refused(format!("sbatch refused it: {said}")));
    }
    let job = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    // Of several clusters, sbatch names the one that took it.
    let number = job.split(';').next().unwrap_or_default();
    let path = submitted.script.with_file_name(NUMBER);
    fs::write(&path, format!("{number}\n")).map_err(|source| Error::write(&path, source))?;
    Ok(Submission { job })
}

/// A run's arguments as shell words.
fn line(run: &PlannedRun, runs_folder: &Path) -> String {
    let words = run.arguments.iter().map(|word| quoted(word));
    let folder = quoted(&runs_folder.to_string_lossy());
    words.chain(["--runs".to_owned(), folder]).collect::<Vec<_>>().join(" ")
}

/// A word as a shell takes it back.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

fn script(sweep: &Sweep, binary: &Path, list: &Path, folder: &Path, pending: &[usize]) -> String {
    let SlurmSection { partition, time, gpus, cpus, memory, at_once, directives, setup } =
        &sweep.study.slurm;
    let mut lines = vec!["#!/bin/bash".to_owned()];
    let mut directive = |text: String| lines.push(format!("#SBATCH {text}"));
    directive(format!("--job-name=hksl-{}", sweep.study.name));
    let limit = at_once.map_or(String::new(), |count| format!("%{count}"));
    directive(format!("--array={}{limit}", ranges(pending)));
    directive(format!("--output={}/%A_%a.log", folder.display()));
    directive("--open-mode=append".to_owned());
    directive("--requeue".to_owned());
    directive(format!("--signal=B:USR1@{WARNING_SECONDS}"));
    directive(format!("--cpus-per-task={}", cpus.unwrap_or(1)));
    let options = [("partition", partition), ("time", time), ("gpus", gpus), ("mem", memory)];
    for (name, value) in options {
        if let Some(value) = value {
            directive(format!("--{name}={value}"));
        }
    }
    for text in directives {
        directive(text.clone());
    }
    lines.push(String::new());
    lines.extend(setup.iter().cloned());
    lines.push(format!(
        r#"words=$(sed -n "$((SLURM_ARRAY_TASK_ID + 1))p" {})
eval "set -- $words"
{} train "$@" --threads "${{SLURM_CPUS_PER_TASK:-1}}" &
run=$!
# Slurm's warning, or its order to make room: the run saves and exits 75.
trap 'kill -USR1 "$run" 2>/dev/null' USR1 TERM
wait "$run"
code=$?
# A trapped signal ends the wait, not the run.
while kill -0 "$run" 2>/dev/null; do
  wait "$run"
  code=$?
done
if [ "$code" -eq 75 ]; then
  scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}"
fi
exit "$code""#,
        quoted(&list.to_string_lossy()),
        quoted(&binary.to_string_lossy()),
    ));
    lines.join("\n") + "\n"
}

/// `0-3,7` for 0, 1, 2, 3 and 7.
fn ranges(indices: &[usize]) -> String {
    let mut parts: Vec<(usize, usize)> = Vec::new();
    for &index in indices {
        match parts.last_mut() {
            Some((_, end)) if *end + 1 == index => *end = index,
            _ => parts.push((index, index)),
        }
    }
    let part = |(start, end): (usize, usize)| {
        if start == end { start.to_string() } else { format!("{start}-{end}") }
    };
    parts.into_iter().map(part).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_are_ranges() {
        assert_eq!(ranges(&[0, 1, 2, 3, 7, 9, 10]), "0-3,7,9-10");
        assert_eq!(ranges(&[5]), "5");
    }

    #[test]
    fn words_come_back_from_a_shell() {
        for (word, expected) in [
            ("sac.batch_size=64", "sac.batch_size=64"),
            ("hksl.skips=[1, 3]", "'hksl.skips=[1, 3]'"),
            ("it's", r"'it'\''s'"),
            ("", "''"),
        ] {
            assert_eq!(quoted(word), expected);
        }
    }
}
