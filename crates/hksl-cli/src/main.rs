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

fn main() -> ExitCode {
    process::prepare();
    // What the libraries warn of: a damaged checkpoint that is passed over, MuJoCo's own words.
    tracing_subscriber::fmt()
        .with_max_level(tracing_subscriber::filter::LevelFilter::WARN)
        .with_writer(std::io::stderr)
        .with_target(false)
        .without_time()
        .with_ansi(false)
        .init();
    match cli::Cli::parse().run() {
        Ok(code) => code.into(),
        Err(error) if exit::is_broken_pipe(&error) => exit::Code::Done.into(),
        Err(error) => {
            eprintln!("{}", exit::describe(&error));
            exit::Code::of(&error).into()
        }
    }
}
