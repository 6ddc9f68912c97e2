//! A sweep through a real Slurm of one machine: submitted, a task told to make room, requeued, finished.
//!
//! `tests/slurm/start.sh` installs and starts it; where that cannot be, the test says so and is skipped.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread::sleep;
use std::time::{Duration, Instant};

use hksl_tests::{assert_same_run, binary, done};

const STUDY: &str = r#"
name = "array"
runs = "my runs %j"
presets = ["debug"]
settings.environment_steps = 4800

[[group]]
tasks = ["falling-pixels"]
seeds = [1, 2, 3]

[slurm]
cpus = 1
at_once = 2
setup = ["set -euo pipefail"]
"#;

/// A folder that Slurm would split, and expand.
const RUNS: &str = "my runs %j";

/// A running Slurm, which ends with this.
struct Slurm {
    folder: tempfile::TempDir,
    configuration: PathBuf,
}

impl Slurm {
    fn start() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let started =
            Command::new("bash").arg(script("start.sh")).arg(folder.path()).output().unwrap();
        if started.status.code() == Some(77) {
            println!("skipped: {}", String::from_utf8_lossy(&started.stderr).trim());
            return None;
        }
        assert!(started.status.success(), "{started:?}");
        let configuration = String::from_utf8(started.stdout).unwrap().trim().into();
        Some(Self { folder, configuration })
    }

    fn command(&self, folder: &Path, program: &str, arguments: &[&str]) -> Output {
        Command::new(program)
            .args(arguments)
            .current_dir(folder)
            .env("SLURM_CONF", &self.configuration)
            .output()
            .unwrap()
    }

    /// Waits, and in vain tells what Slurm was doing.
    fn wait_until(&self, what: &str, mut holds: impl FnMut() -> bool) {
        let began = Instant::now();
        while !holds() {
            if began.elapsed() > Duration::from_secs(240) {
                let queue = self.command(self.folder.path(), "squeue", &["--array"]).stdout;
                let log = fs::read_to_string(self.folder.path().join("slurmctld.log")).unwrap();
                panic!("waited in vain: {what}\n{}\n{log}", String::from_utf8_lossy(&queue));
            }
            sleep(Duration::from_millis(200));
        }
    }

    /// What a command prints, which must end well.
    fn said(&self, folder: &Path, program: &str, arguments: &[&str]) -> String {
        let output = self.command(folder, program, arguments);
        assert!(output.status.success(), "{program} {arguments:?}: {output:?}");
        String::from_utf8(output.stdout).unwrap()
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        let _ = Command::new("bash").arg(script("stop.sh")).arg(self.folder.path()).status();
    }
}

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("slurm").join(name)
}

#[test]
fn an_array_is_submitted_preempted_requeued_and_finished() {
    let Some(slurm) = Slurm::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("study.toml"), STUDY).unwrap();
    let hksl = binary();
    let hksl = hksl.to_str().unwrap();
    let status = || slurm.said(path, hksl, &["sweep", "status", "study.toml"]);
    assert!(status().contains("3 not started"), "{}", status());

    let said = slurm.said(path, hksl, &["sweep", "study.toml", "--launcher", "slurm"]);
    assert!(said.contains("3 of 3 runs"), "{said}");
    let job = said.split_whitespace().nth(1).unwrap().to_owned();
    // Two at a time; the third waits.
    slurm.wait_until("two runs have begun", || status().contains("2 running"));
    assert!(status().contains("1 not started"), "{}", status());
    // Submitted again meanwhile, with one run more: that one alone joins the queue.
    fs::write(path.join("study.toml"), STUDY.replace("seeds = [1, 2, 3]", "seeds = [4, 1, 2, 3]"))
        .unwrap();
    let said = slurm.said(path, hksl, &["sweep", "study.toml", "--launcher", "slurm"]);
    assert!(said.contains("1 already queued") && said.contains("1 of 4 runs"), "{said}");
    fs::write(path.join("study.toml"), STUDY).unwrap();

    // One is told to make room: it saves, ends with 75, and its job puts it back into the queue.
    let runs = path.join(RUNS);
    let first = runs.join("falling-pixels/hksl-debug/seed-1");
    slurm.wait_until("the first run learns", || {
        fs::read_to_string(first.join("metrics.jsonl")).is_ok_and(|text| text.lines().count() > 8)
    });
    let task = format!("{job}_0");
    slurm.said(path, "scancel", &["--batch", "--signal=USR1", &task]);
    let state = || slurm.said(path, "squeue", &["--noheader", "--array", "--format=%i %T"]);
    slurm.wait_until("it is in the queue again", || state().contains(&format!("{task} PENDING")));
    let row = status().lines().find(|line| line.contains("seed-1")).unwrap().to_owned();
    assert!(row.contains("stopped, saved at"), "{row}");
    // Slurm lets two minutes pass before it starts such a job again; not here.
    slurm.wait_until("Slurm takes an earlier start", || {
        let update = ["update", &format!("JobId={task}"), "StartTime=now"];
        slurm.command(path, "scontrol", &update).status.success()
    });
    slurm.wait_until("all runs are done", || status().contains("3 done"));
    let fourth = runs.join("falling-pixels/hksl-debug/seed-4/done");
    slurm.wait_until("the one that came later is done", || fourth.is_file());
    let twice = fs::read_to_string(first.join("command.txt")).unwrap();
    assert_eq!(twice.lines().count(), 2, "{twice}");

    // Again: nothing is left. And the run that was cut is the one that was not.
    let said = slurm.said(path, hksl, &["sweep", "study.toml", "--launcher", "slurm"]);
    assert!(said.contains("all 3 runs are done"), "{said}");
    let submissions = runs.join("sweeps/array/slurm");
    assert!(!submissions.join("3").exists(), "nothing was submitted");
    // Each job's output is where it should be, and all that was told to the one that was cut, in one file.
    for index in 0..3 {
        let log = submissions.join(format!("1/{job}_{index}.log"));
        let text = fs::read_to_string(&log).unwrap();
        assert_eq!(text.contains("stopped and saved"), index == 0, "{text}");
        assert!(text.contains("done: the last policy"), "{text}");
    }
    // Slurm itself says what it has of a submission whose number was lost.
    fs::remove_file(submissions.join("1/job")).unwrap();
    fs::write(path.join("study.toml"), STUDY.replace("4800", "9600")).unwrap();
    let said = slurm.said(path, hksl, &["sweep", "study.toml", "--launcher", "slurm"]);
    assert!(said.contains("3 of 3 runs"), "{said}");
    fs::remove_file(submissions.join("3/job")).unwrap();
    let said = slurm.said(path, hksl, &["sweep", "study.toml", "--launcher", "slurm"]);
    assert!(said.contains("all 3 runs are done, running or queued"), "{said}");
    slurm.wait_until("all have used up the larger budget", || status().contains("3 done"));
    fs::write(path.join("study.toml"), STUDY).unwrap();
    let alone =
        ["train", "falling-pixels", "--preset", "debug", "--threads", "1", "--runs", "alone"];
    done(path, &[&alone[..], &["--set", "environment_steps=9600"]].concat());
    assert_same_run(&path.join("alone/falling-pixels/hksl-debug/seed-1"), &first, 9600);
}
