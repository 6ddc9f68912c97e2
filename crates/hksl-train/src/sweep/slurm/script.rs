//! Script of a job array: Slurm's options and the commands of each job.

use std::path::Path;

use super::super::{Error as SweepError, SlurmSection, Study};
use crate::shell::quoted;
use crate::{Error, Result};

/// Seconds before a job's time limit at which Slurm signals it to save.
const WARNING_SECONDS: u32 = 180;

/// Name of a study's jobs in the queue.
pub(super) fn job_name(study: &str) -> String {
    format!("hksl-{study}")
}

/// Refuses a path that Slurm's directives or a list of shell words cannot contain.
///
/// # Errors
/// [`SweepError::SlurmPath`].
pub(super) fn check_path(path: &Path, what: &'static str, instead: &'static str) -> Result<()> {
    let refused = |reason: &'static str| {
        Error::from(SweepError::SlurmPath { what, path: path.to_owned(), reason, instead })
    };
    let Some(text) = path.to_str() else { return Err(refused("it is not UTF-8")) };
    if text.chars().any(|c| c.is_control()) {
        return Err(refused("it contains a line break or another control character"));
    }
    if text.contains(['"', '\\']) {
        return Err(refused("Slurm does not allow `\"` or `\\` in the name of an output file"));
    }
    Ok(())
}

/// Quotes the value of a directive: Slurm splits lines at blanks, and `#` starts a comment.
fn value(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%[]*&|()^~".contains(c);
    if text.chars().all(plain) { text.to_owned() } else { format!("\"{text}\"") }
}

/// Escapes a path for `--output`, in which Slurm expands `%j` and others, by doubling `%`.
fn output(folder: &Path) -> String {
    value(&format!("{}/%A_%a.log", folder.to_string_lossy().replace('%', "%%")))
}

/// Script of an array whose jobs run the lines of `list`.
pub(super) fn script(
    study: &Study,
    binary: &Path,
    list: &Path,
    folder: &Path,
    runs: usize,
) -> String {
    let SlurmSection { partition, time, gpus, cpus, memory, at_once, directives, setup } =
        &study.slurm;
    let mut lines = vec!["#!/bin/bash".to_owned()];
    let mut directive = |text: String| lines.push(format!("#SBATCH {text}"));
    directive(format!("--job-name={}", job_name(&study.name)));
    let limit = at_once.map_or(String::new(), |count| format!("%{count}"));
    let last = runs.saturating_sub(1);
    let indices = if last == 0 { "0".to_owned() } else { format!("0-{last}") };
    directive(format!("--array={indices}{limit}"));
    directive(format!("--output={}", output(folder)));
    directive("--open-mode=append".to_owned());
    directive("--requeue".to_owned());
    directive(format!("--signal=B:USR1@{WARNING_SECONDS}"));
    directive(format!("--cpus-per-task={}", cpus.unwrap_or(1)));
    let options = [("partition", partition), ("time", time), ("gpus", gpus), ("mem", memory)];
    for (name, text) in options {
        if let Some(text) = text {
            directive(format!("--{name}={}", value(text)));
        }
    }
    for text in directives {
        directive(text.clone());
    }
    let list = quoted(&list.to_string_lossy());
    let binary = quoted(&binary.to_string_lossy());
    lines.push(format!(
        r#"
line=$((SLURM_ARRAY_TASK_ID + 1))
words=$(sed -n "${{line}}p" {list})
if [ -z "$words" ]; then
  echo "line $line of "{list}" is missing or empty; cannot start a run" >&2
  exit 1
fi
eval "hksl_arguments=($words)"
# Slurm's warning, or its order to make room: the run saves and exits 75.
told=0
run=
trap 'told=$((told + 1)); [ -z "$run" ] || kill -USR1 "$run" 2>/dev/null' USR1 USR2 TERM HUP INT XCPU
# What the study's `setup` sets, traps included, is set in this inner shell alone.
(
# --- setup ---"#
    ));
    lines.extend(setup.iter().cloned());
    lines.push(format!(
        r#"
# --- end of setup ---
exec {binary} train "${{hksl_arguments[@]}}" --threads "${{SLURM_CPUS_PER_TASK:-1}}"
) &
run=$!
[ "$told" -eq 0 ] || kill -USR1 "$run" 2>/dev/null
# A trapped signal ends the wait, not the run.
while :; do
  before=$told
  wait "$run"
  code=$?
  [ "$told" -ne "$before" ] || break
done
# Told during `setup`, it ended by the signal, with nothing to save.
case "$told:$code" in
  0:*) ;;
  *:129 | *:130 | *:138 | *:140 | *:143 | *:152) code=75 ;;
esac
if [ "$code" -eq 75 ]; then
  job="${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}"
  for pause in 1 2 5 10 20 0; do
    scontrol requeue "$job" && exit 75
    sleep "$pause"
  done
  echo "job $job could not be requeued; run hksl sweep again" >&2
fi
exit "$code""#
    ));
    lines.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_reach_slurm_whole() {
        let of = |folder: &str| output(Path::new(folder));
        assert_eq!(of("/runs/1"), "/runs/1/%A_%a.log");
        assert_eq!(of("/my runs/r%j"), "\"/my runs/r%%j/%A_%a.log\"");
        assert_eq!(of("/it's #1"), "\"/it's #1/%A_%a.log\"");
        for bad in ["/a\"b", "/a\\b", "/a\nb"] {
            let message = check_path(Path::new(bad), "the folder", "name another").unwrap_err();
            assert!(message.to_string().contains("name another"), "{message}");
        }
    }
}
