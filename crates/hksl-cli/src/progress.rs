//! Progress of a run: a progress bar on a terminal, otherwise one line per evaluation.

use std::io::{IsTerminal, Write};
use std::path::Path;
use std::time::Instant;

use hksl_train::config::ReplayStorage;
use hksl_train::metrics::EvaluationRow;
use hksl_train::shell::quoted_path;
use hksl_train::{Ending, Event, Outcome, Progress, Summary};
use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use crate::numbers::{bytes, duration, grouped};

/// A progress bar up to `length`, hidden if `quiet` or without a terminal.
pub fn counter(quiet: bool, length: usize, message: impl Into<String>) -> ProgressBar {
    if quiet || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len}, {eta} left");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(length as u64).with_style(style).with_message(message.into())
}

/// Writes the first screen, the progress and the last screen of a run.
pub struct Screen<'a> {
    out: &'a mut dyn Write,
    quiet: bool,
    bar: Option<ProgressBar>,
    evaluating: Option<Instant>,
}

impl<'a> Screen<'a> {
    /// A screen that writes to `out`, or nothing if `quiet`.
    pub fn new(out: &'a mut dyn Write, quiet: bool) -> Self {
        Self { out, quiet, bar: None, evaluating: None }
    }

    /// Shows an event.
    pub fn show(&mut self, event: &Event) -> std::io::Result<()> {
        if self.quiet {
            return Ok(());
        }
        match event {
            Event::Measuring => {
                self.bar = std::io::stderr().is_terminal().then(|| spinner("measuring memory"));
                Ok(())
            }
            Event::Started(summary) => {
                self.clear();
                write_summary(self.out, summary)?;
                self.out.flush()?;
                self.bar = std::io::stderr().is_terminal().then(|| bar(summary));
                Ok(())
            }
            Event::Pretrained { done, of } => {
                if let Some(bar) = &self.bar {
                    bar.set_message(format!("pretraining: step {done} of {of}"));
                } else if *done == 1 {
                    self.line(&format!(
                        "pretraining: {of} learning steps before the next agent step"
                    ))?;
                }
                Ok(())
            }
            Event::Stepped(progress) => {
                if let Some(bar) = &self.bar {
                    bar.set_position(progress.environment_step);
                    bar.set_message(message(progress));
                }
                Ok(())
            }
            Event::EvaluationEpisode { done, of } => {
                self.evaluating.get_or_insert_with(Instant::now);
                if let Some(bar) = &self.bar {
                    bar.set_message(format!("evaluating: episode {done} of {of}"));
                }
                Ok(())
            }
            Event::Evaluated(row) => {
                self.evaluating = None;
                self.line(&evaluated(row))
            }
            Event::SkippedCheckpoint { error, moved_to } => writeln!(
                self.out,
                "warning: {error}\n  resuming from an older state; the damaged one was moved to {}",
                moved_to.display()
            ),
            Event::NewEpisode => self.line(
                "resumed with a new episode: the environment cannot restore the interrupted one",
            ),
            Event::Stopped(outcome) => {
                self.clear();
                writeln!(self.out, "{}", stopped(outcome))
            }
            Event::Finished(outcome) => {
                self.clear();
                writeln!(self.out, "{}", finished(outcome))
            }
            _ => Ok(()),
        }
    }

    fn clear(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }

    fn line(&mut self, text: &str) -> std::io::Result<()> {
        if let Some(bar) = &self.bar {
            bar.suspend(|| writeln!(self.out, "{text}"))?;
        } else {
            writeln!(self.out, "{text}")?;
        }
        self.out.flush()
    }
}

/// The commands to try once a run is done.
pub fn next_commands(folder: &Path, best: Option<u64>) -> String {
    let mut text =
        format!("losses in {0}/metrics.jsonl, returns in {0}/eval.csv\nnext:\n", folder.display());
    let folder = quoted_path(folder);
    let mut command =
        |command: String, what: &str| text.push_str(&format!("  {command}\n      {what}\n"));
    command(
        format!("hksl eval {folder} --episodes 100"),
        "evaluate the last policy more precisely",
    );
    if let Some(step) = best {
        let what = "evaluate the best policy so far";
        command(format!("hksl eval {folder} --checkpoint {step} --episodes 100"), what);
    }
    text.push_str("  the same `hksl train` with more --environment-steps\n      extend this run");
    text
}

/// The first screen.
pub fn write_summary(out: &mut dyn Write, summary: &Summary) -> std::io::Result<()> {
    let Summary { task, method, ablation, observation: [c, h, w], .. } = summary;
    let mut title = method.clone();
    if ablation != "none" {
        title.push_str(&format!(", ablation {ablation},"));
    }
    writeln!(out, "hksl {}: {title} on {task}", env!("CARGO_PKG_VERSION"))?;
    let mut row = |name: &str, text: String| writeln!(out, "  {name:<12} {text}");
    row("observation", format!("{c}×{h}×{w}, u8"))?;
    let repeat = summary.environment_steps / summary.agent_steps.max(1);
    row(
        "action",
        format!(
            "{} dimension{} in [-1, 1], action repeat {repeat}",
            summary.action_dims,
            plural(summary.action_dims as u64)
        ),
    )?;
    row("episode", format!("{} agent steps", grouped(summary.agent_steps_per_episode as u64)))?;
    let widest = summary.networks.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    for (index, (name, count)) in summary.networks.iter().enumerate() {
        let heading = if index == 0 { "parameters" } else { "" };
        row(heading, format!("{name:<widest$}  {:>10}", grouped(*count as u64)))?;
    }
    let total: usize = summary.networks.iter().map(|(_, count)| count).sum();
    row("", format!("{:<widest$}  {:>10}", "total", grouped(total as u64)))?;
    row(
        "replay",
        format!(
            "up to {} transitions, {}",
            grouped(summary.replay_transitions as u64),
            bytes(summary.replay_bytes)
        ),
    )?;
    row("memory", memory(summary))?;
    row("disk", format!("up to {}", bytes(summary.disk_bytes)))?;
    let threads = summary.threads;
    row("device", format!("{}, {threads} CPU thread{}", summary.device, plural(threads as u64)))?;
    if let Some(renderer) = &summary.renderer {
        row("renderer", renderer.clone())?;
    }
    row(
        "budget",
        format!(
            "{} environment steps = {} agent steps, {} learning steps",
            grouped(summary.environment_steps),
            grouped(summary.agent_steps),
            if summary.learning_steps == 0 {
                "no".to_owned()
            } else {
                grouped(summary.learning_steps)
            }
        ),
    )?;
    row("folder", summary.folder.display().to_string())?;
    if let Some(step) = summary.resumed_at {
        row("resumed at", format!("environment step {}", grouped(step)))?;
    }
    Ok(())
}

/// The run's total memory, as measured with a learning step.
fn memory(summary: &Summary) -> String {
    let on_device = if summary.device == "cpu" {
        ""
    } else {
        // HKSL on cartpole-swingup took 3.3 GB on an H100, and takes 1.0 GB on a CPU.
        " on a CPU, about 3.3 times as much on a GPU"
    };
    let replay = match summary.replay_storage {
        ReplayStorage::Memory => "the rest for the replay buffer",
        ReplayStorage::File => "the replay buffer in files",
    };
    match (summary.memory, summary.memory_bytes()) {
        (Some(memory), Some(total)) => format!(
            "about {} in total{on_device}: {} for learning, {replay}",
            bytes(total),
            bytes(memory.learning)
        ),
        _ => {
            format!("{} for the replay buffer; learning not measured", bytes(summary.replay_bytes))
        }
    }
}

fn plural(count: u64) -> &'static str {
    if count == 1 { "" } else { "s" }
}

fn spinner(message: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(message);
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    bar
}

fn bar(summary: &Summary) -> ProgressBar {
    let bar = ProgressBar::new(summary.environment_steps);
    bar.set_position(summary.resumed_at.unwrap_or(0));
    // Steps done before the resume do not measure this machine's speed.
    bar.reset_eta();
    let template =
        "{bar:24} {percent:>3}%  environment step {pos}/{len}  {msg}  {speed}  ETA {eta}";
    let style =
        ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let speed = |state: &ProgressState, out: &mut dyn std::fmt::Write| {
        // A failure to draw the bar must not stop the run.
        let _ = write!(out, "{:.1} steps/s", state.per_sec());
    };
    bar.set_style(style.with_key("speed", speed).progress_chars("█▉▊▋▌▍▎▏ "));
    bar.enable_steady_tick(std::time::Duration::from_millis(500));
    bar
}

fn message(progress: &Progress) -> String {
    let agent_step = grouped(progress.agent_step);
    match progress.last_return {
        Some(value) => format!("agent step {agent_step}  last return {value:.1}"),
        None => format!("agent step {agent_step}"),
    }
}

fn evaluated(row: &EvaluationRow) -> String {
    format!(
        "environment step {:>9} (agent step {:>9})  return {:>8.1} ± {:<6.1} over {} episodes  after {}",
        grouped(row.environment_step),
        grouped(row.agent_step),
        row.episode_return,
        row.episode_return_std,
        row.episodes,
        duration(row.wall_seconds)
    )
}

fn stopped(outcome: &Outcome) -> String {
    format!(
        "stopped and saved at environment step {} (agent step {}), after {}; repeat the command to resume",
        grouped(outcome.environment_step),
        grouped(outcome.agent_step),
        duration(outcome.wall_seconds)
    )
}

fn finished(outcome: &Outcome) -> String {
    let best = outcome
        .best_evaluation
        .map(|(value, step)| format!(", best {value:.1} at environment step {}", grouped(step)));
    let how = if outcome.ending == Ending::DoneBefore { "already done" } else { "done" };
    format!(
        "{how}: the last policy's mean return is {:.1} after {} environment steps ({} agent steps){}, in {}",
        outcome.final_return,
        grouped(outcome.environment_step),
        grouped(outcome.agent_step),
        best.unwrap_or_default(),
        duration(outcome.wall_seconds)
    )
}
