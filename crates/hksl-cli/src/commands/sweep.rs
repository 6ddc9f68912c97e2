//! `hksl sweep`.

mod screen;

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, Subcommand, ValueEnum};
use hksl_train::RunFolder;
use hksl_train::sweep::{
    Jobs, Launch, Standing, Study, Sweep, launch, standing, submit, write_jobs,
};

use crate::Invocation;
use crate::exit::{Code, Misuse};
use crate::numbers::{at_least, grouped};
use crate::signals;
use crate::table::{self, Align};
use screen::Screen;

/// Options of `hksl sweep`.
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "A study file lists tasks, distractors, methods, ablations and seeds; every combination is one run \
                  of `hksl train`.\nThe paper's studies are in configs/studies.\n\nExamples:\n  \
                  hksl sweep configs/studies/ablations.toml --dry-run        list the runs and their cost\n  \
                  hksl sweep my.toml --jobs 2                                two at a time on this machine\n  \
                  hksl sweep my.toml --launcher slurm                        submit a job array and exit\n  \
                  hksl sweep status my.toml                                  the status of each run\n\n\
                  To continue a sweep, repeat the command: finished runs are skipped and interrupted ones are resumed."
)]
pub struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,

    /// Study file
    #[arg(value_name = "FILE", required = true)]
    file: Option<PathBuf>,

    /// List of the runs and their cost, without launching any
    #[arg(long)]
    dry_run: bool,

    /// Launcher of the runs
    #[arg(long, value_name = "WHERE", default_value = "local")]
    launcher: Launcher,

    /// Concurrent runs on this machine, which share its cores [default: the study's]
    #[arg(long, value_name = "N", value_parser = at_least::<u32>(1))]
    jobs: Option<u32>,

    /// Folder for all runs [default: the study's]
    #[arg(long, value_name = "DIR")]
    runs: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Launcher {
    /// This machine
    Local,
    /// A Slurm job array
    Slurm,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Print the status of each run of a study or in a folder
    Status {
        /// Study file, or folder of runs
        #[arg(value_name = "FILE|DIR")]
        of: PathBuf,

        /// Folder for all runs of the study file [default: the study's]
        #[arg(long, value_name = "DIR")]
        runs: Option<PathBuf>,
    },
}

impl Arguments {
    /// Whether standard output carries the result.
    pub fn prints_data(&self) -> bool {
        self.dry_run || self.command.is_some()
    }

    /// Runs the command.
    pub fn run(
        self,
        out: &mut dyn Write,
        quiet: bool,
        invocation: &Invocation,
    ) -> anyhow::Result<Code> {
        if let Some(Command::Status { of, runs }) = self.command {
            return status(out, &of, runs.as_deref());
        }
        let file =
            self.file.context("no study file given; name one, as in `hksl sweep my.toml`")?;
        let sweep = Sweep::plan(Study::read(&file)?, self.runs.as_deref())?;
        if self.dry_run {
            return dry_run(out, &sweep);
        }
        let binary = invocation.program.clone().map_or_else(std::env::current_exe, Ok);
        let binary = binary.context("cannot find the path of this program")?;
        match self.launcher {
            Launcher::Slurm if self.jobs.is_some() => Err(Misuse(
                "--jobs has no effect with --launcher slurm; set at_once in the [slurm] section of the study file instead".into(),
            )
            .into()),
            Launcher::Slurm => slurm(out, &sweep, &binary),
            Launcher::Local => {
                let jobs = self.jobs.map_or(sweep.study.local.jobs, |jobs| jobs as usize);
                local(out, &sweep, &binary, jobs, quiet)
            }
        }
    }
}

fn dry_run(out: &mut dyn Write, sweep: &Sweep) -> anyhow::Result<Code> {
    let columns = [
        ("RUN", Align::Left),
        ("GROUP", Align::Right),
        ("ENVIRONMENT STEPS", Align::Right),
        ("LEARNING STEPS", Align::Right),
        ("STATUS", Align::Left),
    ];
    let (mut rows, mut environment_steps, mut learning_steps) = (Vec::new(), 0, 0);
    for run in &sweep.runs {
        let config = &run.config;
        let learning = config.learning_steps();
        environment_steps += config.environment_steps;
        learning_steps += learning;
        rows.push(vec![
            run.label(&sweep.runs_folder),
            run.group.to_string(),
            grouped(config.environment_steps),
            grouped(learning),
            told(&run.standing()),
        ]);
    }
    table::write(out, &columns, &rows)?;
    writeln!(
        out,
        "\n{} runs under {}: {} environment steps, {} learning steps",
        sweep.runs.len(),
        sweep.runs_folder.display(),
        grouped(environment_steps),
        grouped(learning_steps)
    )?;
    Ok(Code::Done)
}

fn local(
    out: &mut dyn Write,
    sweep: &Sweep,
    binary: &Path,
    jobs: usize,
    quiet: bool,
) -> anyhow::Result<Code> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let stop = signals::stop(quiet)?;
    let how = Launch { binary, jobs, threads: (cores / jobs).max(1), stop: &stop };
    let mut screen = Screen::new(out, sweep, quiet);
    let mut shown = Ok(());
    let failed = launch(sweep, &how, &mut |event| {
        if shown.is_ok() {
            shown = screen.show(event);
        }
    })?;
    shown.and_then(|()| screen.finish(failed))?;
    if failed > 0 {
        return Ok(Code::Failure);
    }
    let all_done = sweep.runs.iter().all(|run| matches!(run.standing(), Standing::Done { .. }));
    Ok(if all_done { Code::Done } else { Code::Stopped })
}

fn slurm(out: &mut dyn Write, sweep: &Sweep, binary: &Path) -> anyhow::Result<Code> {
    let Jobs { arrays, queued } = write_jobs(sweep, binary)?;
    if arrays.is_empty() {
        writeln!(out, "all {} runs are done, running or queued", sweep.runs.len())?;
        return Ok(Code::Done);
    }
    if queued > 0 {
        writeln!(out, "{queued} already queued")?;
    }
    let mut before: Option<String> = None;
    for array in &arrays {
        // `at_once` limits a single array, so with it each array waits for the previous one.
        let after = before.as_deref().filter(|_| sweep.study.slurm.at_once.is_some());
        let job = submit(array, after)?;
        writeln!(
            out,
            "job {job} with {} of {} runs, submitted with {}{}",
            array.runs,
            sweep.runs.len(),
            array.script.display(),
            after.map_or_else(String::new, |after| format!(", after job {after}"))
        )?;
        before = Some(job);
    }
    writeln!(out, "this command may exit now; `hksl sweep status` shows the status of the runs")?;
    Ok(Code::Done)
}

/// Prints the status of a study's runs, or of all runs in a folder.
fn status(out: &mut dyn Write, of: &Path, runs: Option<&Path>) -> anyhow::Result<Code> {
    let found: Vec<(String, u64, Standing)> = if of.is_dir() {
        if runs.is_some() {
            let reason = format!(
                "--runs has no effect here: {} is a folder of runs; leave it out",
                of.display()
            );
            return Err(Misuse(reason).into());
        }
        let runs = RunFolder::all_under(of)?;
        let row = |folder: &RunFolder| {
            let label = folder.path().strip_prefix(of).unwrap_or(folder.path());
            let label = label.to_string_lossy().into_owned();
            match folder.labels() {
                Ok(labels) => {
                    let budget = labels.environment_steps;
                    (label, budget, standing(folder, budget))
                }
                Err(error) => (label, 0, Standing::Failed { reason: error.to_string() }),
            }
        };
        runs.iter().map(row).collect()
    } else {
        let sweep = Sweep::plan(Study::read(of)?, runs)?;
        let row = |run: &hksl_train::sweep::PlannedRun| {
            let label = run.label(&sweep.runs_folder);
            (label, run.config.environment_steps, run.standing())
        };
        sweep.runs.iter().map(row).collect()
    };
    let columns = [("RUN", Align::Left), ("OF", Align::Right), ("STATUS", Align::Left)];
    let rows: Vec<Vec<String>> = found
        .iter()
        .map(|(label, budget, standing)| vec![label.clone(), grouped(*budget), told(standing)])
        .collect();
    table::write(out, &columns, &rows)?;
    let count = |which: fn(&Standing) -> bool| found.iter().filter(|(.., s)| which(s)).count();
    writeln!(
        out,
        "\n{} runs: {} done, {} running, {} stopped, {} failed, {} not started",
        found.len(),
        count(|s| matches!(s, Standing::Done { .. })),
        count(|s| matches!(s, Standing::Running { .. })),
        count(|s| matches!(s, Standing::Stopped { .. })),
        count(|s| matches!(s, Standing::Failed { .. })),
        count(|s| matches!(s, Standing::NotBegun)),
    )?;
    Ok(Code::Done)
}

/// Describes the status of a run.
fn told(standing: &Standing) -> String {
    match standing {
        Standing::NotBegun => "not started".to_owned(),
        Standing::Running { environment_step } => {
            format!("running, at {}", grouped(*environment_step))
        }
        Standing::Stopped { environment_step } => {
            format!("stopped, saved at {}", grouped(*environment_step))
        }
        Standing::Failed { reason } => {
            format!("failed: {}", reason.lines().next().unwrap_or_default())
        }
        Standing::Done { last_return } => format!("done, return {last_return:.1}"),
    }
}
