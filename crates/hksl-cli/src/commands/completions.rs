//! `hksl completions`.

use std::io::Write;

use clap::Args;
use clap_complete::Shell;

use crate::exit::Code;

/// Options of `hksl completions`.
#[derive(Debug, Args)]
#[command(after_help = "Example: for bash, in this and every later shell\n  \
                        hksl completions bash > ~/.local/share/bash-completion/completions/hksl")]
pub struct Arguments {
    /// The shell that is to complete
    shell: Shell,
}

impl Arguments {
    /// Prints the script for this grammar.
    pub fn run(self, mut grammar: clap::Command, out: &mut dyn Write) -> anyhow::Result<Code> {
        // clap_complete panics where it cannot write: into memory it always can.
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut grammar, "hksl", &mut script);
        out.write_all(&script)?;
        Ok(Code::Done)
    }
}
