//! `hksl report`.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use hksl_report::report::{Options, Report, Table, collect};
use hksl_report::statistics::MOST_REPLICATES;
use hksl_train::sweep::{Study, Sweep};

use crate::Invocation;
use crate::exit::Code;
use crate::numbers::{at_least, grouped, whole_within};
use crate::output::Output;
use crate::process;
use crate::table::{self, Align};

/// Options of `hksl report`.
#[derive(Debug, Args)]
#[command(
    after_help = "The report folder contains index.html, which works offline, each figure as SVG and PNG, and the plotted \
                  values as CSV.\nCSV inputs need the columns of eval.csv, or those of the curves that \
                  drqv2 published: agent, task, seed, frame, episode_reward.\n\nExamples:\n  \
                  hksl report runs                                              all runs\n  \
                  hksl report runs --study configs/studies/ablations.toml       with a list of missing runs\n  \
                  hksl report runs curves --every 20000                          with published curves\n\n\
                  For the meaning of each figure, see docs/reports.md."
)]
pub struct Arguments {
    /// Run folders, folders with runs or curves, or CSV files of curves
    #[arg(value_name = "DIR|FILE.csv", required = true)]
    sources: Vec<PathBuf>,

    /// Output folder, new or empty [default: report, report-2, …]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Environment step to compare scores at [default: the runs' budget]
    #[arg(long, value_name = "STEP", value_parser = at_least::<u64>(0))]
    at: Option<u64>,

    /// Interval of the evaluations to use, in environment steps [default: all evaluations]
    #[arg(long, value_name = "STEPS", value_parser = at_least::<u64>(1))]
    every: Option<u64>,

    /// Methods to include, named as their run folders: hksl,hksl-no-c,drq [default: all]
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    methods: Vec<String>,

    /// Tasks to include, named as their run folders: cartpole-swingup,walker-walk-color-easy [default: all]
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    tasks: Vec<String>,

    /// Study file that lists the expected runs
    #[arg(long, value_name = "FILE")]
    study: Option<PathBuf>,

    /// Bootstrap replicates; profiles use at most 2,000
    #[arg(long, value_name = "N", default_value_t = Options::default().replicates, value_parser = whole_within::<usize>(1..=MOST_REPLICATES as i128))]
    replicates: usize,

    /// Bootstrap seed
    #[arg(long, value_name = "SEED", default_value_t = Options::default().seed, value_parser = at_least::<u64>(0))]
    seed: u64,
}

impl Arguments {
    /// Runs the command.
    pub fn run(
        self,
        out: &mut dyn Write,
        quiet: bool,
        invocation: &Invocation,
    ) -> anyhow::Result<Code> {
        let output = Output::new(self.out.as_deref(), "report")?;
        let study = self.study.as_deref().map(Study::read).transpose()?;
        let study = study.map(|study| Sweep::plan(study, None)).transpose()?;
        let study = study.map(|sweep| sweep.outline());
        let options = Options {
            replicates: self.replicates,
            seed: self.seed,
            at: self.at,
            every: self.every,
            methods: trimmed(self.methods),
            tasks: trimmed(self.tasks),
        };
        let collected = collect(&self.sources, hksl_train::names(), hksl_train::account)?;
        if !quiet {
            let runs = counted(collected.records.len());
            writeln!(out, "{runs}; computing statistics and drawing figures")?;
            out.flush()?;
        }
        let report = Report::new(
            &collected,
            &options,
            study.as_ref(),
            &process::command_line(&invocation.arguments),
        )?;
        for file in report.files()? {
            output.bytes(&file.name, &file.bytes)?;
        }
        if quiet {
            return Ok(Code::Done);
        }
        if !report.summary.rows.is_empty() {
            writeln!(out)?;
            show(out, &report.summary)?;
        }
        if !report.missing.is_empty() {
            let runs: usize = report.missing.iter().map(|missing| missing.seeds.len()).sum();
            writeln!(
                out,
                "\nmissing or unfinished: {}, listed in tables/missing.csv",
                counted(runs)
            )?;
        }
        if !report.skipped.is_empty() {
            writeln!(out, "\nexclusions and caveats:")?;
            for sentence in &report.skipped {
                writeln!(out, "  - {sentence}")?;
            }
        }
        writeln!(out, "\n{}", output.folder().join("index.html").display())?;
        Ok(Code::Done)
    }
}

fn trimmed(names: Vec<String>) -> Vec<String> {
    names.iter().map(|name| name.trim().to_owned()).collect()
}

fn counted(runs: usize) -> String {
    format!("{} run{}", grouped(runs as u64), if runs == 1 { "" } else { "s" })
}

fn show(out: &mut dyn Write, of: &Table) -> std::io::Result<()> {
    let heading: Vec<String> = of.heading.iter().map(|name| name.to_uppercase()).collect();
    let align = |index: usize| if index < 2 { Align::Left } else { Align::Right };
    let columns: Vec<(&str, Align)> =
        heading.iter().enumerate().map(|(index, name)| (name.as_str(), align(index))).collect();
    table::write(out, &columns, &of.rows)
}
