//! Every command of the binary, on the debug preset.

use std::fs;

use hksl_tests::{done, hksl};

#[test]
fn train_leaves_what_the_documentation_says() {
    let folder = tempfile::tempdir().unwrap();
    for (task, ablation) in [("falling-pixels", "no-c"), ("cartpole-swingup", "shared-encoder")] {
        let text = done(
            folder.path(),
            &["train", task, "--ablation", ablation, "--preset", "debug", "--device", "cpu"],
        );
        let words =
            ["environment steps =", "agent steps", "replay", "cpu", "mean return is", "hksl eval"];
        for word in words {
            assert!(text.contains(word), "no `{word}` in: {text}");
        }
        // One line an evaluation where there is no terminal: at 0, 240 and 480.
        let evaluations = text.lines().filter(|line| line.starts_with("environment step ")).count();
        assert_eq!(evaluations, 3, "{text}");
        let run = folder.path().join(format!("runs/{task}/hksl-{ablation}-debug/seed-1"));
        for file in
            ["config.toml", "command.txt", "environment.json", "metrics.jsonl", "eval.csv", "done"]
        {
            assert!(run.join(file).is_file(), "no {file}");
        }
        let command = fs::read_to_string(run.join("command.txt")).unwrap();
        assert!(
            command.starts_with(&format!("hksl train {task} --ablation {ablation}")),
            "{command}"
        );
        let config = fs::read_to_string(run.join("config.toml")).unwrap();
        assert!(config.contains(&format!("ablation = \"{ablation}\"")), "{config}");
        for step in [0, 240, 480] {
            let weights = run.join(format!("checkpoints/step-{step:09}/weights.safetensors"));
            assert!(weights.is_file(), "no {}", weights.display());
        }
        let states = fs::read_dir(run.join("checkpoints")).unwrap();
        let states = states.filter(|entry| entry.as_ref().unwrap().path().join("state").is_dir());
        assert_eq!(states.count(), 2, "full states of the last two saves");
    }
}

#[test]
fn a_dry_run_shows_the_first_screen_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let text = done(folder.path(), &["train", "--dry-run"]);
    for words in ["200,000 environment steps", "3×43×23", "up to 100,000 transitions"] {
        assert!(text.contains(words), "no `{words}` in: {text}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn config_show_prints_a_file_that_config_reads() {
    let folder = tempfile::tempdir().unwrap();
    let shown = done(folder.path(), &["config", "show", "cartpole-swingup", "--set", "seed=3"]);
    fs::write(folder.path().join("my.toml"), &shown).unwrap();
    let again = done(folder.path(), &["config", "show", "--config", "my.toml"]);
    assert_eq!(shown, again);
    let origins = done(folder.path(), &["config", "show", "cartpole-swingup", "--origin"]);
    let repeat = origins.lines().find(|line| line.starts_with("action_repeat")).unwrap();
    assert!(repeat.contains('8') && repeat.contains("tasks/cartpole-swingup.toml"), "{repeat}");
}

#[test]
fn the_other_commands_say_what_they_should() {
    let folder = tempfile::tempdir().unwrap();
    let tasks = done(folder.path(), &["tasks"]);
    assert!(tasks.contains("falling-pixels") && tasks.contains("cartpole-swingup"), "{tasks}");
    let doctor = done(folder.path(), &["doctor"]);
    for word in [
        "commit",
        "kernels: ",
        "a run of finger-spin needs about",
        "GPUs",
        "3.17.0, library path: /",
        "libmujoco.so",
        "SHA-256 of dm_control 1.0.50",
        "EGL: ",
        "identical when rendered twice",
        "frame hash",
        "runs can be created",
        "write speed",
        "creating a file takes",
        "file locks",
        "disk space",
    ] {
        assert!(doctor.contains(word), "no `{word}` in: {doctor}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "doctor left something behind");
    for shell in ["bash", "zsh", "fish"] {
        assert!(done(folder.path(), &["completions", shell]).contains("rollout"));
    }
    assert!(done(folder.path(), &["train", "--help"]).contains("--ablation"));
}

#[test]
fn a_distracted_run_says_so_and_is_evaluated_under_another_distractor() {
    let folder = tempfile::tempdir().unwrap();
    let options = ["--preset", "debug", "--device", "cpu", "--environment-steps", "240"];
    let train = ["train", "finger-spin", "--distractor", "color-easy"];
    done(folder.path(), &[&train[..], &options[..]].concat());
    let run = "runs/finger-spin-color-easy/hksl-debug/seed-1";
    let rows = fs::read_to_string(folder.path().join(run).join("eval.csv")).unwrap();
    assert!(rows.contains("hksl,finger-spin,color-easy,1,"), "{rows}");
    let eval = ["eval", run, "--episodes", "1"];
    assert!(done(folder.path(), &eval).contains("finger-spin-color-easy"));
    let other = done(folder.path(), &[&eval[..], &["--distractor", "camera-hard"]].concat());
    assert!(other.contains("finger-spin-camera-hard"), "{other}");

    // The same run's policy, played for people and for programs.
    let play = ["rollout", "--policy", run, "--steps", "16", "--out", "steps.json"];
    done(folder.path(), &[&play[..], &["--frames", "seen", "--gif", "seen.gif"]].concat());
    let steps = fs::read_to_string(folder.path().join("steps.json")).unwrap();
    let steps: serde_json::Value = serde_json::from_str(&steps).unwrap();
    for (key, numbers) in [("qpos", 3), ("qvel", 3), ("action", 2)] {
        let rows = steps[key].as_array().unwrap();
        assert_eq!((rows.len(), rows[0].as_array().unwrap().len()), (16, numbers), "{key}");
    }
    assert_eq!(steps["probe"][0]["fingertip"].as_array().unwrap().len(), 3);
    // At the reset, and every eight control steps.
    assert_eq!(fs::read_dir(folder.path().join("seen")).unwrap().count(), 3);
    assert!(folder.path().join("seen.gif").is_file());

    // Nothing of it is overwritten.
    let video = ["eval", run, "--episodes", "1", "--video", "seen.gif"];
    for (again, file) in [(&play[..], "steps.json"), (&video, "seen.gif")] {
        let ended = hksl(folder.path(), again);
        assert_eq!(ended.code, 1, "{}", ended.out);
        assert!(ended.err.contains(&format!("{file} already exists")), "{}", ended.err);
    }
}
