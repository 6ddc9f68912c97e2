//! Stands in for the programs that the book's commands name, under their names: runs them small, leaves out what
//! cannot be run, and fails on what nobody has thought of. `tests/it/book_commands.rs` puts it on the PATH.
#![allow(clippy::unwrap_used)]

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use hksl_tests::book::commands::{Act, act};

fn main() -> ExitCode {
    let mut words = std::env::args();
    let program = words.next().unwrap_or_default();
    let program = Path::new(&program).file_name().unwrap_or_default().to_string_lossy();
    let words: Vec<String> = words.collect();
    let variable = |name: &str| std::env::var(name).unwrap_or_else(|_| panic!("no {name}"));
    let folder = PathBuf::from(variable("BOOK_FOLDER"));
    let programs = PathBuf::from(variable("BOOK_PROGRAMS"));
    let note = |what: &str| {
        let path = folder.join("commands.txt");
        let file = OpenOptions::new().create(true).append(true).open(path);
        writeln!(file.unwrap(), "{what}").unwrap();
    };
    let run = |program: PathBuf, words: &[String]| {
        let status = Command::new(&program).args(words).status();
        let status = status.unwrap_or_else(|error| {
            let make = "cargo build --workspace --release --bins --examples";
            panic!("{}: {error}; `{make}` makes it", program.display())
        });
        if !status.success() {
            // Seen even where a shell would not care, as before a pipe.
            note(&format!("failed: {} {}", program.display(), words.join(" ")));
        }
        ExitCode::from(status.code().and_then(|code| code.try_into().ok()).unwrap_or(1))
    };
    match act(&program, &words, folder.join("small").to_str().unwrap()) {
        Act::Hksl(words) => {
            note(&format!("hksl {}", words.join(" ")));
            run(programs.join("hksl"), &words)
        }
        Act::Example(name, words) => {
            note(&format!("example {name} {}", words.join(" ")));
            run(programs.join("examples").join(name), &words)
        }
        Act::Leave(reason) => {
            note(&format!("left out: {program} {}: {reason}", words.join(" ")));
            ExitCode::SUCCESS
        }
        Act::Refuse(reason) => {
            eprintln!("{reason}");
            note(&format!("failed: {reason}"));
            ExitCode::FAILURE
        }
    }
}
