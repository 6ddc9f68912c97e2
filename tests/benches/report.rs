//! How long a report on the paper's whole comparison takes: 900 synthetic runs, 30 tasks × 6 methods × 5 seeds with 11
//! evaluations each, 50,000 replicates; every CSV, SVG, PNG and the page.
#![allow(clippy::unwrap_used)]

use std::process::Command;
use std::time::Instant;

use hksl_tests::synthetic::Synthetic;

fn main() {
    // Where `cargo test --benches` looks whether it runs, there is nothing to measure.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let tasks = [
        "cartpole-swingup",
        "finger-spin",
        "reacher-easy",
        "cheetah-run",
        "walker-walk",
        "ball_in_cup-catch",
    ];
    for task in tasks {
        for distractor in ["none", "color-easy", "color-medium", "camera-easy", "camera-medium"] {
            for method in ["hksl", "drq", "curl", "pi-sac", "dbc", "dreamer-v2"] {
                for seed in 1..=5 {
                    let run = Synthetic { task, distractor, method, seed, ..Synthetic::default() };
                    run.write(&folder.path().join("runs"));
                }
            }
        }
    }
    for attempt in 1..=3 {
        let out = format!("report-{attempt}");
        let start = Instant::now();
        let mut command = Command::new(hksl_tests::binary());
        command.args(["report", "runs", "--out", &out]).current_dir(folder.path());
        let output = command.output().unwrap();
        assert!(output.status.success(), "{output:?}");
        println!("report on 900 runs: {:.2} s", start.elapsed().as_secs_f64());
    }
}
