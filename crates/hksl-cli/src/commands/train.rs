//! `hksl train`.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use clap::{Args, ValueEnum};
use hksl_train::config::resolve;
use hksl_train::{Ending, Plan, Registry, Resume, RunFolder, RunId, device, preview, train};

use crate::Invocation;
use crate::exit::Code;
use crate::process;
use crate::progress::{Screen, next_commands, write_summary};
use crate::run_settings::RunSettings;
use crate::signals;

/// Options of `hksl train`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    hksl train                                            HKSL on Falling Pixels, without MuJoCo\n  \
    hksl train cartpole-swingup --seed 2                  the paper's settings, seed 2\n  \
    hksl train cartpole-swingup --preset debug            a quick check that takes seconds\n  \
    hksl train --ablation no-c --set sac.batch_size=64 --name small-batches\n\n\
    Ctrl-C or one of the signals TERM, HUP, USR1, USR2 and XCPU stops the run after its agent step and saves it\n\
    (exit code 75). A second Ctrl-C exits at once. Under nohup, HUP is ignored.\n\
    To resume a run that was stopped or killed, repeat its command.")]
pub struct Arguments {
    #[command(flatten)]
    settings: RunSettings,

    /// Folder for all runs
    #[arg(long, value_name = "DIR", default_value = "runs", help_heading = "Output")]
    runs: PathBuf,

    /// Variant name in the run's folder, instead of the names of its presets
    #[arg(long, value_name = "NAME", value_parser = variant, help_heading = "Output")]
    name: Option<String>,

    /// Handling of an existing run: auto resumes it, never leaves it unchanged and fails
    #[arg(long, value_name = "WHEN", default_value = "auto", help_heading = "Output")]
    resume: When,

    /// Summary of the run, without training
    #[arg(long, help_heading = "Output")]
    dry_run: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum When {
    Auto,
    Never,
}

/// Parses the name of a variant, which becomes part of a folder name.
fn variant(name: &str) -> Result<String, String> {
    hksl_train::check_name(name).map_err(|reason| format!("it {reason}"))?;
    Ok(name.to_owned())
}

impl Arguments {
    /// Whether standard output carries the result.
    pub fn prints_data(&self) -> bool {
        self.dry_run
    }

    /// Runs the command.
    pub fn run(
        self,
        out: &mut dyn Write,
        quiet: bool,
        invocation: &Invocation,
    ) -> anyhow::Result<Code> {
        let config = resolve(&self.settings.request())?.config;
        device::set_threads(config.threads)?;
        let id = RunId { presets: self.settings.presets, name: self.name };
        let folder = RunFolder::of(&self.runs, &config, &id);
        // A dry run has nothing to save, so signals keep their default effect.
        let stop = if self.dry_run { Arc::default() } else { signals::stop(quiet)? };
        let plan = Plan {
            stop: &stop,
            config: &config,
            folder: &folder,
            factories: &Registry,
            device: device::open(config.device_choice()?)?,
            command: process::command_line(&invocation.arguments),
            resume: match self.resume {
                When::Auto => Resume::Auto,
                When::Never => Resume::Never,
            },
        };
        if self.dry_run {
            write_summary(out, &preview(&plan)?)?;
            return Ok(Code::Done);
        }
        let mut screen = Screen::new(out, quiet);
        let mut shown = Ok(());
        let outcome = train(&plan, &mut |event| {
            if shown.is_ok() {
                shown = screen.show(event);
            }
        })?;
        if outcome.ending == Ending::Stopped {
            return Ok(Code::Stopped);
        }
        shown?;
        if !quiet {
            let best = outcome.best_evaluation.map(|(_, step)| step);
            let better = best.filter(|&step| step != outcome.environment_step);
            writeln!(out, "{}", next_commands(folder.path(), better))?;
        }
        Ok(Code::Done)
    }
}
