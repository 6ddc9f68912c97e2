//! Runs that are killed, told to stop, or go wrong, and what is left of them.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use hksl_tests::{
    Ended, PLAIN_RENDERING, assert_same_run, binary, done, hksl, run_folder, train_arguments,
};

/// Saved after every agent step, so that most moments fall into a save.
const OFTEN: [&str; 2] = ["--set", "checkpoint.minutes=0.000001"];
const KILLS: u32 = 16;

fn start(runs: &Path, arguments: &[&str]) -> Child {
    Command::new(binary())
        .args(train_arguments(runs, arguments))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn send(child: &Child, signal: &str) {
    let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

fn end(child: Child) -> Ended {
    child.wait_with_output().unwrap().into()
}

/// Waits until a file of a run holds this text.
fn wait_for(path: &Path, text: &str) {
    let began = Instant::now();
    while !std::fs::read_to_string(path).is_ok_and(|found| found.contains(text)) {
        assert!(began.elapsed() < Duration::from_secs(120), "{} lacks {text}", path.display());
        sleep(Duration::from_millis(10));
    }
}

#[test]
fn runs_that_are_killed_again_and_again_end_with_the_same_bits() {
    // Cut anywhere within so many milliseconds, evenly spread: starting, loading, learning, saving.
    for (task, within) in [("falling-pixels", 600), ("cartpole-swingup", 1200)] {
        let (straight, killed) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let plain = if task == "falling-pixels" { &[] } else { &PLAIN_RENDERING[..] };
        let budget = [&[task, "--environment-steps", "4800"], plain].concat();
        done(straight.path(), &train_arguments(straight.path(), &budget));
        let arguments = [&budget[..], &OFTEN].concat();
        for kill in 0..KILLS {
            let mut child = start(killed.path(), &arguments);
            sleep(Duration::from_millis(u64::from(kill * 619 % 1000 * within / 1000)));
            child.kill().unwrap();
            assert!(!child.wait().unwrap().success(), "{task} was done after {kill} cuts");
        }
        done(killed.path(), &train_arguments(killed.path(), &budget));
        let [a, b] = [&straight, &killed].map(|runs| run_folder(runs.path(), task));
        assert_same_run(&a, &b, 4800);
        let left = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name();
        let names: Vec<_> = std::fs::read_dir(b.join("checkpoints")).unwrap().map(left).collect();
        assert!(names.iter().all(|name| name.to_string_lossy().starts_with("step-")), "{names:?}");
    }
}

#[test]
fn signals_save_and_the_same_command_goes_on() {
    let (straight, stopped) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let task = "falling-pixels";
    let more = [task, "--environment-steps", "9600"];
    done(straight.path(), &train_arguments(straight.path(), &more));
    let run = run_folder(stopped.path(), task);
    for signal in ["-TERM", "-INT", "-USR1"] {
        let mut child = start(stopped.path(), &more);
        // The first screen comes once signals are heard.
        let mut out = BufReader::new(child.stdout.take().unwrap()).lines();
        out.find(|line| line.as_ref().unwrap().starts_with("  folder")).unwrap().unwrap();
        sleep(Duration::from_millis(200));
        send(&child, signal);
        let out: Vec<String> = out.map(Result::unwrap).collect();
        let (out, Ended { code, err, .. }) = (out.join("\n"), end(child));
        assert_eq!(code, 75, "{out}{err}");
        assert!(out.contains("stopped and saved at environment step"), "{out}");
        assert!(err.contains("stopping after this step"), "{err}");
        assert!(!run.join("done").exists());
    }
    let out = done(stopped.path(), &train_arguments(stopped.path(), &more));
    assert!(out.contains("resumed at"), "{out}");
    assert_same_run(&run_folder(straight.path(), task), &run, 9600);
}

/// A learning step of a second or more, within which both signals arrive.
#[test]
fn a_second_interrupt_exits_at_once() {
    let runs = tempfile::tempdir().unwrap();
    let slow = ["sac.batch_size=64", "encoder.filters=32", "environment.height=84"];
    let sets = slow.iter().flat_map(|set| ["--set", set]);
    let more = ["environment.width=84", "metrics.every_agent_steps=1", "checkpoint.minutes=60"];
    let sets: Vec<&str> = sets.chain(more.iter().flat_map(|set| ["--set", set])).collect();
    let child = start(runs.path(), &[&["falling-pixels"], &sets[..]].concat());
    let run = run_folder(runs.path(), "falling-pixels");
    wait_for(&run.join("metrics.jsonl"), "\"agent_step\":21,");
    for _ in 0..2 {
        send(&child, "-INT");
        sleep(Duration::from_millis(50));
    }
    let ended = end(child);
    assert_eq!(ended.code, 130, "{}{}", ended.out, ended.err);
    // The last save, that of the first evaluation, is whole.
    done(runs.path(), &["eval", run.to_str().unwrap(), "--episodes", "1", "--checkpoint", "0"]);
}

#[test]
fn one_process_a_run() {
    let runs = tempfile::tempdir().unwrap();
    let task = ["falling-pixels", "--environment-steps", "100000"];
    let first = start(runs.path(), &task);
    let run = run_folder(runs.path(), "falling-pixels");
    wait_for(&run.join("metrics.jsonl"), "agent_step");
    let second = hksl(runs.path(), &train_arguments(runs.path(), &task));
    assert_eq!(second.code, 1, "{}", second.err);
    let holder = format!("process {}", first.id());
    assert!(second.err.contains(&holder) && second.err.contains("--name"), "{}", second.err);
    // Looking at it is free.
    done(runs.path(), &["eval", run.to_str().unwrap(), "--episodes", "1"]);
    let mut first = first;
    first.kill().unwrap();
    first.wait().unwrap();
    // A dead process is in nobody's way.
    let mut third = start(runs.path(), &task);
    let mut out = BufReader::new(third.stdout.take().unwrap()).lines();
    out.find(|line| line.as_ref().unwrap().starts_with("  resumed at")).unwrap().unwrap();
    send(&third, "-TERM");
    out.for_each(|line| drop(line.unwrap()));
    assert_eq!(end(third).code, 75);
}

#[test]
fn losses_that_are_no_numbers_end_the_run_with_a_post_mortem() {
    let runs = tempfile::tempdir().unwrap();
    // A policy so wide that its densities overflow.
    let wide = ["--set", "sac.log_std_minimum=99", "--set", "sac.log_std_maximum=100"];
    let arguments = [&["falling-pixels"], &wide[..]].concat();
    let ended = hksl(runs.path(), &train_arguments(runs.path(), &arguments));
    assert_eq!(ended.code, 1, "{}{}", ended.out, ended.err);
    assert!(ended.err.contains("became") && ended.err.contains("agent step"), "{}", ended.err);
    let run = run_folder(runs.path(), "falling-pixels");
    let text = std::fs::read_to_string(run.join("post-mortem.json")).unwrap();
    assert!(text.contains("\"quantity\"") && text.contains("\"last_update\""), "{text}");
    assert!(run.join("post-mortem.safetensors").is_file());
}

#[test]
fn too_little_memory_is_told_with_the_way_out() {
    let runs = tempfile::tempdir().unwrap();
    let large = ["--environment-steps", "1000000000000", "--set", "replay.capacity=1000000000"];
    let arguments = [&["falling-pixels"], &large[..]].concat();
    let ended = hksl(runs.path(), &train_arguments(runs.path(), &arguments));
    assert_eq!(ended.code, 1, "{}{}", ended.out, ended.err);
    assert!(ended.err.contains("replay.storage=file"), "{}", ended.err);
    assert!(!run_folder(runs.path(), "falling-pixels").join("config.toml").exists());
    let files = [&arguments[..], &["--set", "replay.storage=file", "--dry-run"]].concat();
    let out = done(runs.path(), &train_arguments(runs.path(), &files));
    assert!(out.contains("the replay buffer in files") && out.contains("disk"), "{out}");
}
