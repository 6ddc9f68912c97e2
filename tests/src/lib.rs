//! Runs the binary `hksl` that `make build` made, as a user would.
#![deny(missing_docs)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

pub mod book;
#[cfg(unix)]
pub mod chromium;
pub mod synthetic;
pub mod untrusted;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// The binary of the profile that the tests are built in.
///
/// # Panics
/// If it has not been built.
pub fn binary() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let binary =
        test.ancestors().nth(2).unwrap().join(format!("hksl{}", std::env::consts::EXE_SUFFIX));
    assert!(binary.is_file(), "{} is missing: run `make build` first", binary.display());
    binary
}

/// What a command printed and how it ended.
#[derive(Debug)]
pub struct Ended {
    /// Exit code.
    pub code: i32,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code().unwrap_or(-1),
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

/// Runs `hksl` with these arguments in this folder.
pub fn hksl(folder: &Path, arguments: &[&str]) -> Ended {
    Command::new(binary()).args(arguments).current_dir(folder).output().unwrap().into()
}

/// Runs `hksl` and fails unless it exits 0.
pub fn done(folder: &Path, arguments: &[&str]) -> String {
    let ended = hksl(folder, arguments);
    assert_eq!(ended.code, 0, "hksl {}: {}{}", arguments.join(" "), ended.out, ended.err);
    ended.out
}

/// The lines of a `metrics.jsonl` without the values that are times.
pub fn metrics_without_times(path: &Path) -> Vec<BTreeMap<String, Value>> {
    let text = std::fs::read_to_string(path).unwrap();
    let timed = |name: &str| name.ends_with("_seconds") || name.ends_with("_per_second");
    text.lines()
        .map(|line| {
            let mut values: BTreeMap<String, Value> = serde_json::from_str(line).unwrap();
            values.retain(|name, _| !timed(name));
            values
        })
        .collect()
}

/// The rows of an `eval.csv` without their last column, the time.
pub fn evaluations_without_times(path: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().map(|line| line.rsplit_once(',').unwrap().0.to_owned()).collect()
}

/// The rows of a CSV file without quotes, by column.
///
/// # Panics
/// If there is no such file.
pub fn rows_of(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = std::fs::read_to_string(path);
    let text = text.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        let cells = names.iter().zip(line.split(','));
        cells.map(|(name, cell)| ((*name).to_owned(), cell.to_owned())).collect()
    };
    lines.map(row).collect()
}

/// Options that render frames several times as fast: for tests of anything but rendering.
pub const PLAIN_RENDERING: [&str; 6] = [
    "--set",
    "render.shadows=false",
    "--set",
    "render.reflections=false",
    "--set",
    "render.samples=0",
];

/// `hksl train` of two threads on the CPU with the preset `debug`, in the folder `runs`.
pub fn train_arguments<'a>(runs: &'a Path, arguments: &[&'a str]) -> Vec<&'a str> {
    let fixed = ["--preset", "debug", "--threads", "2", "--device", "cpu", "--runs"];
    let runs = runs.to_str().unwrap();
    [&["train"], arguments, &fixed, &[runs]].concat()
}

/// The folder of such a run.
pub fn run_folder(runs: &Path, task: &str) -> PathBuf {
    runs.join(task).join("hksl-debug/seed-1")
}

/// Fails unless two finished runs are the same but for times: metrics, evaluations, the final weights and the whole
/// final state.
pub fn assert_same_run(a: &Path, b: &Path, step: u64) {
    let metrics = metrics_without_times(&a.join("metrics.jsonl"));
    let learnt = metrics.last().unwrap().keys().any(|name| name.starts_with("critic_loss"));
    assert!(metrics.len() > 4 && learnt, "{metrics:?}");
    assert_eq!(metrics, metrics_without_times(&b.join("metrics.jsonl")));
    let evaluations = |run: &Path| evaluations_without_times(&run.join("eval.csv"));
    assert_eq!(evaluations(a), evaluations(b));
    for file in ["weights.safetensors", "state/agent.safetensors", "state/frame-stack.safetensors"]
    {
        let path = format!("checkpoints/step-{step:09}/{file}");
        let bytes = |run: &Path| std::fs::read(run.join(&path)).unwrap();
        assert!(bytes(a) == bytes(b), "{file} differs");
    }
}
