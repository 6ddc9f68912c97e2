//! Everything a user can get wrong: one clear message, the right exit code, nothing overwritten.

use std::fs;
use std::path::Path;
use std::process::Command;

use hksl_tests::{Ended, binary, done, hksl};

/// Fails unless the command exits with `code` and its error has all these words, and no panic.
fn refused(ended: &Ended, code: i32, words: &[&str]) {
    let Ended { code: got, err, .. } = ended;
    assert_eq!(*got, code, "{err}");
    assert!(!err.contains("panicked"), "{err}");
    for word in words {
        assert!(err.contains(word), "no `{word}` in: {err}");
    }
}

#[test]
fn wrong_arguments_and_keys_exit_with_2() {
    let folder = tempfile::tempdir().unwrap();
    let cases: &[(&[&str], &[&str])] = &[
        (&["train", "cartpole-swing"], &["cartpole-swing", "cartpole-swingup"]),
        (&["train", "--preset", "debgu"], &["debgu", "debug"]),
        (&["train", "--method", "hskl"], &["hskl", "hksl"]),
        (&["train", "--ablation", "no-d"], &["no-d", "no-c"]),
        (&["train", "cartpole-swingup", "--ablation", "h3"], &["h3", "--set hksl.skips="]),
        (&["train", "--device", "gpu"], &["gpu", "cuda"]),
        (&["train", "--set", "hksl.skip=[1]"], &["hksl.skip", "hksl.skips"]),
        (&["train", "--set", "sac.batch_size=big"], &["sac.batch_size", "big", "integer"]),
        (&["train", "--set", "sac.discount=1.5"], &["sac.discount", "1.5", "from 0 to 1"]),
        (&["train", "--set", "hksl.skips=[1, 7]"], &["hksl.skips", "[1, 7]", "6"]),
        (&["train", "--set", "environment.width=6"], &["environment.width = 6", "43×14", "15×15"]),
        (&["train", "--set", "render.samples=0"], &["render.samples", "falling-pixels"]),
        (
            &["train", "cartpole-swingup", "--set", "distractors.color.max_delta=0.3"],
            &["distractors.color.max_delta", "0.3", "none"],
        ),
        (&["train", "--threads", "5000"], &["threads", "5000", "4096"]),
        (&["train", "--set", "seed"], &["seed", "KEY=VALUE"]),
        (&["train", "--name", "a/b"], &["a/b", "letters"]),
        (&["train", "--environment-steps", "0"], &["environment_steps", "0"]),
        (&["train", "--config", "nowhere.toml"], &["nowhere.toml"]),
        (&["train", "--resume", "maybe"], &["maybe", "auto", "never"]),
        (&["rollout", "--from", "x.json", "--seed", "2"], &["--seed", "no effect", "--from"]),
        (&["rollout", "--from", "x.json", "--threads", "1"], &["--threads", "no effect"]),
        (&["rollout", "--from", "x.json", "--policy", "zero"], &["--policy", "--from"]),
        (&["rollout", "--policy", "zero", "--method", "drq"], &["--method", "no effect"]),
        (&["bench", "render", "--threads", "2"], &["--threads", "no effect"]),
        (&["eval", "nowhere", "--threads", "5000"], &["threads", "5000", "4096"]),
        (&["eval"], &["RUN"]),
        (&["frobnicate"], &["frobnicate"]),
    ];
    for (arguments, words) in cases {
        refused(&hksl(folder.path(), arguments), 2, words);
    }
    assert!(!folder.path().join("runs").exists(), "a refused command left something behind");
}

#[test]
fn a_users_file_is_checked_like_any_other_source() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("my.toml"), "[sac]\nbatch_sise = 3\n").unwrap();
    let ended = hksl(folder.path(), &["train", "--config", "my.toml"]);
    refused(&ended, 2, &["sac.batch_sise", "my.toml", "sac.batch_size"]);
    fs::write(folder.path().join("my.toml"), "[sac\n").unwrap();
    refused(&hksl(folder.path(), &["train", "--config", "my.toml"]), 2, &["my.toml", "line 1"]);
}

fn tiny(folder: &Path, more: &[&str]) -> Ended {
    let mut arguments = vec!["train", "--preset", "debug", "--environment-steps", "80"];
    arguments.extend(more);
    hksl(folder, &arguments)
}

#[test]
fn a_folder_of_another_run_is_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(tiny(folder.path(), &[]).code, 0);
    let run = folder.path().join("runs/falling-pixels/hksl-debug/seed-1");
    let files = || -> Vec<(std::path::PathBuf, Vec<u8>)> {
        let mut found = Vec::new();
        let mut open = vec![run.clone()];
        while let Some(path) = open.pop() {
            if path.is_dir() {
                open.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
            } else {
                found.push((path.clone(), fs::read(&path).unwrap()));
            }
        }
        found.sort();
        found
    };
    let before = files();
    let other = tiny(folder.path(), &["--set", "sac.discount=0.5"]);
    refused(&other, 2, &["sac.discount", "0.99", "0.5", "--name"]);
    refused(&tiny(folder.path(), &["--resume", "never"]), 2, &["already exists", "--resume never"]);
    let shorter = hksl(folder.path(), &["train", "--preset", "debug", "--environment-steps", "40"]);
    refused(&shorter, 2, &["80", "40"]);
    assert_eq!(files(), before);
    // The same command once more says that it is done.
    let again = tiny(folder.path(), &[]);
    assert_eq!(again.code, 0, "{}", again.err);
    assert!(again.out.contains("already done"), "{}", again.out);
    assert_eq!(files(), before);
}

#[test]
fn wrong_runs_and_checkpoints_exit_with_1() {
    let folder = tempfile::tempdir().unwrap();
    refused(&hksl(folder.path(), &["eval", "nowhere"]), 1, &["nowhere", "config.toml"]);
    assert_eq!(tiny(folder.path(), &[]).code, 0);
    let run = "runs/falling-pixels/hksl-debug/seed-1";
    let ended = hksl(folder.path(), &["eval", run, "--checkpoint", "7"]);
    refused(&ended, 1, &["7", "available: 0, 80"]);
    let weights = folder.path().join(run).join("checkpoints/step-000000080/weights.safetensors");
    fs::write(&weights, "not safetensors").unwrap();
    refused(&hksl(folder.path(), &["eval", run]), 1, &["safetensors"]);
}

#[test]
fn a_malformed_start_state_exits_with_1() {
    let folder = tempfile::tempdir().unwrap();
    let start = |text: &str| {
        fs::write(folder.path().join("in.json"), text).unwrap();
        hksl(folder.path(), &["rollout", "--from", "in.json", "--out", "out.json"])
    };
    let (task, state) = ("\"task\": \"cartpole-swingup\"", "\"qpos\": [0, 0], \"qvel\": [0, 0]");
    let ended = start(&format!("{{{task}, \"qpos\": [0], \"qvel\": [0, 0], \"actions\": [[0]]}}"));
    refused(&ended, 1, &["qpos", "in.json"]);
    refused(&start(&format!("{{{task}, {state}, \"actions\": [[0, 0]]}}")), 1, &["actions"]);
    refused(&start(&format!("{{{task}, {state}, \"action\": [[0]]}}")), 1, &["action"]);
    refused(&start("{"), 1, &["in.json"]);
    refused(&hksl(folder.path(), &["rollout", "--from", "no.json"]), 1, &["no.json"]);
    assert!(!folder.path().join("out.json").exists());
    let good = start(&format!("{{{task}, {state}, \"actions\": [[0.5], [-0.5]]}}"));
    assert_eq!(good.code, 0, "{}", good.err);
    let steps = fs::read_to_string(folder.path().join("out.json")).unwrap();
    let steps: serde_json::Value = serde_json::from_str(&steps).unwrap();
    assert_eq!(steps["reward"].as_array().unwrap().len(), 2);
}

#[test]
fn missing_models_exit_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(binary())
        .args(["train", "cartpole-swingup", "--preset", "debug"])
        .env("HKSL_MODELS", "no-such-folder")
        .current_dir(folder.path())
        .output();
    refused(&output.unwrap().into(), 3, &["cartpole.xml", "no-such-folder", "make setup"]);
    let output = Command::new(binary())
        .args(["train", "cartpole-swingup", "--preset", "debug"])
        .env("__EGL_VENDOR_LIBRARY_FILENAMES", "no-such-vendor.json")
        .current_dir(folder.path())
        .output();
    refused(&output.unwrap().into(), 3, &["EGL", "libegl1"]);
}

#[test]
fn nothing_but_errors_is_printed_when_quiet() {
    let folder = tempfile::tempdir().unwrap();
    let text = done(
        folder.path(),
        &["train", "--preset", "debug", "--environment-steps", "80", "--quiet"],
    );
    assert_eq!(text, "");
}

#[test]
fn distractors_and_devices_that_are_not_there_exit_as_documented() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| hksl(folder.path(), arguments);
    refused(&run(&["train", "walker-walk", "--distractor", "color-esy"]), 2, &["color-easy"]);
    let falling = ["train", "falling-pixels", "--distractor", "color-easy"];
    refused(&run(&falling), 2, &["falling-pixels", "color-easy"]);
    let drawn = ["rollout", "reacher-easy", "--steps", "4", "--frames", "seen"];
    refused(&run(&[&drawn[..], &["--render-device", "77"]].concat()), 3, &["77"]);
    refused(&run(&[&drawn[..], &["--render-device", "x"]].concat()), 2, &["render.device"]);
    refused(&run(&["rollout", "reacher-easy", "--policy", "none-such"]), 1, &["none-such"]);
}
