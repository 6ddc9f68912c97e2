//! `hksl bench`.

mod step;

use std::io::Write;

use clap::Subcommand;

use crate::exit::Code;

/// The measurements.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Time a learning step, phase by phase, every phase in each
    Step(Box<step::Arguments>),
}

impl Command {
    /// Carries the command out.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        match self {
            Self::Step(arguments) => arguments.run(out, quiet),
        }
    }
}
