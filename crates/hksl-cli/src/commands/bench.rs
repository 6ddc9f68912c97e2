//! `hksl bench`.

mod checkpoint;
mod render;
mod step;

use std::io::{IsTerminal, Write};

use clap::Subcommand;
use indicatif::ProgressBar;

use crate::exit::Code;

/// The benchmarks.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Time a learning step that includes every phase, phase by phase
    Step(Box<step::Arguments>),
    /// Time an agent step of an environment, with its action repeat and its frame
    Render(Box<render::Arguments>),
    /// Time saving and loading a run's full state, and measure its size
    Checkpoint(Box<checkpoint::Arguments>),
}

impl Command {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        match self {
            Self::Step(arguments) => arguments.run(out, quiet),
            Self::Render(arguments) => arguments.run(out, quiet),
            Self::Checkpoint(arguments) => arguments.run(out, quiet),
        }
    }
}

/// A progress bar for `count` measurements, if shown on a terminal.
fn progress(shown: bool, count: usize, what: &'static str) -> Option<ProgressBar> {
    (shown && std::io::stderr().is_terminal())
        .then(|| ProgressBar::new(count as u64).with_message(what))
}

/// Smallest and largest of some durations, in seconds.
fn extremes(seconds: &[f64]) -> (f64, f64) {
    let seconds = seconds.iter().copied();
    (seconds.clone().fold(f64::INFINITY, f64::min), seconds.fold(0.0, f64::max))
}
