//! What the documentation tells users of Python to do, and the programs in Python, where Python is there.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use hksl_tests::book::root;
use hksl_tests::{done, run_folder, train_arguments};
use serde_json::{Value, json};

/// A Python that can do this.
fn python(import: &str) -> Option<&'static str> {
    let found = ["python3", "python"].into_iter().find(|python| {
        let output = Command::new(python).args(["-c", import]).output();
        output.is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        println!("skipped: no Python for `{import}` here");
    }
    found
}

#[test]
fn every_program_is_python() {
    let Some(python) = python("import sys; assert sys.version_info >= (3, 9)") else { return };
    let folders = ["bench", "results/learning", "crates/hksl-baselines/tests/golden"];
    let files = folders.iter().flat_map(|folder| fs::read_dir(root().join(folder)).unwrap());
    let files: Vec<PathBuf> = files.map(|file| file.unwrap().path()).collect();
    let files: Vec<&PathBuf> =
        files.iter().filter(|path| path.extension().is_some_and(|end| end == "py")).collect();
    assert!(files.len() >= 4, "{files:?}");
    let parse = "import ast, sys\nfor path in sys.argv[1:]: ast.parse(open(path).read(), path)";
    let output = Command::new(python).args(["-c", parse]).args(files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// `compare.py --report` on these runs, into a folder that has a copy of docs/performance.md.
fn tabulate(python: &str, folder: &Path, runs: &str) -> Output {
    fs::write(folder.join("runs.jsonl"), runs).unwrap();
    fs::copy(root().join("docs/performance.md"), folder.join("performance.md")).unwrap();
    Command::new(python)
        .arg(root().join("bench/compare.py"))
        .args(["--report", "--out", ".", "--page", "performance.md"])
        .current_dir(folder)
        .output()
        .unwrap()
}

/// The recorded runs, each changed.
fn recorded(change: impl Fn(&mut Value)) -> String {
    let runs = fs::read_to_string(root().join("results/learning-step/runs.jsonl")).unwrap();
    let mut records: Vec<Value> =
        runs.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    records.iter_mut().for_each(change);
    records.iter().map(|record| format!("{record}\n")).collect()
}

#[test]
fn figures_beside_pytorch_are_those_of_the_recorded_runs() {
    let Some(python) = python("import sys; assert sys.version_info >= (3, 9)") else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = tabulate(python, folder.path(), &recorded(|_| ()));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let committed = ["README.md", "comparison.csv", "schedules.csv", "cost.svg"];
    let committed = committed.map(|name| (name, root().join("results/learning-step").join(name)));
    let page = ("performance.md", root().join("docs/performance.md"));
    for (name, path) in committed.into_iter().chain([page]) {
        let (found, expected) =
            (fs::read_to_string(folder.path().join(name)), fs::read_to_string(path));
        assert!(found.unwrap() == expected.unwrap(), "{name}: run bench/compare.py --report");
    }
}

#[test]
fn what_a_gpu_leaves_unmeasured_stays_empty() {
    let Some(python) = python("import sys; assert sys.version_info >= (3, 9)") else { return };
    let folder = tempfile::tempdir().unwrap();
    let runs = recorded(|record| {
        record["device"] = json!("cuda:0");
        if record["part"] != "machine" {
            record["kernels"] = json!("cuda");
            for key in ["peak_gflops", "encoder_forward_backward_s", "gflop_executed"] {
                record[key] = Value::Null;
            }
        }
    });
    let output = tabulate(python, folder.path(), &runs);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let readme = fs::read_to_string(folder.path().join("README.md")).unwrap();
    assert!(readme.contains("DEVICE=cuda:0") && readme.contains("CUDA graph"), "{readme}");
    assert!(readme.contains("instruction set cuda in hksl, cuda in PyTorch"), "{readme}");
    assert!(!readme.contains("None") && !readme.contains('%'), "{readme}");
}

#[test]
fn steps_that_compute_something_else_are_not_compared() {
    let Some(python) = python("import sys; assert sys.version_info >= (3, 9)") else { return };
    let folder = tempfile::tempdir().unwrap();
    let runs = recorded(|record| {
        if record["compared"] == "drq" && record["program"] == "hksl" {
            record["encoder_passes"] = json!(10);
        }
    });
    let output = tabulate(python, folder.path(), &runs);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(said.contains("drq: hksl has 10 encoder passes, PyTorch 11"), "{said}");
}

#[test]
fn the_snippet_of_the_documentation_reads_the_weights() {
    let Some(python) = python("import safetensors.numpy") else { return };
    let runs = tempfile::tempdir().unwrap();
    let short = ["falling-pixels", "--environment-steps", "40"];
    done(runs.path(), &train_arguments(runs.path(), &short));
    let run = run_folder(runs.path(), "falling-pixels");
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/run-folder.md");
    let page = fs::read_to_string(page).unwrap();
    let snippet = page.split("```python\n").nth(1).unwrap().split("```").next().unwrap();
    let place = "runs/cartpole-swingup/hksl/seed-1/checkpoints/step-000100000";
    let snippet = snippet.replace(place, run.join("checkpoints/step-000000040").to_str().unwrap());
    let output = Command::new(python).args(["-c", &snippet]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    for line in
        ["actor.trunk.0.weight (32, 24) float32", "levels.0.encoder.convs.0.weight (4, 3, 3, 3)"]
    {
        assert!(said.contains(line), "no `{line}` in {said}");
    }
}
