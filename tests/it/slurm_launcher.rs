//! `hksl sweep --launcher slurm` beside programs that answer as Slurm's do on a bad day.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use hksl_tests::{Ended, binary};

const STUDY: &str = r#"
name = "day"
presets = ["debug"]

[[group]]
tasks = ["falling-pixels"]
seeds = [1, 2, 3]
"#;

/// A folder with a study and, in `bin`, scripts in place of Slurm's programs.
struct Site {
    folder: tempfile::TempDir,
}

impl Site {
    fn new(study: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("bin")).unwrap();
        fs::write(folder.path().join("study.toml"), study).unwrap();
        Self { folder }
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Puts a script in a program's place; it notes its arguments in `NAME.calls`.
    fn program(&self, name: &str, script: &str) -> &Self {
        let path = self.path().join("bin").join(name);
        let calls = self.path().join(format!("{name}.calls"));
        let text = format!("#!/bin/bash\necho \"$*\" >> '{}'\n{script}\n", calls.display());
        // Aside and renamed: what is just being written cannot be run.
        let aside = path.with_extension("new");
        fs::write(&aside, text).unwrap();
        fs::set_permissions(&aside, fs::Permissions::from_mode(0o755)).unwrap();
        fs::rename(aside, path).unwrap();
        self
    }

    fn calls(&self, name: &str) -> Vec<String> {
        let text = fs::read_to_string(self.path().join(format!("{name}.calls")));
        text.unwrap_or_default().lines().map(str::to_owned).collect()
    }

    fn command(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        let path = std::env::var("PATH").unwrap();
        command.env("PATH", format!("{}:{path}", self.path().join("bin").display()));
        // As in a user's profile: it would hide jobs.
        command.env("SQUEUE_STATES", "RUNNING");
        command.current_dir(self.path());
        command
    }

    fn sweep_in(&self, runs: &str) -> Ended {
        let arguments = ["sweep", "study.toml", "--launcher", "slurm", "--runs", runs];
        self.command(&binary()).args(arguments).output().unwrap().into()
    }

    fn sweep(&self) -> Ended {
        self.sweep_in("runs")
    }

    fn submission(&self, number: u32) -> PathBuf {
        self.path().join(format!("runs/sweeps/day/slurm/{number}"))
    }
}

#[test]
fn the_job_number_is_found_among_notices() {
    let site = Site::new(STUDY);
    site.program("sbatch", "echo 'Note: 17 nodes are down'; echo '4242;c1'");
    site.program(
        "squeue",
        "[ -z \"$SQUEUE_STATES\" ] || exit 1; echo 'CLUSTER: c1'; printf '0\\n1\\n2\\n'",
    );
    let ended = site.sweep();
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.out.contains("job 4242;c1 with 3 of 3 runs"), "{}", ended.out);
    let folder = site.submission(1);
    assert_eq!(fs::read_to_string(folder.join("job")).unwrap(), "4242\n");
    // All are in the queue: nothing is submitted again.
    let again = site.sweep();
    assert!(again.code == 0 && again.out.contains("all 3 runs"), "{}{}", again.out, again.err);
    assert_eq!(site.calls("sbatch").len(), 1);
    assert!(site.calls("squeue")[0].contains("--clusters=c1"), "{:?}", site.calls("squeue"));
    assert!(site.calls("squeue")[0].contains("--jobs 4242"));
}

#[test]
fn an_answer_of_sbatch_that_is_no_number_is_an_error() {
    let site = Site::new(STUDY);
    site.program("sbatch", "echo 'Submitted, good luck'").program("squeue", "true");
    let ended = site.sweep();
    assert_eq!(ended.code, 1, "{}", ended.out);
    assert!(ended.err.contains("Submitted, good luck"), "{}", ended.err);
    assert!(!site.submission(1).join("job").exists());
    // It had taken the job: the next sweep finds it by its script.
    let script = site.submission(1).join("job.sh").canonicalize().unwrap();
    let row = format!("for i in 0 1 2; do echo '77' $i '{}'; done", script.display());
    site.program("squeue", &row);
    let again = site.sweep();
    assert!(again.code == 0 && again.out.contains("all 3 runs"), "{}{}", again.out, again.err);
    assert_eq!(fs::read_to_string(site.submission(1).join("job")).unwrap(), "77\n");
    assert_eq!(site.calls("sbatch").len(), 1);
}

#[test]
fn a_failed_question_is_no_answer() {
    let site = Site::new(STUDY);
    let timed_out =
        "echo 'slurm_load_jobs error: Socket timed out on send/recv operation' >&2; exit 1";
    site.program("sbatch", "echo 4242").program("squeue", timed_out);
    site.program("scontrol", timed_out);
    assert_eq!(site.sweep().code, 0);
    let again = site.sweep();
    assert_eq!(again.code, 1, "{}", again.out);
    for words in ["nothing was submitted", "Socket timed out", "slurm/1", "4242"] {
        assert!(again.err.contains(words), "no `{words}` in {}", again.err);
    }
    assert_eq!(site.calls("sbatch").len(), 1, "submitted twice");
    assert!(!site.submission(2).exists());
    // Nor is one in another form.
    site.program("squeue", "echo 'Welcome'; echo 0");
    assert_eq!(site.sweep().code, 1);
    // Slurm itself says that it does not know the job: it is over.
    site.program("squeue", "echo 'slurm_load_jobs error: Invalid job id specified' >&2; exit 1");
    assert_eq!(site.sweep().code, 0);
    assert_eq!(site.calls("sbatch").len(), 2);
    // A submission whose number cannot be read is not one that never was.
    fs::write(site.submission(2).join("job"), "about forty\n").unwrap();
    let ended = site.sweep();
    assert!(ended.code == 1 && ended.err.contains("about forty"), "{}", ended.err);
    // By hand, on another system, with all that sbatch printed.
    fs::write(site.submission(2).join("job"), "\u{feff}Hello\r\n4243\r\n").unwrap();
    site.program("squeue", "printf '0\\n1\\n2\\n'");
    assert_eq!(site.sweep().code, 0);
    assert_eq!(site.calls("sbatch").len(), 2);
}

#[test]
fn a_submission_that_failed_may_have_been_taken() {
    let site = Site::new(STUDY);
    site.program("sbatch", "echo 'sbatch: error: Socket timed out' >&2; exit 1");
    site.program("squeue", "exit 1");
    let ended = site.sweep();
    assert!(ended.code == 1 && ended.err.contains("Socket timed out"), "{}", ended.err);
    let again = site.sweep();
    assert!(again.code == 1 && again.err.contains("nothing was submitted"), "{}", again.err);
    assert_eq!(site.calls("sbatch").len(), 1);
    // Slurm has nothing of it.
    site.program("squeue", "true").program("sbatch", "echo 5");
    assert_eq!(site.sweep().code, 0);
    assert_eq!(site.calls("sbatch").len(), 2);
}

#[test]
fn arrays_are_no_larger_than_slurm_takes() {
    let seeds: Vec<String> = (1..=1202).map(|seed: u32| seed.to_string()).collect();
    let study = |slurm: &str| {
        STUDY.replace("[1, 2, 3]", &format!("[{}]", seeds.join(", "))) + "\n[slurm]\n" + slurm
    };
    let arrays = |site: &Site| -> Vec<String> {
        let mut found = Vec::new();
        for number in 1.. {
            let Ok(job) = fs::read_to_string(site.submission(number).join("job.sh")) else { break };
            let line = job.lines().find(|line| line.starts_with("#SBATCH --array=")).unwrap();
            let runs = fs::read_to_string(site.submission(number).join("runs.txt")).unwrap();
            found.push(format!("{} {}", &line["#SBATCH --array=".len()..], runs.lines().count()));
        }
        found
    };
    let site = Site::new(&study(""));
    site.program("sbatch", "echo $((4000 + $(wc -l < sbatch.calls)))");
    site.program("scontrol", "echo 'MaxArraySize            = 1001'");
    let ended = site.sweep();
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert_eq!(arrays(&site), ["0-1000 1001", "0-200 201"]);
    assert!(ended.out.contains("job 4001 with 1001 of 1202 runs"), "{}", ended.out);
    assert!(ended.out.contains("job 4002 with 201 of 1202 runs"), "{}", ended.out);
    // The limit is not told; and only so many at once, over both arrays.
    let site = Site::new(&study("at_once = 20\n"));
    site.program("sbatch", "echo $((4000 + $(wc -l < sbatch.calls)))");
    site.program("scontrol", "exit 1");
    assert_eq!(site.sweep().code, 0);
    assert_eq!(arrays(&site), ["0-999%20 1000", "0-201%20 202"]);
    assert!(site.calls("sbatch")[1].contains("--dependency=afterany:4001"));
    // Only what is left is numbered.
    site.program("squeue", "seq 1 999");
    let ended = site.sweep();
    assert!(ended.out.contains("1200 already queued"), "{}{}", ended.out, ended.err);
    assert_eq!(arrays(&site)[2], "0-1%20 2");
}

#[test]
fn a_study_says_nothing_that_slurm_could_not_take() {
    for (slurm, words) in [
        ("at_once = 0", &["slurm.at_once is 0", "at least 1"][..]),
        ("cpus = 0", &["slurm.cpus is 0", "at least 1"]),
        ("partition = \"a\\nb\"", &["slurm.partition", "one line"]),
        ("time = \"\"", &["slurm.time", "left out"]),
        ("directives = [\"account=vision\"]", &["slurm.directives[0]", "--account=vision"]),
        ("directives = [\"--x=1\\nrm -rf /\"]", &["slurm.directives[0]", "one line"]),
        ("directives = [\"--array=0-5\"]", &["slurm.directives[0]", "at_once"]),
    ] {
        let site = Site::new(&format!("{STUDY}\n[slurm]\n{slurm}\n"));
        let ended = site.sweep();
        assert_eq!(ended.code, 2, "{slurm}: {}", ended.err);
        for word in words {
            assert!(ended.err.contains(word), "no `{word}` in {}", ended.err);
        }
    }
}

#[test]
fn paths_reach_slurm_whole_or_are_refused() {
    let site = Site::new(STUDY);
    site.program("sbatch", "echo 1");
    for (runs, written) in [("my runs", "/my runs/"), ("r%j", "/r%%j/"), ("a#b 'c'", "/a#b 'c'/")] {
        let ended = site.sweep_in(runs);
        assert_eq!(ended.code, 0, "{}", ended.err);
        let folder = site.path().join(runs).join("sweeps/day/slurm/1");
        let job = fs::read_to_string(folder.join("job.sh")).unwrap();
        let line = job.lines().find(|line| line.starts_with("#SBATCH --output=")).unwrap();
        assert!(line.contains(written), "{line}");
        // Quoted where Slurm would split.
        assert_eq!(line.ends_with('"'), runs != "r%j", "{line}");
        assert!(
            Command::new("bash").arg("-n").arg(folder.join("job.sh")).status().unwrap().success()
        );
    }
    for runs in ["a\"b", "a\\b", "a\nb"] {
        let ended = site.sweep_in(runs);
        assert_eq!(ended.code, 2, "{}", ended.err);
        assert!(ended.err.contains("--runs") && ended.err.contains("Slurm"), "{}", ended.err);
        assert!(!site.path().join(runs).exists());
    }
}

/// Runs a job's script as Slurm would, sends it a signal once the run learns, and returns its exit code.
fn stopped_job(site: &Site, begun: &Path, signal: &str) -> i32 {
    let mut child = site
        .command(Path::new("bash"))
        .arg(site.submission(1).join("job.sh"))
        .envs([("SLURM_ARRAY_TASK_ID", "0"), ("SLURM_ARRAY_JOB_ID", "9")])
        .spawn()
        .unwrap();
    let began = Instant::now();
    while !begun.exists() {
        assert!(began.elapsed() < Duration::from_secs(120), "no {}", begun.display());
        sleep(Duration::from_millis(20));
    }
    let id = child.id().to_string();
    assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
    child.wait().unwrap().code().unwrap_or(-1)
}

#[test]
fn whatever_setup_sets_a_stopped_run_is_queued_again() {
    for (setup, begun, signal) in [
        ("set -euo pipefail", "runs/falling-pixels/hksl-debug/seed-1/eval.csv", "-USR1"),
        ("trap '' USR1 TERM EXIT", "runs/falling-pixels/hksl-debug/seed-1/eval.csv", "-TERM"),
        ("set -- a b; cd /; IFS=:", "runs/falling-pixels/hksl-debug/seed-1/eval.csv", "-USR1"),
        // Told before there is a run.
        ("touch here; sleep 60", "here", "-USR1"),
    ] {
        let study = STUDY.replace("seeds = [1, 2, 3]", "seeds = [1]")
            + "settings.environment_steps = 1000000\nsettings.evaluation.every_environment_steps = 1000000\n"
            + &format!("[slurm]\nsetup = [\"{setup}\"]\n");
        let site = Site::new(&study);
        // Slurm does not answer at once.
        site.program("scontrol", "[ \"$1\" = requeue ] && [ \"$(wc -l < scontrol.calls)\" -gt 2 ]");
        site.program("sbatch", "echo 9");
        assert_eq!(site.sweep().code, 0);
        let code = stopped_job(&site, &site.path().join(begun), signal);
        assert_eq!(code, 75, "{setup}");
        let calls = site.calls("scontrol");
        assert_eq!(calls.last().unwrap(), "requeue 9_0", "{setup}: {calls:?}");
    }
}

#[test]
fn a_job_without_its_line_starts_no_run() {
    let site = Site::new(STUDY);
    site.program("sbatch", "echo 9");
    assert_eq!(site.sweep().code, 0);
    fs::remove_file(site.submission(1).join("runs.txt")).unwrap();
    let output = site
        .command(Path::new("bash"))
        .arg(site.submission(1).join("job.sh"))
        .env("SLURM_ARRAY_TASK_ID", "0")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(!site.path().join("runs/falling-pixels").exists());
}
