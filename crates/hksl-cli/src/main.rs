//! `hksl`: trains and examines HKSL agents. Presentation only; the work is done in the libraries.

mod cli;
mod commands;
mod exit;
mod names;
mod numbers;
mod output;
mod process;
mod progress;
mod run_settings;
mod signals;
mod table;

use std::process::ExitCode;

use clap::Parser;
use tracing_subscriber::filter::LevelFilter;

fn main() -> ExitCode {
    process::prepare();
    let cli = cli::Cli::parse();
    // What the libraries warn of: a damaged checkpoint that is passed over, MuJoCo's own words.
    tracing_subscriber::fmt()
        .with_max_level(if cli.quiet { LevelFilter::ERROR } else { LevelFilter::WARN })
        .with_writer(std::io::stderr)
        .with_target(false)
        .without_time()
        .with_ansi(false)
        .init();
    match cli.run() {
        Ok(code) => code.into(),
        Err(error) if exit::is_broken_pipe(&error) => exit::Code::Done.into(),
        Err(error) => {
            eprintln!("{}", exit::describe(&error));
            exit::Code::of(&error).into()
        }
    }
}
