//! What becomes of the commands that the book names.

use std::fs;

use super::root;
use super::shrink::{after, shrunk};

/// What to do in a command's place.
#[derive(Debug, PartialEq)]
pub enum Act {
    /// `hksl` with these words.
    Hksl(Vec<String>),
    /// An example of a crate, with these words.
    Example(String, Vec<String>),
    /// Nothing, for this reason.
    Leave(&'static str),
    /// Fail: this is wrong with it.
    Refuse(String),
}

/// Commands that are not run, by how they begin, and why.
const LEFT: &[(&str, &str)] = &[
    ("make setup", "fetches MuJoCo and the models"),
    ("make build", "makes the binary that the test runs"),
    ("make test", "is this test, among others"),
    ("make check", "runs beside the tests in continuous integration"),
    ("HKSL_TEST_GPU=0", "needs a GPU"),
    ("make install", "writes into the user's folders"),
    ("make book", "tests/it/book.rs does the same"),
    ("make wheel", "builds the Python package, as `make python-test` does"),
    ("make python-test", "runs after `make test` in continuous integration"),
    (
        "pip install .",
        "writes into the user's Python; `make python-test` does it in one of its own",
    ),
    ("make bench", "takes long, and PyTorch"),
    ("make thirty", "thirty runs; tests/it/every_method.rs and commands.rs have one of each kind"),
    (
        "cargo run --release -p hksl-train --example follow_the_dot",
        "trains for minutes; crates/hksl-train/tests/it/learning.rs does the same",
    ),
    ("cargo test", "is run by `make test`"),
    ("cargo bench", "measures for minutes"),
    ("tensorboard", "serves until it is stopped, and is another project's"),
    ("jq", "is not on this machine"),
    ("python3", "is not on this machine"),
];

/// Every program that is stood in for.
pub const STOOD_IN_FOR: &[&str] = &["hksl", "make", "cargo", "pip", "tensorboard"];

/// Programs that are run as they are, where the machine has them.
pub const AS_THEY_ARE: &[&str] = &["jq", "mkdir", "python3"];

/// What to do in place of this command. `settings` is as in [`shrunk`].
pub fn act(program: &str, words: &[String], settings: &str) -> Act {
    let command = format!("{program} {} ", words.join(" "));
    let refuse = |what: &str| Act::Refuse(format!("`{}`: {what}", command.trim()));
    if let Some(example) = after(words, "--example")
        && program == "cargo"
        && !has_example(example)
    {
        return refuse("there is no such example");
    }
    if let ("make", Some(target)) = (program, words.first())
        && !has_target(target)
    {
        return refuse("the Makefile has no such target");
    }
    let left = LEFT.iter().find(|(start, _)| command.starts_with(&format!("{start} ")));
    if let Some((_, reason)) = left {
        return Act::Leave(reason);
    }
    let hksl = |words: &[String]| match shrunk(words, settings) {
        Some(words) => Act::Hksl(words),
        None => refuse("tests/src/book/shrink.rs does not say how it becomes small"),
    };
    match (program, words.first().map(String::as_str)) {
        ("hksl", _) => hksl(words),
        ("make", Some("train")) => {
            let variable = |name: &str| words.iter().find_map(|word| word.strip_prefix(name));
            let task = variable("TASK=").unwrap_or("cartpole-swingup");
            let more = variable("ARGS=").unwrap_or_default().split_whitespace();
            let words: Vec<String> =
                ["train", task].into_iter().chain(more).map(str::to_owned).collect();
            hksl(&words)
        }
        ("cargo", Some("run")) => {
            let own = words.iter().position(|word| word == "--").map_or(words.len(), |at| at + 1);
            match after(words, "--example") {
                Some("own_environment") => {
                    Act::Example("own_environment".into(), vec!["300".into()])
                }
                Some(example) => Act::Example(example.to_owned(), words[own..].to_vec()),
                None if after(words, "-p") == Some("hksl-cli") => hksl(&words[own..]),
                None => refuse("only `hksl-cli` and examples are run"),
            }
        }
        _ => refuse("tests/src/book/commands.rs neither runs it nor says why not"),
    }
}

fn has_example(name: &str) -> bool {
    let crates = fs::read_dir(root().join("crates")).unwrap();
    crates.flatten().any(|krate| krate.path().join(format!("examples/{name}.rs")).is_file())
}

fn has_target(name: &str) -> bool {
    let makefile = fs::read_to_string(root().join("Makefile")).unwrap();
    makefile.lines().any(|line| line.starts_with(&format!("{name}:")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(command: &str) -> Act {
        let mut words = command.split('|').map(str::to_owned);
        let program = words.next().unwrap();
        act(&program, &words.collect::<Vec<_>>(), "small")
    }

    #[test]
    fn commands_are_run_or_left_or_refused() {
        let hksl = |words: &str| Act::Hksl(words.split(' ').map(str::to_owned).collect());
        let small = "--config small/hksl.toml";
        assert_eq!(of("make|train"), hksl(&format!("train cartpole-swingup {small}")));
        assert_eq!(
            of("make|train|TASK=walker-walk|ARGS=--preset debug"),
            hksl("train walker-walk --preset debug")
        );
        assert_eq!(
            of("cargo|run|-p|hksl-cli|--|train|falling-pixels"),
            hksl(&format!("train falling-pixels {small}"))
        );
        let example = Act::Example("own_method".to_owned(), Vec::new());
        assert_eq!(of("cargo|run|--release|-p|hksl-train|--example|own_method"), example);
        assert!(matches!(of("make|install"), Act::Leave(_)));
        for wrong in ["make|dinner", "cargo|run|--example|none", "hksl|fly", "rm|-r|runs"] {
            assert!(matches!(of(wrong), Act::Refuse(_)), "{wrong}");
        }
    }
}
