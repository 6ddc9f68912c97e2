//! Runs of a study as an array of Slurm jobs.
//!
//! Two files are written beside each other: `runs.txt`, one run a line as shell words, and `job.sh`, which each job of
//! the array runs with its line. A run that is stopped by a signal saves, exits 75, and is put into the queue again by
//! its own job; nothing else needs to keep running.

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
    /// Lines of `runs.txt`, counted from 0, that are not done.
    pub pending: Vec<usize>,
}

/// What Slurm made of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Submission {
    /// What sbatch printed: the job's number.
    pub job: String,
}

/// Writes the script and the list of runs; submits nothing.
///
/// # Errors
/// A folder that cannot be written.
pub fn write_job(sweep: &Sweep, binary: &Path) -> Result<Job> {
    let folder = sweep.own_folder().join("slurm");
    fs::create_dir_all(&folder).map_err(|source| Error::write(&folder, source))?;
    let write = |name: &str, text: String| -> Result<PathBuf> {
        let path = folder.join(name);
        fs::write(&path, text).map_err(|source| Error::write(&path, source))?;
        Ok(path)
    };
    let lines = sweep.runs.iter().map(|run| line(run, &sweep.runs_folder));
    let list = write("runs.txt", lines.map(|line| line + "\n").collect())?;
    let pending: Vec<usize> = (0..sweep.runs.len())
        .filter(|&index| {
            !matches!(
                sweep.runs[index].standing(),
                Standing::Done { .. } | Standing::Running { .. }
            )
        })
        .collect();
    let script = script(sweep, binary, &list, &folder, &pending);
    Ok(Job { script: write("job.sh", script)?, pending })
}

/// Hands the job to sbatch.
///
/// # Errors
/// [`SweepError::Sbatch`] if there is no sbatch, or it refuses.
pub fn submit(job: &Job) -> Result<Submission> {
    let refused =
        |reason: String| Error::from(SweepError::Sbatch { script: job.script.clone(), reason });
    let output = Command::new("sbatch")
        .arg("--parsable")
        .arg(&job.script)
        .output()
        .map_err(|error| refused(format!("sbatch cannot be run: {error}")))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        return Err(refused(format!("sbatch refused it: {said}")));
    }
    Ok(Submission { job: String::from_utf8_lossy(&output.stdout).trim().to_owned() })
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
