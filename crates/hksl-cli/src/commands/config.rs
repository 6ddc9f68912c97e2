//! `hksl config`.

use std::io::Write;

use clap::{Args, Subcommand};
use hksl_train::config::resolve;

use crate::exit::Code;
use crate::run_settings::RunSettings;

/// Commands for configurations.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Print the configuration of a run with the same options, as TOML
    #[command(after_help = "Example: what an ablation changes in the debug preset\n  \
                            hksl config show cartpole-swingup --preset debug --ablation no-c --origin")]
    Show(Show),
}

/// Options of `hksl config show`.
#[derive(Debug, Args)]
pub struct Show {
    #[command(flatten)]
    settings: RunSettings,

    /// Origin of each value as a comment
    #[arg(long, help_heading = "Output")]
    origin: bool,
}

impl Command {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write) -> anyhow::Result<Code> {
        let Self::Show(show) = self;
        let resolved = resolve(&show.settings.request())?;
        let text = if show.origin {
            resolved.to_toml_with_origins()?
        } else {
            resolved.config.to_toml()?
        };
        out.write_all(text.as_bytes())?;
        Ok(Code::Done)
    }
}
