//! `hksl`: trains and analyses HKSL agents. This crate only parses arguments and prints; the libraries do the work.
#![deny(clippy::print_stdout, clippy::print_stderr)]

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
mod standard;
mod table;

use std::process::ExitCode;

use clap::Parser;
use tracing_subscriber::filter::LevelFilter;

fn main() -> ExitCode {
    process::prepare();
    signals::survive_file_size_limit();
    let cli = match cli::Cli::try_parse() {
        Ok(cli) => cli,
        Err(said) => return standard::print_parsers(&said).into(),
    };
    // Warnings of the libraries, such as a skipped damaged checkpoint or a message from MuJoCo.
    tracing_subscriber::fmt()
        .with_max_level(if cli.quiet { LevelFilter::ERROR } else { LevelFilter::WARN })
        .with_writer(std::io::stderr)
        // It would report a failed write to standard error on standard error, and panic.
        .log_internal_errors(false)
        .with_target(false)
        .without_time()
        .with_ansi(false)
        .init();
    let mut out = standard::Stdout::new(cli.purpose());
    let code = cli.run(&mut out).unwrap_or_else(|error| {
        standard::error_line(&exit::describe(&error));
        exit::Code::of(&error)
    });
    out.finish(code).into()
}
