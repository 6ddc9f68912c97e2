//! `hksl config`.

use std::io::Write;

use clap::{Args, Subcommand};
use hksl_train::config::resolve;

use crate::exit::Code;
use crate::run_settings::RunSettings;

/// What to do with a configuration.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Print the settings that a run with the same options would have, as TOML
    #[command(after_help = "Example: what an ablation changes in the debug preset\n  \
                            hksl config show cartpole-swingup --preset debug --ablation no-c --origin")]
    Show(Show),
}

/// Options of `hksl config show`.
#[derive(Debug, Args)]
pub struct Show {
    #[command(flatten)]
    settings: RunSettings,

    /// Say beside each value where it comes from
    #[arg(long, help_heading = "Output")]
    origin: bool,
}

impl Command {
    /// Carries the command out.
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
