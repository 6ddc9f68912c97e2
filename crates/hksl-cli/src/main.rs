//! `hksl`: trains and examines HKSL agents. Presentation only; the work is done in the libraries.

mod cli;
mod commands;
mod exit;
mod memory;
mod names;
mod numbers;
mod progress;
mod run_settings;
mod table;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    memory::keep_freed();
    match cli::Cli::parse().run() {
        Ok(code) => code.into(),
        Err(error) if exit::is_broken_pipe(&error) => exit::Code::Done.into(),
        Err(error) => {
            eprintln!("{}", exit::describe(&error));
            exit::Code::of(&error).into()
        }
    }
}
