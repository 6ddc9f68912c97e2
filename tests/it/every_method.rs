//! What every method has: the same bits again, resuming, evaluation, analyses, measurement.

#[cfg(feature = "mujoco")]
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

#[cfg(feature = "mujoco")]
use hksl_tests::PLAIN_RENDERING;
use hksl_tests::{
    assert_same_run, binary, done, evaluations_without_times, hksl, rows_of, train_arguments,
};
use hksl_train::config::{default_method, methods};
use serde_json::Value;

/// All methods but hksl, which the other tests are about.
fn baselines() -> impl Iterator<Item = &'static str> {
    methods().into_iter().filter(|method| *method != default_method())
}

fn arguments<'a>(runs: &'a Path, method: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    train_arguments(runs, &[&["falling-pixels", "--method", method], more].concat())
}

fn run(runs: &Path, method: &str, more: &[&str]) -> PathBuf {
    done(runs, &arguments(runs, method, more));
    folder(runs, method)
}

fn folder(runs: &Path, method: &str) -> PathBuf {
    runs.join(format!("falling-pixels/{method}-debug/seed-1"))
}

#[test]
fn the_same_seed_gives_the_same_bits_also_after_a_cut() {
    for method in baselines() {
        let folders = [(); 3].map(|()| tempfile::tempdir().unwrap());
        let [a, b, cut] = folders.each_ref().map(tempfile::TempDir::path);
        let (a, b) = (run(a, method, &[]), run(b, method, &[]));
        assert_same_run(&a, &b, 480);
        run(cut, method, &["--environment-steps", "240"]);
        assert_same_run(&a, &run(cut, method, &[]), 480);
    }
}

/// Those that learn before they act on, and the one that remembers; cut anywhere.
#[test]
fn killed_again_and_again_they_end_with_the_same_bits() {
    for method in ["pi-sac", "dreamer-v2"] {
        let (straight, killed) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let pretraining = match method {
            "pi-sac" => "pi_sac.pretraining_steps=40",
            _ => "dreamer.pretraining_steps=20",
        };
        let sets: &[&str] = &["--set", pretraining, "--environment-steps", "2400"];
        let straight = run(straight.path(), method, sets);
        let often = [sets, &["--set", "checkpoint.minutes=0.000001"]].concat();
        for kill in 0..10u64 {
            let mut child = Command::new(binary())
                .args(arguments(killed.path(), method, &often))
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            sleep(Duration::from_millis(kill * 619 % 1000 * 600 / 1000));
            child.kill().unwrap();
            child.wait().unwrap();
        }
        assert_same_run(&straight, &run(killed.path(), method, sets), 2400);
    }
}

/// An agent that draws in evaluation, too, gives the row of its run again.
#[test]
fn evaluation_repeats_the_runs_own() {
    let runs = tempfile::tempdir().unwrap();
    for method in ["drq", "pi-sac", "dreamer-v2"] {
        let run = run(runs.path(), method, &["--environment-steps", "240"]);
        let rows = evaluations_without_times(&run.join("eval.csv"));
        let mean: f64 = rows[2].split(',').nth(7).unwrap().parse().unwrap();
        let text = done(runs.path(), &["eval", run.to_str().unwrap(), "--checkpoint", "240"]);
        assert!(text.contains(&format!("return {mean:.2} ± ")), "{method}: {text} but {mean}");
    }
}

#[test]
fn analyses_look_into_every_method() {
    let runs = tempfile::tempdir().unwrap();
    for method in baselines() {
        let run = run(runs.path(), method, &["--environment-steps", "240"]);
        let of = |command: &'static str, out: &str, more: &[&str]| {
            let fixed = ["--device", "cpu", "--threads", "2", "--cache", "cache", "--out", out];
            let arguments = [&[command, run.to_str().unwrap()], more, &fixed[..]].concat();
            hksl(runs.path(), &arguments)
        };
        let few = ["--train-episodes", "3", "--test-episodes", "2", "--checkpoints", "0,240"];
        let out = format!("probe-{method}");
        let ended = of("probe", &out, &few);
        assert_eq!(ended.code, 0, "{method}: {}", ended.err);
        // Two checkpoints, three horizons; two encoders side by side for none of these methods.
        let table = rows_of(&runs.path().join(&out).join("probe.csv"));
        assert_eq!(table.len(), 2 * 3, "{method}");
        for row in &table {
            assert_eq!(row["encoder"], "encoder", "{method}: {row:?}");
            assert!(row["mse"].parse::<f64>().unwrap() > 0.0, "{method}: {row:?}");
        }
        let out = format!("attention-{method}");
        let ended = of("attention", &out, &[]);
        assert_eq!(ended.code, 0, "{method}: {}", ended.err);
        assert!(runs.path().join(&out).join("episode.gif").is_file(), "{method}");
        let maps = rows_of(&runs.path().join(&out).join("maps.csv"));
        assert!(maps.len() > 120 && maps[0]["column_0"].parse::<f64>().is_ok(), "{method}");
        let ended = of("analyze-comm", "never", &[]);
        assert_eq!(ended.code, 1, "{method}");
        let words = [method, "no communication managers"];
        assert!(words.iter().all(|word| ended.err.contains(word)), "{method}: {}", ended.err);
    }
}

#[test]
fn steps_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    for method in baselines() {
        let arguments =
            ["bench", "step", "falling-pixels", "--method", method, "--preset", "debug"];
        let options = ["--json", "--runs", "2", "--batch", "4", "--threads", "1"];
        let printed = done(folder.path(), &[&arguments[..], &options].concat());
        let report: Value = serde_json::from_str(&printed).unwrap();
        assert_eq!(report["method"], method);
        assert_eq!((&report["runs"], &report["batch"]), (&2.into(), &4.into()), "{report}");
        assert!(
            report["gflop"].as_f64().unwrap() > 0.0 && report["median_s"].as_f64().unwrap() > 0.0
        );
    }
}

/// Weights of one method in the run of another: named, nothing read as what it is not.
#[test]
fn a_checkpoint_of_another_method_is_refused() {
    let runs = tempfile::tempdir().unwrap();
    let [drq, curl] =
        ["drq", "curl"].map(|method| run(runs.path(), method, &["--environment-steps", "240"]));
    for part in ["checkpoints", "replay"] {
        fs::remove_dir_all(curl.join(part)).unwrap();
        fs::rename(drq.join(part), curl.join(part)).unwrap();
    }
    for command in ["eval", "attention"] {
        let ended = hksl(runs.path(), &[command, curl.to_str().unwrap(), "--checkpoint", "240"]);
        assert_eq!(ended.code, 1, "{}", ended.out);
        for word in ["240", "curl", "bilinear", "config.toml"] {
            assert!(ended.err.contains(word), "no `{word}` in {}", ended.err);
        }
    }
    let ended = hksl(runs.path(), &arguments(runs.path(), "curl", &[]));
    assert_eq!(ended.code, 1, "{}", ended.out);
    for word in ["240", "curl", "bilinear", "config.toml"] {
        assert!(ended.err.contains(word), "no `{word}` in {}", ended.err);
    }
    // Nothing was set aside or overwritten.
    assert!(curl.join("checkpoints/step-000000240/checkpoint.json").is_file());
}

/// Thirty control tasks and Falling Pixels: each method learns for a few steps on each task, and is evaluated. The
/// distractors rotate, so that each meets every task and every method.
#[test]
#[cfg(feature = "mujoco")]
fn every_method_trains_on_every_environment() {
    let runs = tempfile::tempdir().unwrap();
    let distractors = ["none", "color-easy", "color-medium", "camera-easy", "camera-medium"];
    let mut met = BTreeSet::new();
    for (index, info) in hksl_envs::tasks().iter().enumerate() {
        for (number, method) in baselines().enumerate() {
            let place = if info.needs_mujoco { (index + number) % distractors.len() } else { 0 };
            let distractor = distractors[place];
            let short = ["--environment-steps", "240", "--distractor", distractor];
            let single = ["--set", "evaluation.episodes=1"];
            let plain = if info.needs_mujoco { &PLAIN_RENDERING[..] } else { &[] };
            let named = [info.name, "--method", method];
            let arguments = [&named[..], &short, &single, plain].concat();
            done(runs.path(), &train_arguments(runs.path(), &arguments));
            let label = match distractor {
                "none" => info.name.to_owned(),
                distractor => format!("{}-{distractor}", info.name),
            };
            let run = runs.path().join(&label).join(format!("{method}-debug/seed-1"));
            let rows = evaluations_without_times(&run.join("eval.csv"));
            assert_eq!(rows.len(), 3, "{}: {rows:?}", run.display());
            let metrics = fs::read_to_string(run.join("metrics.jsonl")).unwrap();
            assert!(metrics.contains("critic_loss") || metrics.contains("world_loss"), "{metrics}");
            met.insert(label);
        }
    }
    assert_eq!(met.len(), 31, "{met:?}");
}
