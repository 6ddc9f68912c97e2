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
    match cli::Cli::parse().run() {
        Ok(code) => code.into(),
        Err(error) if exit::is_broken_pipe(&error) => exit::Code::Done.into(),
        Err(error) => {
            eprintln!("{}", exit::describe(&error));
            exit::Code::of(&error).into()
        }
    }
}
