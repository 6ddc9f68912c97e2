//! Readers that leave, disks that are full: no exit code becomes another one, nothing panics, no training stops.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use hksl_tests::{binary, done, hksl};

const TRAIN: [&str; 6] = ["train", "falling-pixels", "--preset", "debug", "--threads", "1"];
const LONG: [&str; 8] = [
    "--environment-steps",
    "100000",
    "--set",
    "evaluation.every_environment_steps=100000",
    "--set",
    "checkpoint.weights_every_environment_steps=100000",
    "--set",
    "checkpoint.minutes=10",
];

/// A pipe that nobody reads any more.
fn left() -> Stdio {
    let (_, writer) = std::io::pipe().unwrap();
    writer.into()
}

fn full() -> Stdio {
    File::options().write(true).open("/dev/full").unwrap().into()
}

fn run(folder: &Path, arguments: &[&str], out: Stdio, err: Stdio) -> (i32, String) {
    let mut command = Command::new(binary());
    command.args(arguments).current_dir(folder).stdout(out).stderr(err);
    let output = command.spawn().unwrap().wait_with_output().unwrap();
    (output.status.code().unwrap_or(-1), String::from_utf8(output.stderr).unwrap())
}

fn send(signal: &str, child: &Child) {
    let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

fn wait_for(file: &Path) {
    let began = Instant::now();
    while !file.exists() {
        assert!(began.elapsed() < Duration::from_secs(120), "no {}", file.display());
        sleep(Duration::from_millis(20));
    }
}

fn saved(run: &Path) -> bool {
    std::fs::read_dir(run.join("checkpoints")).is_ok_and(|entries| {
        entries.filter_map(Result::ok).any(|entry| entry.path().join("state").is_dir())
    })
}

/// A run that goes on until it is told to stop, once it has begun.
fn start(folder: &Path, out: Stdio, err: Stdio) -> (Child, PathBuf) {
    // Whoever runs the tests may ignore HUP, which a child would inherit.
    let mut command = Command::new("env");
    command.arg("--default-signal").arg(binary());
    command.args(TRAIN).args(LONG).current_dir(folder).stdout(out).stderr(err);
    let child = command.spawn().unwrap();
    let run = folder.join("runs/falling-pixels/hksl-debug/seed-1");
    wait_for(&run.join("eval.csv"));
    (child, run)
}

#[test]
fn a_reader_that_leaves_makes_no_stopped_run_a_done_one() {
    for signal in ["-TERM", "-INT"] {
        for both in [false, true] {
            let folder = tempfile::tempdir().unwrap();
            let err = if both { left() } else { Stdio::null() };
            let (mut child, run) = start(folder.path(), left(), err);
            send(signal, &child);
            assert_eq!(child.wait().unwrap().code(), Some(75), "{signal} {both}");
            assert!(saved(&run) && !run.join("done").exists());
        }
    }
}

#[test]
fn a_reader_that_leaves_makes_no_stopped_sweep_a_done_one() {
    let folder = tempfile::tempdir().unwrap();
    let study = "name = \"long\"\npresets = [\"debug\"]\nsettings.environment_steps = 100000\n\
                 settings.evaluation.every_environment_steps = 100000\n[[group]]\n\
                 tasks = [\"falling-pixels\"]\nseeds = [1]\n";
    std::fs::write(folder.path().join("s.toml"), study).unwrap();
    let mut command = Command::new(binary());
    command.args(["sweep", "s.toml"]).current_dir(folder.path()).stdout(left()).stderr(left());
    let mut child = command.spawn().unwrap();
    wait_for(&folder.path().join("runs/falling-pixels/hksl-debug/seed-1/eval.csv"));
    send("-TERM", &child);
    assert_eq!(child.wait().unwrap().code(), Some(75));
}

#[test]
fn the_exit_code_is_the_commands_whoever_reads() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&[&str], i32); 8] = [
        (&["tasks"], 0),
        (&["--help"], 0),
        (&["--version"], 0),
        (&["config", "show"], 0),
        (&["train", "--dry-run"], 0),
        (&["train", "nosuch"], 2),
        (&["train", "--nosuch"], 2),
        (&["eval", "nowhere"], 1),
    ];
    for (arguments, code) in cases {
        assert_eq!(run(folder.path(), arguments, left(), left()).0, code, "{arguments:?}");
        let (ended, said) = run(folder.path(), arguments, left(), Stdio::piped());
        assert!(ended == code && !said.contains("panicked"), "{arguments:?}: {said}");
        assert_eq!(run(folder.path(), arguments, Stdio::null(), full()).0, code, "{arguments:?}");
    }
    // What it finds, it exits with, read or not.
    std::fs::write(folder.path().join("file"), "").unwrap();
    let doctor = ["doctor", "--runs", "file"];
    let code = hksl(folder.path(), &doctor).code;
    assert_ne!(code, 0);
    assert_eq!(run(folder.path(), &doctor, left(), left()).0, code);
}

#[test]
fn data_that_cannot_be_written_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [&[&str]; 8] = [
        &["tasks"],
        &["--help"],
        &["--version"],
        &["config", "show"],
        &["completions", "bash"],
        &["train", "--dry-run"],
        &["rollout", "--steps", "3"],
        &["bench", "render", "--runs", "2", "--json"],
    ];
    for arguments in cases {
        let (code, said) = run(folder.path(), arguments, full(), Stdio::piped());
        assert_eq!(code, 1, "{arguments:?}: {said}");
        assert!(said.contains("standard output"), "{arguments:?}: {said}");
        assert_eq!(run(folder.path(), arguments, full(), full()).0, 1, "{arguments:?}");
    }
}

#[test]
fn a_training_does_not_depend_on_its_output() {
    let folder = tempfile::tempdir().unwrap();
    let short = ["--environment-steps", "80", "--name"];
    for (name, err) in [("told", Stdio::piped()), ("silent", full())] {
        let arguments = [&TRAIN[..], &short, &[name]].concat();
        let (code, said) = run(folder.path(), &arguments, full(), err);
        assert_eq!(code, 0, "{said}");
        let times = said.matches("cannot write to standard output").count();
        assert_eq!(times, usize::from(name == "told"), "{said}");
        let run = folder.path().join(format!("runs/falling-pixels/hksl-{name}/seed-1"));
        assert!(run.join("done").is_file());
    }
    let report = ["report", "runs", "--replicates", "100", "--out"];
    let (code, said) = run(folder.path(), &[&report[..], &["r"]].concat(), full(), Stdio::piped());
    assert!(code == 0 && said.contains("standard output"), "{said}");
    assert!(folder.path().join("r/index.html").is_file());
}

/// Programs read it: remarks go elsewhere.
#[test]
fn data_on_standard_output_is_alone_there() {
    let folder = tempfile::tempdir().unwrap();
    let plain = done(folder.path(), &["rollout", "--steps", "3"]);
    let named = done(folder.path(), &["rollout", "--steps", "3", "--out", "/dev/stdout"]);
    assert_eq!(plain, named);
    let gif = Command::new(binary())
        .args(["rollout", "--steps", "3", "--gif", "/dev/stdout"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(gif.status.success() && gif.stdout.starts_with(b"GIF89a"));
    assert_eq!(gif.stdout.last(), Some(&b';'), "the GIF's trailer is the last byte");
}

#[test]
fn what_schedulers_send_stops_a_run_saved() {
    for signal in ["-HUP", "-USR1", "-USR2", "-XCPU", "-TERM"] {
        let folder = tempfile::tempdir().unwrap();
        let (mut child, run) = start(folder.path(), Stdio::null(), Stdio::null());
        send(signal, &child);
        assert_eq!(child.wait().unwrap().code(), Some(75), "{signal}");
        assert!(saved(&run), "{signal}");
    }
}

#[test]
fn under_nohup_a_run_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new("nohup");
    command.arg(binary()).args(TRAIN).args(LONG).current_dir(folder.path());
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    wait_for(&folder.path().join("runs/falling-pixels/hksl-debug/seed-1/eval.csv"));
    send("-HUP", &child);
    sleep(Duration::from_secs(2));
    assert!(child.try_wait().unwrap().is_none(), "it ended");
    send("-TERM", &child);
    assert_eq!(child.wait().unwrap().code(), Some(75));
}

#[test]
fn a_limit_on_files_is_an_error_and_no_death() {
    let folder = tempfile::tempdir().unwrap();
    let script = format!("ulimit -f 20; exec {} {}", binary().display(), TRAIN.join(" "));
    let output =
        Command::new("bash").args(["-c", &script]).current_dir(folder.path()).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("cannot write"), "{said}");
}
