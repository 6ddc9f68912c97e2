//! The command line: commands and global options.

use std::io::Write;

use clap::{CommandFactory, Parser, Subcommand};

use crate::Invocation;
use crate::commands;
use crate::exit::Code;
use crate::standard::Purpose;

/// Multi-horizon representations for reinforcement learning from pixels (HKSL).
#[derive(Debug, Parser)]
#[command(
    name = "hksl",
    version,
    propagate_version = true,
    arg_required_else_help = true,
    after_help = "Exit codes: 0 success, 1 failure, 2 invalid arguments or configuration,\n            \
                  3 graphics or a native library missing, 75 interrupted by a signal, run saved."
)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,

    /// Print only errors and requested output
    #[arg(long, short, global = true, display_order = 1000)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Train an agent, or resume a stopped run
    Train(Box<commands::train::Arguments>),
    /// Evaluate a run's policy
    Eval(commands::eval::Arguments),
    /// Play a policy or recorded actions, and write steps and frames
    Rollout(Box<commands::rollout::Arguments>),
    /// Predict future coordinates from frozen encoders with linear probes
    Probe(Box<commands::probe::Arguments>),
    /// Measure what a communication manager sends at each step of a trajectory
    AnalyzeComm(commands::analyze_comm::Arguments),
    /// Draw attention maps of each level's encoder
    Attention(commands::attention::Arguments),
    /// Run a study of many runs, on this machine or with Slurm
    Sweep(commands::sweep::Arguments),
    /// Compare runs: aggregate scores with confidence intervals, learning curves, figures and an HTML page
    Report(commands::report::Arguments),
    /// Inspect configurations
    #[command(subcommand)]
    Config(commands::config::Command),
    /// Benchmark learning steps, rendering and checkpoints on this machine
    #[command(subcommand)]
    Bench(commands::bench::Command),
    /// List the tasks
    Tasks,
    /// Check this machine and this build, and suggest fixes
    Doctor(commands::doctor::Arguments),
    /// Print a shell completion script
    Completions(commands::completions::Arguments),
    /// Write man pages
    Man(commands::man::Arguments),
}

impl Cli {
    /// Runs the command.
    pub fn run(self, out: &mut dyn Write, invocation: &Invocation) -> anyhow::Result<Code> {
        match self.command {
            Command::Train(arguments) => arguments.run(out, self.quiet, invocation),
            Command::Eval(arguments) => arguments.run(out, self.quiet),
            Command::Rollout(arguments) => arguments.run(out, self.quiet),
            Command::Probe(arguments) => arguments.run(out, self.quiet),
            Command::AnalyzeComm(arguments) => arguments.run(out, self.quiet),
            Command::Attention(arguments) => arguments.run(out, self.quiet),
            Command::Sweep(arguments) => arguments.run(out, self.quiet, invocation),
            Command::Report(arguments) => arguments.run(out, self.quiet, invocation),
            Command::Config(command) => command.run(out),
            Command::Bench(command) => command.run(out, self.quiet),
            Command::Tasks => commands::tasks::run(out, self.quiet),
            Command::Doctor(arguments) => arguments.run(out, self.quiet),
            Command::Completions(arguments) => arguments.run(Self::command(), out),
            Command::Man(arguments) => arguments.run(Self::command(), out, self.quiet),
        }
    }

    /// Whether standard output carries the result or only progress.
    pub fn purpose(&self) -> Purpose {
        let data = match &self.command {
            Command::Train(arguments) => arguments.prints_data(),
            Command::Rollout(arguments) => arguments.prints_data(),
            Command::Sweep(arguments) => arguments.prints_data(),
            Command::Probe(_)
            | Command::AnalyzeComm(_)
            | Command::Attention(_)
            | Command::Report(_)
            | Command::Man(_) => false,
            Command::Eval(_)
            | Command::Config(_)
            | Command::Bench(_)
            | Command::Tasks
            | Command::Doctor(_)
            | Command::Completions(_) => true,
        };
        if data { Purpose::Data } else { Purpose::Progress }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INVOCATION: Invocation = Invocation { arguments: Vec::new(), program: None };

    #[test]
    fn the_grammar_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_shells_script_knows_the_commands_and_the_tasks() {
        for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
            let mut out = Vec::new();
            Cli::try_parse_from(["hksl", "completions", shell])
                .unwrap()
                .run(&mut out, &INVOCATION)
                .unwrap();
            let script = String::from_utf8(out).unwrap();
            assert!(script.contains("doctor") && script.contains("preset"), "{shell}");
        }
    }

    #[test]
    fn every_command_has_its_man_page() {
        let folder = tempfile::tempdir().unwrap();
        let pages = folder.path().join("man1");
        let line = ["hksl".as_ref(), "man".as_ref(), pages.as_os_str()];
        Cli::try_parse_from(line).unwrap().run(&mut Vec::new(), &INVOCATION).unwrap();
        for (page, word) in [
            ("hksl.1", "hksl\\-train"),
            ("hksl-train.1", "\\-\\-ablation"),
            ("hksl-sweep.1", "\\-\\-launcher"),
            ("hksl-bench-step.1", "\\-\\-batch"),
        ] {
            let text = std::fs::read_to_string(pages.join(page)).unwrap();
            assert!(text.contains(word), "no {word} in {page}");
        }
    }
}
