//! `hksl completions`.

use std::io::Write;

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use crate::cli::Cli;
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
    /// Prints the script.
    pub fn run(self, out: &mut dyn Write) -> anyhow::Result<Code> {
        // clap_complete panics where it cannot write: into memory it always can.
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "hksl", &mut script);
        out.write_all(&script)?;
        Ok(Code::Done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shells_script_knows_the_commands_and_the_tasks() {
        for shell in [Shell::Bash, Shell::Elvish, Shell::Fish, Shell::PowerShell, Shell::Zsh] {
            let mut out = Vec::new();
            Arguments { shell }.run(&mut out).unwrap();
            let script = String::from_utf8(out).unwrap();
            assert!(script.contains("doctor") && script.contains("preset"), "{shell}");
        }
    }
}
