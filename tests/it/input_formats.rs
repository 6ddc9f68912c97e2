//! What people type and bring: numbers in every spelling, files of any editor, names of any kind, limits of any shell.

use std::fs::{self, File};
use std::path::Path;
use std::process::Command;

use hksl_tests::{Ended, PLAIN_RENDERING, binary, done, hksl};

#[test]
fn numbers_are_taken_as_people_type_them() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, line) in [
        (&["--set", "sac.learning_rate=.001"][..], "learning_rate = 0.001"),
        (&["--set", "sac.learning_rate=+1E-3"], "learning_rate = 0.001"),
        (&["--set", "sac.discount=1."], "discount = 1.0"),
        (&["--set", "environment_steps=1e5"], "environment_steps = 100000"),
        (&["--set", "environment_steps=100_000.0"], "environment_steps = 100000"),
        (&["--set", "render.device=1", "cartpole-swingup"], "device = \"1\""),
        (&["--environment-steps", "1e5"], "environment_steps = 100000"),
        (&["--environment-steps", "100_000"], "environment_steps = 100000"),
        (&["--seed", "3.0"], "seed = 3"),
        (&["--threads", "1.0"], "threads = 1"),
    ] {
        let shown = done(folder.path(), &[&["config", "show"], arguments].concat());
        assert!(shown.lines().any(|shown| shown == line), "{arguments:?}: {shown}");
    }
    // Commands with numbers of their own.
    done(folder.path(), &["rollout", "--steps", "1e1", "--out", "a.json"]);
    done(folder.path(), &["bench", "render", "--runs", "2.0", "--json"]);
    let ended =
        hksl(folder.path(), &["eval", "nowhere", "--checkpoint", "5e4", "--episodes", "1e2"]);
    assert_eq!(ended.code, 1, "{}", ended.err);
    let numbers = ["--at", "1e5", "--every", "10_000", "--replicates", "1e3", "--seed", "1.0"];
    let ended = hksl(folder.path(), &[&["report", "nowhere"], &numbers[..]].concat());
    assert!(ended.code != 2, "{}", ended.err);
}

#[test]
fn a_number_that_is_not_taken_is_said_how_to_write() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, words) in [
        (
            &["train", "--set", "sac.learning_rate=0,001"][..],
            &["sac.learning_rate", "write 0.001"][..],
        ),
        (&["train", "--set", "environment_steps=100,000"], &["environment_steps", "write 100000"]),
        (&["train", "--environment-steps", "100k"], &["--environment-steps", "write 100000"]),
        (&["train", "--environment-steps", "1.5"], &["--environment-steps", "a whole number"]),
        (&["train", "--seed", "one"], &["--seed", "a whole number"]),
        (&["eval", "x", "--episodes", "0"], &["--episodes", "a whole number of at least 1"]),
        (&["eval", "x", "--episodes", "1,000"], &["--episodes", "write 1000"]),
        (&["probe", "x", "--penalty", "0,1"], &["--penalty", "write 0.1"]),
        (&["probe", "x", "--train-episodes", "20000"], &["--train-episodes", "from 1 to 10000"]),
        (&["sweep", "x", "--jobs", "0"], &["--jobs", "a whole number of at least 1"]),
    ] {
        let ended = hksl(folder.path(), arguments);
        assert_eq!(ended.code, 2, "{arguments:?}: {}", ended.err);
        for word in words {
            assert!(ended.err.contains(word), "no `{word}` in {}", ended.err);
        }
    }
}

/// With a byte order mark and CRLF.
#[test]
fn files_of_any_editor_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let text = format!("\u{feff}{}", text.replace('\n', "\r\n"));
        fs::write(folder.path().join(name), text).unwrap();
    };
    write("my.toml", "environment_steps = 5e2\n[sac]\nlearning_rate = 1\nbatch_size = 32.0\n");
    let shown = done(folder.path(), &["config", "show", "--config", "my.toml"]);
    assert!(
        shown.contains("batch_size = 32\n") && shown.contains("environment_steps = 500"),
        "{shown}"
    );
    let start = "{\"task\": \"cartpole-swingup\",\n\"qpos\": [0, 0], \"qvel\": [0, 0], \"actions\": [[0.5]]}\n";
    write("start.json", start);
    done(folder.path(), &["rollout", "--from", "start.json"]);
    // A run's own configuration, looked at with such an editor.
    done(folder.path(), &["train", "--preset", "debug", "--environment-steps", "80"]);
    let run = "runs/falling-pixels/hksl-debug/seed-1";
    let config = fs::read_to_string(folder.path().join(run).join("config.toml")).unwrap();
    write(&format!("{run}/config.toml"), &config);
    done(folder.path(), &["eval", run, "--episodes", "1"]);
}

/// Seconds that an animation takes, and its frames.
fn length(path: &Path) -> (f64, usize) {
    let mut decoder = gif::DecodeOptions::new().read_info(File::open(path).unwrap()).unwrap();
    let (mut hundredths, mut frames) = (0, 0);
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        hundredths += u64::from(frame.delay);
        frames += 1;
    }
    (hundredths as f64 / 100.0, frames)
}

fn plain(task: &str) -> &'static [&'static str] {
    if task == "falling-pixels" { &[] } else { &PLAIN_RENDERING }
}

#[test]
fn animations_take_as_long_as_what_they_show() {
    let folder = tempfile::tempdir().unwrap();
    for (task, steps, seconds) in [
        ("cartpole-swingup", 400, 4.0),
        ("walker-walk", 40, 1.0),
        ("cheetah-run", 100, 1.0),
        ("falling-pixels", 25, 1.0),
    ] {
        let (steps, gif) = (steps.to_string(), format!("{task}.gif"));
        let play = ["rollout", task, "--policy", "zero", "--steps", &steps, "--gif", &gif];
        done(folder.path(), &[&play[..], plain(task)].concat());
        let (took, frames) = length(&folder.path().join(&gif));
        // One frame more than steps: the first.
        let frame = took / frames as f64;
        assert!((took - frame - seconds).abs() < 0.02, "{task}: {took} s in {frames} frames");
    }
    // Every control step of 10 ms: browsers show no frame for less than 20.
    let every = ["rollout", "cartpole-swingup", "--policy", "zero", "--steps", "100"];
    let more = ["--set", "environment.action_repeat=1", "--gif", "every.gif"];
    done(folder.path(), &[&every[..], &more, &PLAIN_RENDERING].concat());
    let (took, frames) = length(&folder.path().join("every.gif"));
    assert!(frames == 51 && (took - 1.02).abs() < 0.011, "{took} s in {frames} frames");
    // Those of a run, of `eval` and of `attention`.
    let train = ["train", "cartpole-swingup", "--preset", "debug", "--environment-steps", "80"];
    let video = ["--set", "evaluation.video=true"];
    done(folder.path(), &[&train[..], &video, &PLAIN_RENDERING].concat());
    let run = "runs/cartpole-swingup/hksl-debug/seed-1";
    done(folder.path(), &["eval", run, "--episodes", "1", "--video", "eval.GIF"]);
    done(folder.path(), &["attention", run, "--out", "seen", "--cache", "cache"]);
    for gif in [&format!("{run}/videos/step-000000080.gif"), "eval.GIF", "seen/episode.gif"] {
        let (took, frames) = length(&folder.path().join(gif));
        assert!((took - 0.08 * frames as f64).abs() < 0.001, "{gif}: {took} s in {frames} frames");
    }
}

#[test]
fn other_formats_of_video_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [
        &["eval", "nowhere", "--video", "v.mp4"][..],
        &["rollout", "--policy", "zero", "--gif", "v.mp4"],
        &["rollout", "--policy", "zero", "--gif", "video"],
    ] {
        let ended = hksl(folder.path(), arguments);
        assert_eq!(ended.code, 2, "{}", ended.err);
        assert!(ended.err.contains("GIF") && ended.err.contains(".gif"), "{}", ended.err);
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn proposed_commands_can_be_pasted() {
    let folder = tempfile::tempdir().unwrap();
    let train = ["train", "--preset", "debug", "--environment-steps", "80", "--runs", "my runs"];
    let said = done(folder.path(), &train);
    let proposed = said.lines().find(|line| line.contains("--episodes 100")).unwrap().trim();
    let short = proposed.replace("--episodes 100", "--episodes 1");
    let command = short.replacen("hksl", &binary().display().to_string(), 1);
    let pasted = Command::new("sh").args(["-c", &command]).current_dir(folder.path()).output();
    let pasted: Ended = pasted.unwrap().into();
    assert_eq!(pasted.code, 0, "{command}: {}", pasted.err);
}

/// What a shell limits, a run that does not fit says at the start.
#[cfg(target_os = "linux")]
#[test]
fn a_run_beyond_the_limits_of_the_shell_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (limit, name) in [("-v 400000", "ulimit -v"), ("-d 300000", "ulimit -d")] {
        let command = format!(
            "ulimit {limit}; exec {} train falling-pixels --threads 1 --environment-steps 3000 --runs '{name}'",
            binary().display()
        );
        let ended = Command::new("bash").args(["-c", &command]).current_dir(folder.path()).output();
        let ended: Ended = ended.unwrap().into();
        assert_eq!(ended.code, 1, "{}{}", ended.out, ended.err);
        for words in ["the run needs about", name, "raise the "] {
            assert!(ended.err.contains(words), "no `{words}` in {}", ended.err);
        }
        let run = folder.path().join(name).join("falling-pixels/hksl/seed-1");
        assert!(run.join("failed").is_file() && !run.join("config.toml").exists());
    }
}

#[test]
fn a_deprecation_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let train = ["train", "cheetah-run", "--preset", "debug", "--environment-steps", "80"];
    let ended = hksl(folder.path(), &train);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert_eq!(ended.err.matches("deprecated").count(), 1, "{}", ended.err);
}
