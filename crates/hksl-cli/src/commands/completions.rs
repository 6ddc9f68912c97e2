//! `hksl completions`.

use std::io::Write;

use clap::Args;
use clap_complete::Shell;

use crate::exit::Code;

/// Options of `hksl completions`.
#[derive(Debug, Args)]
#[command(after_help = "Example: install completions for bash\n  \
                        hksl completions bash > ~/.local/share/bash-completion/completions/hksl")]
pub struct Arguments {
    /// Shell
    shell: Shell,
}

impl Arguments {
    /// Prints the completion script.
    pub fn run(self, mut grammar: clap::Command, out: &mut dyn Write) -> anyhow::Result<Code> {
        // clap_complete panics on write errors, so it writes to memory.
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut grammar, "hksl", &mut script);
        out.write_all(&script)?;
        Ok(Code::Done)
    }
}
