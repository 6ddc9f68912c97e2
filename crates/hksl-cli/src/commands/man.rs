//! `hksl man`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::{Args, CommandFactory};

use crate::cli::Cli;
use crate::exit::Code;

/// Options of `hksl man`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example: for this user\n  hksl man ~/.local/share/man/man1\n  man hksl-train"
)]
pub struct Arguments {
    /// Folder for the pages, one a command; made if need be
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl Arguments {
    /// Writes the pages.
    pub fn run(self, out: &mut dyn Write, quiet: bool) -> anyhow::Result<Code> {
        let place = || format!("{} cannot be written", self.folder.display());
        std::fs::create_dir_all(&self.folder).with_context(place)?;
        clap_mangen::generate_to(Cli::command(), &self.folder).with_context(place)?;
        if !quiet {
            writeln!(out, "man pages in {}; `man hksl` shows the first", self.folder.display())?;
        }
        Ok(Code::Done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_its_page() {
        let folder = tempfile::tempdir().unwrap();
        let arguments = Arguments { folder: folder.path().join("man1") };
        arguments.run(&mut Vec::new(), false).unwrap();
        for (page, word) in [
            ("hksl.1", "hksl\\-train"),
            ("hksl-train.1", "\\-\\-ablation"),
            ("hksl-sweep.1", "\\-\\-launcher"),
            ("hksl-bench-step.1", "\\-\\-batch"),
        ] {
            let text = std::fs::read_to_string(folder.path().join("man1").join(page)).unwrap();
            assert!(text.contains(word), "no {word} in {page}");
        }
    }
}
