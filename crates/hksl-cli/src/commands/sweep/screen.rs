//! Progress of a local sweep: one bar per run on a terminal, otherwise one line per event.

use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use hksl_train::sweep::{LocalEvent, PlannedRun, Standing, Sweep};
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use crate::numbers::{duration, grouped};

/// Interval between reads of a run's files.
const LOOK: Duration = Duration::from_secs(2);

/// Writes the progress of a sweep.
pub struct Screen<'a> {
    out: &'a mut dyn Write,
    sweep: &'a Sweep,
    quiet: bool,
    bars: Option<MultiProgress>,
    running: BTreeMap<String, (ProgressBar, Instant)>,
    began: Instant,
    ended: usize,
}

impl<'a> Screen<'a> {
    /// A screen that writes to `out`, or nothing if `quiet`.
    pub fn new(out: &'a mut dyn Write, sweep: &'a Sweep, quiet: bool) -> Self {
        let terminal = !quiet && std::io::stderr().is_terminal();
        let bars = terminal.then(MultiProgress::new);
        let running = BTreeMap::new();
        Self { out, sweep, quiet, bars, running, began: Instant::now(), ended: 0 }
    }

    /// Shows an event.
    pub fn show(&mut self, event: &LocalEvent) -> std::io::Result<()> {
        match event {
            LocalEvent::Skipped(run) => self.end(run, "already done"),
            LocalEvent::Elsewhere(run) => {
                let label = run.label(&self.sweep.runs_folder);
                self.line(&format!("{label}: locked by another process; waiting"))
            }
            LocalEvent::Started(run) => self.start(run),
            LocalEvent::Going(run) => {
                self.look(run);
                Ok(())
            }
            LocalEvent::Done(run) => {
                let text = match run.standing() {
                    Standing::Done { last_return } => format!("done, return {last_return:.1}"),
                    _ => "done".to_owned(),
                };
                self.end(run, &text)
            }
            LocalEvent::Stopped(run) => self.end(run, "stopped and saved"),
            LocalEvent::Failed { run, status, log } => {
                let reason = run.folder.failure().map_or(String::new(), |r| format!(": {r}"));
                let text =
                    format!("FAILED ({status}){reason}; see its output in {}", log.display());
                self.end(run, &text)
            }
        }
    }

    /// Writes the last line.
    pub fn finish(&mut self, failed: usize) -> std::io::Result<()> {
        if self.quiet {
            return Ok(());
        }
        let seconds = self.began.elapsed().as_secs_f64();
        let all = self.sweep.runs.len();
        writeln!(
            self.out,
            "{} of {all} runs ended, {failed} with an error, after {}; repeat the command to continue",
            self.ended,
            duration(seconds)
        )
    }

    fn start(&mut self, run: &PlannedRun) -> std::io::Result<()> {
        let label = run.label(&self.sweep.runs_folder);
        let Some(bars) = &self.bars else { return self.line(&format!("{label}: started")) };
        let style = ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} {msg}");
        let bar = ProgressBar::new(run.config.environment_steps);
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_prefix(label.clone());
        self.running.insert(label, (bars.add(bar), Instant::now()));
        Ok(())
    }

    fn look(&mut self, run: &PlannedRun) {
        let label = run.label(&self.sweep.runs_folder);
        let Some((bar, looked)) = self.running.get_mut(&label) else { return };
        if looked.elapsed() < LOOK {
            return;
        }
        *looked = Instant::now();
        if let Standing::Running { environment_step } = run.standing() {
            bar.set_position(environment_step);
        }
    }

    fn end(&mut self, run: &PlannedRun, text: &str) -> std::io::Result<()> {
        self.ended += 1;
        let label = run.label(&self.sweep.runs_folder);
        if let Some((bar, _)) = self.running.remove(&label) {
            bar.finish_and_clear();
        }
        let (ended, all) = (self.ended, self.sweep.runs.len());
        self.line(&format!(
            "{label}: {text} ({} of {})",
            grouped(ended as u64),
            grouped(all as u64)
        ))
    }

    fn line(&mut self, text: &str) -> std::io::Result<()> {
        if self.quiet {
            return Ok(());
        }
        match &self.bars {
            Some(bars) => bars.suspend(|| writeln!(self.out, "{text}")),
            None => writeln!(self.out, "{text}").and_then(|()| self.out.flush()),
        }
    }
}
