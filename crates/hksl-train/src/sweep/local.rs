//! Launches runs of a study on this machine, several at a time.

use std::fs::{self, File, OpenOptions};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;

#[cfg(unix)]
use rustix::process::Signal;

use super::{Error as SweepError, PlannedRun, Standing, Sweep};
use crate::{Error, Result};

/// Interval between checks of the processes.
const INTERVAL: Duration = Duration::from_millis(100);

/// Exit code of a run that was stopped by a signal and saved.
const STOPPED: i32 = 75;

/// Signals on which a run saves and exits. Batch systems send them to all processes of a job, so runs may receive them
/// before the sweep does.
#[cfg(unix)]
const STOPPING: [Signal; 6] =
    [Signal::HUP, Signal::INT, Signal::TERM, Signal::USR1, Signal::USR2, Signal::XCPU];

/// Options for launching.
pub struct Launch<'a> {
    /// The program `hksl`.
    pub binary: &'a Path,
    /// Concurrent runs; 0 counts as 1.
    pub jobs: usize,
    /// CPU threads per run.
    pub threads: usize,
    /// When set, all runs save and stop.
    pub stop: &'a AtomicBool,
}

/// Change in a run's status.
#[derive(Debug)]
pub enum LocalEvent<'a> {
    /// It was already done.
    Skipped(&'a PlannedRun),
    /// Another process works on it, for example one that a killed sweep started. The sweep waits for it.
    Elsewhere(&'a PlannedRun),
    /// Its process has started.
    Started(&'a PlannedRun),
    /// It is running. Sent at every check.
    Going(&'a PlannedRun),
    /// Its budget is used up.
    Done(&'a PlannedRun),
    /// It was stopped and has saved.
    Stopped(&'a PlannedRun),
    /// Its process failed. Other runs continue.
    Failed {
        /// The run.
        run: &'a PlannedRun,
        /// Exit status of the process.
        status: ExitStatus,
        /// Log with its output.
        log: &'a Path,
    },
}

struct Running<'a> {
    run: &'a PlannedRun,
    child: Child,
    log: PathBuf,
}

impl Drop for Running<'_> {
    /// Stops the run if the sweep fails.
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            terminate(&self.child);
        }
    }
}

/// Executes all unfinished runs and returns how many failed. Each process writes to its own log and has its own
/// process group, so that Ctrl-C reaches it only through this function.
///
/// # Errors
/// As [`Sweep::check_begun`]; a process that cannot be started, a log that cannot be written. Running processes then
/// receive SIGTERM and save.
pub fn launch(sweep: &Sweep, how: &Launch, watch: &mut dyn FnMut(&LocalEvent)) -> Result<usize> {
    sweep.check_begun()?;
    let logs = sweep.own_folder().join("logs");
    fs::create_dir_all(&logs).map_err(|source| Error::write(&logs, source))?;
    let (mut waiting, mut elsewhere, mut failed) = (Vec::new(), Vec::new(), 0);
    for run in &sweep.runs {
        match run.standing() {
            Standing::Done { .. } => watch(&LocalEvent::Skipped(run)),
            Standing::Running { .. } => {
                watch(&LocalEvent::Elsewhere(run));
                elsewhere.push(run);
            }
            _ => waiting.push(run),
        }
    }
    waiting.reverse();
    let mut running: Vec<Running> = Vec::new();
    let mut told_to_stop = false;
    let left = |waiting: &[_], elsewhere: &[_]| !waiting.is_empty() || !elsewhere.is_empty();
    while !running.is_empty() || (!told_to_stop && left(&waiting, &elsewhere)) {
        if how.stop.load(Ordering::Relaxed) && !told_to_stop {
            told_to_stop = true;
            running.iter().for_each(|running| terminate(&running.child));
        }
        while running.len() < how.jobs.max(1) && !told_to_stop {
            let Some(run) = waiting.pop() else { break };
            // Another sweep may have started or finished it meanwhile.
            match run.standing() {
                Standing::Done { .. } => {
                    watch(&LocalEvent::Skipped(run));
                    continue;
                }
                Standing::Running { .. } => {
                    watch(&LocalEvent::Elsewhere(run));
                    elsewhere.push(run);
                    continue;
                }
                _ => {}
            }
            running.push(start(sweep, how, run, &logs)?);
            watch(&LocalEvent::Started(run));
        }
        sleep(INTERVAL);
        elsewhere.retain(|run: &&PlannedRun| match run.standing() {
            Standing::Running { .. } => true,
            Standing::Done { .. } => {
                watch(&LocalEvent::Skipped(run));
                false
            }
            _ => {
                waiting.push(run);
                false
            }
        });
        let mut still = Vec::new();
        for mut one in running {
            let ended = one
                .child
                .try_wait()
                .map_err(|source| SweepError::Launch { program: how.binary.to_owned(), source })?;
            match ended {
                None => {
                    watch(&LocalEvent::Going(one.run));
                    still.push(one);
                }
                Some(status) if status.success() => watch(&LocalEvent::Done(one.run)),
                Some(status) if stopped(status) => watch(&LocalEvent::Stopped(one.run)),
                // Another sweep had started it first.
                Some(_) if matches!(one.run.standing(), Standing::Running { .. }) => {
                    watch(&LocalEvent::Elsewhere(one.run));
                    elsewhere.push(one.run);
                }
                Some(_) if matches!(one.run.standing(), Standing::Done { .. }) => {
                    watch(&LocalEvent::Skipped(one.run));
                }
                Some(status) => {
                    failed += 1;
                    watch(&LocalEvent::Failed { run: one.run, status, log: &one.log });
                }
            }
        }
        running = still;
    }
    Ok(failed)
}

fn start<'a>(sweep: &Sweep, how: &Launch, run: &'a PlannedRun, logs: &Path) -> Result<Running<'a>> {
    let log = logs.join(run.label(&sweep.runs_folder).replace('/', "_") + ".log");
    let file = OpenOptions::new().create(true).append(true).open(&log);
    let file = file.map_err(|source| Error::write(&log, source))?;
    let copy = |file: &File| file.try_clone().map_err(|source| Error::write(&log, source));
    let mut command = Command::new(how.binary);
    command
        .arg("train")
        .args(&run.arguments)
        .arg("--runs")
        .arg(&sweep.runs_folder)
        .args(["--threads", &how.threads.to_string()])
        .stdin(Stdio::null())
        .stdout(copy(&file)?)
        .stderr(file);
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let child = command
        .spawn()
        .map_err(|source| SweepError::Launch { program: how.binary.to_owned(), source })?;
    Ok(Running { run, child, log })
}

/// Whether a run was stopped by a signal: it exits with [`STOPPED`], or the signal ends it before it has anything to
/// save.
fn stopped(status: ExitStatus) -> bool {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        return STOPPING.iter().any(|stopping| stopping.as_raw() == signal);
    }
    status.code() == Some(STOPPED)
}

/// Sends SIGTERM, on which a run saves and exits.
#[cfg(unix)]
fn terminate(child: &Child) {
    let pid = i32::try_from(child.id()).ok().and_then(rustix::process::Pid::from_raw);
    if let Some(pid) = pid {
        // The signal fails if the process has already ended, which is fine.
        let _ = rustix::process::kill_process(pid, Signal::TERM);
    }
}

#[cfg(not(unix))]
fn terminate(_: &Child) {}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::process::ExitStatusExt;

    use super::*;

    #[test]
    fn a_run_that_was_told_to_end_did_not_fail() {
        // Encoding of `wait`: exit code in the second byte, signal in the first.
        assert!(stopped(ExitStatus::from_raw(STOPPED << 8)));
        for signal in STOPPING.map(Signal::as_raw) {
            assert!(stopped(ExitStatus::from_raw(signal)), "{signal}");
        }
        assert!(!stopped(ExitStatus::from_raw(1 << 8)));
        assert!(!stopped(ExitStatus::from_raw(9)));
    }
}
