//! `hksl`: trains and analyses HKSL agents. This crate only parses arguments and prints; the libraries do the work.
//!
//! [`run`] is the whole program, for the binary and for packages that install it under the same name.
#![deny(missing_docs)]
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

use std::ffi::OsString;
use std::path::PathBuf;

use clap::Parser;
use tracing_subscriber::filter::LevelFilter;

pub use exit::{Code, describe};
pub use process::{keep_freed_memory, prepare};

/// How this program was started.
#[derive(Debug, Clone)]
pub struct Invocation {
    /// Its arguments, without the program's name.
    pub arguments: Vec<OsString>,
    /// The file that starts it, for the runs of a sweep; that of the process if there is none.
    pub program: Option<PathBuf>,
}

/// Runs the command line, and returns the exit code of the process.
pub fn run(invocation: &Invocation) -> Code {
    signals::survive_file_size_limit();
    let name = [OsString::from("hksl")];
    let cli = match cli::Cli::try_parse_from(name.iter().chain(&invocation.arguments)) {
        Ok(cli) => cli,
        Err(said) => return standard::print_parsers(&said),
    };
    // Warnings of the libraries, such as a skipped damaged checkpoint or a message from MuJoCo.
    let _ = tracing_subscriber::fmt()
        .with_max_level(if cli.quiet { LevelFilter::ERROR } else { LevelFilter::WARN })
        .with_writer(std::io::stderr)
        // It would report a failed write to standard error on standard error, and panic.
        .log_internal_errors(false)
        .with_target(false)
        .without_time()
        .with_ansi(false)
        .try_init();
    let mut out = standard::Stdout::new(cli.purpose());
    let code = cli.run(&mut out, invocation).unwrap_or_else(|error| {
        standard::error_line(&exit::describe(&error));
        exit::Code::of(&error)
    });
    out.finish(code)
}
