//! `hksl man`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use crate::exit::Code;

/// Options of `hksl man`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example: install the man pages for this user\n  hksl man ~/.local/share/man/man1\n  man hksl-train"
)]
pub struct Arguments {
    /// Output folder for the man pages, created if missing
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl Arguments {
    /// Writes the man pages.
    pub fn run(
        self,
        grammar: clap::Command,
        out: &mut dyn Write,
        quiet: bool,
    ) -> anyhow::Result<Code> {
        let place = || format!("cannot write {}", self.folder.display());
        std::fs::create_dir_all(&self.folder).with_context(place)?;
        clap_mangen::generate_to(grammar, &self.folder).with_context(place)?;
        if !quiet {
            writeln!(out, "man pages written to {}; start with `man hksl`", self.folder.display())?;
        }
        Ok(Code::Done)
    }
}
