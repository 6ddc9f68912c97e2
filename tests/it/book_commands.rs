//! Every command of the README and of the book runs, in the order in which a reader meets them, each page's after
//! those of the pages before it.
//!
//! A shell runs each block of `sh` in one folder. The programs that it finds there are `book-command` under their names:
//! `hksl` with a small budget and otherwise as the book has it, examples, and what is left out with a reason
//! (`tests/src/book/commands.rs`). There is no other program, so that a command nobody has thought of fails.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

use hksl_tests::book::commands::{AS_THEY_ARE, STOOD_IN_FOR};
use hksl_tests::book::markdown::Page;
use hksl_tests::book::shrink::debug_settings;
use hksl_tests::book::{pages, root};
use hksl_tests::{binary, done, hksl};

fn readme_and_pages() -> Vec<Page> {
    std::iter::once(Page::read(&root().join("README.md"))).chain(pages()).collect()
}

/// A folder in which the commands of the book find what they need.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["bin", "small", "target/release"] {
        fs::create_dir_all(path(name)).unwrap();
    }
    let stand_in = env!("CARGO_BIN_EXE_book-command");
    symlink(stand_in, path("target/release/hksl")).unwrap();
    for program in STOOD_IN_FOR {
        symlink(stand_in, path("bin").join(program)).unwrap();
    }
    for program in AS_THEY_ARE {
        let real = program_here(program).unwrap_or_else(|| stand_in.into());
        symlink(real, path("bin").join(program)).unwrap();
    }
    symlink(root().join("configs"), path("configs")).unwrap();
    for method in ["hksl", "sac", "drq", "curl", "pi-sac", "dbc", "dreamer-v2"] {
        fs::write(path("small").join(method).with_extension("toml"), debug_settings(method))
            .unwrap();
    }
    // The page on reports names a folder of other people's curves.
    fs::create_dir(path("curves")).unwrap();
    let curve = "agent,task,seed,frame,episode_reward\nDrQ-v2,cartpole_swingup,1,0,9\n\
                 DrQ-v2,cartpole_swingup,1,240,80\n";
    fs::write(path("curves/cartpole_swingup.csv"), curve).unwrap();
    // Files that pages show and name.
    for (page, language, file) in
        [("sweeps", "toml", "mine.toml"), ("environments", "json", "state.json")]
    {
        let page = Page::read(&root().join("docs").join(page).with_extension("md"));
        let shown = page.blocks.iter().find(|block| block.language == language).unwrap();
        fs::write(path(file), &shown.text).unwrap();
    }
    folder
}

/// Where a program is; Python says it itself, for it may hide behind a script that chooses one.
fn program_here(program: &str) -> Option<PathBuf> {
    let printed = |command: &mut Command| {
        let output = command.output().ok().filter(|output| output.status.success())?;
        Some(PathBuf::from(String::from_utf8(output.stdout).ok()?.trim()))
    };
    match program {
        "python3" => {
            printed(Command::new(program).args(["-c", "import sys; print(sys.executable)"]))
        }
        _ => printed(Command::new("sh").args(["-c", &format!("command -v {program}")])),
    }
}

#[test]
fn every_command_runs() {
    let folder = folder();
    let (own, programs) = (folder.path(), binary());
    let mut ran = 0;
    for page in readme_and_pages() {
        for block in page.blocks.iter().filter(|block| block.language == "sh") {
            let output = Command::new("/bin/sh")
                .args(["-eu", "-c", &block.text])
                .current_dir(own)
                .env("PATH", own.join("bin"))
                .env("HOME", own)
                .env("HKSL_CACHE", own.join("cache"))
                .env("BOOK_FOLDER", own)
                .env("BOOK_PROGRAMS", programs.parent().unwrap())
                .output()
                .unwrap();
            let said = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
            assert!(
                output.status.success(),
                "{}:{}: {}{}{}",
                page.path.display(),
                block.line,
                block.text,
                said[0],
                said[1]
            );
            ran += 1;
        }
    }
    let notes = fs::read_to_string(own.join("commands.txt")).unwrap();
    println!("{notes}");
    assert!(ran > 10, "only {ran} blocks were found");
    assert!(!notes.contains("failed: "), "{notes}");
    // Whoever adds a command to `hksl` shows it in the book.
    for command in commands(own) {
        let shown = notes.lines().any(|line| line.starts_with(&format!("hksl {command}")));
        assert!(shown, "the book has no block of sh with `hksl {command}`");
    }
}

/// The commands that the binary has, those under `bench` and `config` by both words.
fn commands(folder: &Path) -> BTreeSet<String> {
    let listed = |words: &[&str]| -> Vec<String> {
        let help = done(folder, &[words, &["--help"]].concat());
        let list = help.split("Commands:\n").nth(1).unwrap_or_default().to_owned();
        let list = list.lines().take_while(|line| !line.is_empty());
        let names =
            list.filter_map(|line| line.strip_prefix("  ").filter(|rest| !rest.starts_with(' ')));
        let names = names.filter_map(|rest| rest.split_whitespace().next());
        names.filter(|name| *name != "help").map(str::to_owned).collect()
    };
    let mut commands = BTreeSet::new();
    for command in listed(&[]) {
        match listed(&[&command]).as_slice() {
            [] => drop(commands.insert(command)),
            inner => commands.extend(inner.iter().map(|name| format!("{command} {name}"))),
        }
    }
    commands
}

#[test]
fn commands_in_passing_name_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let mut helps: BTreeMap<String, String> = BTreeMap::new();
    for page in readme_and_pages() {
        for code in page.code.iter().filter(|code| code.starts_with("hksl ")) {
            let place = format!("{}: `{code}`", page.path.display());
            let words: Vec<&str> = code.split_whitespace().skip(1).collect();
            let inner =
                ["sweep status", "config show", "bench step", "bench render", "bench checkpoint"];
            let command = match words.as_slice() {
                [first, second, ..] if inner.contains(&&*format!("{first} {second}")) => {
                    format!("{first} {second}")
                }
                [first, ..] if !first.starts_with('-') => (*first).to_owned(),
                _ => String::new(),
            };
            let help = helps.entry(command.clone()).or_insert_with(|| {
                let words: Vec<&str> = command.split(' ').filter(|word| !word.is_empty()).collect();
                let ended = hksl(folder.path(), &[&words[..], &["--help"]].concat());
                assert_eq!(ended.code, 0, "{place}: {}", ended.err);
                ended.out
            });
            let options = words.iter().filter(|word| word.starts_with("--"));
            for option in options.map(|word| word.split('=').next().unwrap()) {
                let known = help.split(|c: char| !(c.is_alphanumeric() || c == '-'));
                assert!(known.into_iter().any(|word| word == option), "{place}: no {option}");
            }
        }
    }
    assert!(helps.len() > 10, "{:?}", helps.keys());
}
