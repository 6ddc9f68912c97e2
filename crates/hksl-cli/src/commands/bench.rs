//! `hksl bench`.

mod checkpoint;
mod render;
mod step;

use std::io::{IsTerminal, Write};

use clap::Subcommand;
use indicatif::ProgressBar;

use crate::exit::Code;

/// The measurements.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Time a learning step, phase by phase, every phase in each
    Step(Box<step::Arguments>),
    /// Time an environment: an agent step, its action repeat included, and the frame after it
    Render(Box<render::Arguments>),
    /// Time saving and reading a run's whole state, and say how large it is
    Checkpoint(Box<checkpoint::Arguments>),
}

impl Command {
    /// Carries the command out.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        match self {
            Self::Step(arguments) => arguments.run(out, quiet),
            Self::Render(arguments) => arguments.run(out, quiet),
            Self::Checkpoint(arguments) => arguments.run(out, quiet),
        }
    }
}

/// A bar for `count` measurements, where somebody looks.
fn progress(shown: bool, count: usize, what: &'static str) -> Option<ProgressBar> {
    (shown && std::io::stderr().is_terminal())
        .then(|| ProgressBar::new(count as u64).with_message(what))
}

/// The least and the most of some seconds.
fn extremes(seconds: &[f64]) -> (f64, f64) {
    let seconds = seconds.iter().copied();
    (seconds.clone().fold(f64::INFINITY, f64::min), seconds.fold(0.0, f64::max))
}
