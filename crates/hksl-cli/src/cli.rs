//! The command line's grammar.

use std::io::Write;

use clap::{CommandFactory, Parser, Subcommand};

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
    after_help = "Exit codes: 0 done, 1 failure, 2 wrong arguments or configuration,\n            \
                  3 graphics or a native library missing, 75 stopped by a signal and saved."
)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,

    /// Print errors and what was asked for, nothing else
    #[arg(long, short, global = true, display_order = 1000)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Train an agent, or go on with a run that was stopped
    Train(Box<commands::train::Arguments>),
    /// Evaluate a run's policy
    Eval(commands::eval::Arguments),
    /// Play a policy, or recorded actions from a recorded state; writes steps and pictures
    Rollout(Box<commands::rollout::Arguments>),
    /// How well a linear map from frozen encoders predicts where things will be
    Probe(Box<commands::probe::Arguments>),
    /// What a communication manager says at each step of a trajectory
    AnalyzeComm(commands::analyze_comm::Arguments),
    /// Where each level's encoder looks
    Attention(commands::attention::Arguments),
    /// Many runs as one study, on this machine or with Slurm
    Sweep(commands::sweep::Arguments),
    /// What many runs say together: scores with intervals, curves, figures, one page
    Report(commands::report::Arguments),
    /// Look at configurations
    #[command(subcommand)]
    Config(commands::config::Command),
    /// Measure how fast this machine learns
    #[command(subcommand)]
    Bench(commands::bench::Command),
    /// List the tasks
    Tasks,
    /// Check this machine and this build, with advice
    Doctor(commands::doctor::Arguments),
    /// Print a completion script for a shell
    Completions(commands::completions::Arguments),
    /// Write the man pages
    Man(commands::man::Arguments),
}

impl Cli {
    /// Carries the command out.
    pub fn run(self, out: &mut dyn Write) -> anyhow::Result<Code> {
        match self.command {
            Command::Train(arguments) => arguments.run(out, self.quiet),
            Command::Eval(arguments) => arguments.run(out, self.quiet),
            Command::Rollout(arguments) => arguments.run(out, self.quiet),
            Command::Probe(arguments) => arguments.run(out, self.quiet),
            Command::AnalyzeComm(arguments) => arguments.run(out, self.quiet),
            Command::Attention(arguments) => arguments.run(out, self.quiet),
            Command::Sweep(arguments) => arguments.run(out, self.quiet),
            Command::Report(arguments) => arguments.run(out, self.quiet),
            Command::Config(command) => command.run(out),
            Command::Bench(command) => command.run(out, self.quiet),
            Command::Tasks => commands::tasks::run(out, self.quiet),
            Command::Doctor(arguments) => arguments.run(out, self.quiet),
            Command::Completions(arguments) => arguments.run(Self::command(), out),
            Command::Man(arguments) => arguments.run(Self::command(), out, self.quiet),
        }
    }

    /// What the command's standard output is for.
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

    #[test]
    fn the_grammar_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_shells_script_knows_the_commands_and_the_tasks() {
        for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
            let mut out = Vec::new();
            Cli::try_parse_from(["hksl", "completions", shell]).unwrap().run(&mut out).unwrap();
            let script = String::from_utf8(out).unwrap();
            assert!(script.contains("doctor") && script.contains("preset"), "{shell}");
        }
    }

    #[test]
    fn every_command_has_its_man_page() {
        let folder = tempfile::tempdir().unwrap();
        let pages = folder.path().join("man1");
        let line = ["hksl".as_ref(), "man".as_ref(), pages.as_os_str()];
        Cli::try_parse_from(line).unwrap().run(&mut Vec::new()).unwrap();
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
