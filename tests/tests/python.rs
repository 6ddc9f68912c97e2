//! What the documentation tells users of Python to do, where Python and safetensors are there.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::Command;

use hksl_tests::{done, run_folder, train_arguments};

#[test]
fn the_snippet_of_the_documentation_reads_the_weights() {
    let python = ["python3", "python"].into_iter().find(|python| {
        let import = Command::new(python).args(["-c", "import safetensors.numpy"]).output();
        import.is_ok_and(|output| output.status.success())
    });
    let Some(python) = python else {
        println!("skipped: no Python with safetensors and numpy here");
        return;
    };
    let runs = tempfile::tempdir().unwrap();
    let short = ["falling-pixels", "--environment-steps", "40"];
    done(runs.path(), &train_arguments(runs.path(), &short));
    let run = run_folder(runs.path(), "falling-pixels");
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/run-folder.md");
    let page = std::fs::read_to_string(page).unwrap();
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
