//! `hksl sweep`: studies that are cut, go on, and say where they stand.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use hksl_tests::{assert_same_run, binary, done, hksl};

/// Twelve runs of seconds: two methods with three seeds on one task, and an ablation and a wider network beside them.
const STUDY: &str = r#"
name = "twelve"
presets = ["debug"]
settings.checkpoint.minutes = 0.001

[[group]]
tasks = ["falling-pixels"]
methods = ["hksl", "drq"]
seeds = [1, 2, 3]

[[group]]
tasks = ["falling-pixels"]
ablations = ["no-c"]
seeds = [1, 2, 3]

[[group]]
tasks = ["falling-pixels"]
seeds = [1, 2, 3]
name = "wide"
settings.sac.hidden_units = 48

[local]
jobs = 2
"#;

fn study(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("study.toml");
    fs::write(&path, text).unwrap();
    path
}

fn start(folder: &Path) -> Child {
    Command::new(binary())
        .args(["sweep", "study.toml", "--runs", "runs"])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// How many runs the status counts as this.
fn count(folder: &Path, what: &str) -> usize {
    let printed = done(folder, &["sweep", "status", "study.toml", "--runs", "runs"]);
    let last = printed.lines().last().unwrap().to_owned();
    let before = last.split(&format!(" {what}")).next().unwrap().to_owned();
    before.rsplit([' ', ',']).next().unwrap().parse().unwrap_or_else(|_| panic!("{what}: {last}"))
}

#[test]
fn twelve_runs_that_are_cut_twice_end_as_if_run_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    study(path, STUDY);
    assert_eq!(count(path, "not started"), 12);

    // Told to stop: its runs save, and it ends with the code that says so.
    let mut sweep = start(path);
    while count(path, "done") < 1 {
        sleep(Duration::from_millis(50));
    }
    let told = Command::new("kill").args(["-TERM", &sweep.id().to_string()]).status().unwrap();
    assert!(told.success());
    assert_eq!(sweep.wait().unwrap().code(), Some(75));
    assert_eq!(count(path, "running"), 0);
    let before = count(path, "done");
    assert!((1..12).contains(&before), "{before}");

    // Killed: its runs go on without it, and the next sweep waits for them.
    let mut sweep = start(path);
    while count(path, "done") < before + 2 {
        sleep(Duration::from_millis(50));
    }
    sweep.kill().unwrap();
    sweep.wait().unwrap();
    let printed = done(path, &["sweep", "study.toml", "--runs", "runs"]);
    assert!(printed.contains("12 of 12 runs ended, 0 with an error"), "{printed}");
    assert_eq!(count(path, "done"), 12);
    let again = done(path, &["sweep", "study.toml", "--runs", "runs"]);
    assert_eq!(again.matches("already done").count(), 12, "{again}");

    // Every run against the same without a sweep.
    let cores = std::thread::available_parallelism().unwrap().get();
    let threads = (cores / 2).max(1).to_string();
    let listed = done(path, &["sweep", "study.toml", "--runs", "runs", "--dry-run"]);
    assert!(listed.contains("12 runs under"), "{listed}");
    for (arguments, name) in [
        (vec![], "hksl-debug"),
        (vec!["--method", "drq"], "drq-debug"),
        (vec!["--ablation", "no-c"], "hksl-no-c-debug"),
        (vec!["--name", "wide", "--set", "sac.hidden_units=48"], "hksl-wide"),
    ] {
        for seed in ["1", "2", "3"] {
            let fixed = ["train", "falling-pixels", "--preset", "debug", "--seed", seed];
            let more =
                ["--set", "checkpoint.minutes=0.001", "--threads", &threads, "--runs", "alone"];
            done(path, &[&fixed[..], &arguments, &more].concat());
            let run =
                |runs: &str| path.join(runs).join(format!("falling-pixels/{name}/seed-{seed}"));
            assert_same_run(&run("alone"), &run("runs"), 480);
        }
    }
    // A folder of runs is looked into without its study.
    let printed = done(path, &["sweep", "status", "alone"]);
    assert!(printed.contains("12 runs: 12 done"), "{printed}");
}

#[test]
fn a_run_that_fails_stops_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    // The first run's policy is so wide that its densities overflow.
    let text = r#"
name = "two"
presets = ["debug"]

[[group]]
tasks = ["falling-pixels"]
seeds = [1]
name = "wild"
settings = { sac.log_std_minimum = 99, sac.log_std_maximum = 100 }

[[group]]
tasks = ["falling-pixels"]
seeds = [1]
"#;
    study(path, text);
    let ended = hksl(path, &["sweep", "study.toml", "--runs", "runs"]);
    let wild = path.join("runs/falling-pixels/hksl-wild/seed-1");
    assert_eq!(ended.code, 1, "{}", ended.err);
    assert!(ended.out.contains("FAILED") && ended.out.contains("1 with an error"), "{}", ended.out);
    assert_eq!((count(path, "failed"), count(path, "done")), (1, 1));
    assert!(fs::read_to_string(wild.join("failed")).unwrap().contains("became"));

    // Its settings were changed: what is there is not what it asks for.
    study(path, &text.replace("sac.log_std_maximum = 100", "sac.log_std_maximum = 99.5"));
    let listed = done(path, &["sweep", "study.toml", "--runs", "runs", "--dry-run"]);
    assert!(listed.contains("contains a run of another configuration"), "{listed}");
    for launcher in ["local", "slurm"] {
        let ended = hksl(path, &["sweep", "study.toml", "--runs", "runs", "--launcher", launcher]);
        assert_eq!(ended.code, 2, "{launcher}: {}", ended.out);
        for words in ["1 of the study's 2 runs", "sac.log_std_maximum is 100", "not 99.5", "--runs"]
        {
            assert!(ended.err.contains(words), "no `{words}` in {}", ended.err);
        }
    }
    // One that cannot be read hides no other.
    fs::write(wild.join("config.toml"), "").unwrap();
    let printed = done(path, &["sweep", "status", "runs"]);
    assert!(printed.contains("2 runs: 1 done") && printed.contains("1 failed"), "{printed}");
    assert!(printed.contains("config.toml is damaged"), "{printed}");
}

/// As on two machines with one disk: whoever comes second to a run leaves it to the other, and waits for it.
#[test]
fn two_sweeps_of_one_study_share_its_runs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let text =
        "name = \"shared\"\npresets = [\"debug\"]\n\n[[group]]\ntasks = [\"falling-pixels\"]\n";
    study(path, &format!("{text}seeds = [1, 2, 3]\n"));
    let mut sweeps = [start(path), start(path)];
    for sweep in &mut sweeps {
        assert_eq!(sweep.wait().unwrap().code(), Some(0));
    }
    assert_eq!(count(path, "done"), 3);
}

/// The second log cannot be written: the first run has begun by then, and must not go on alone.
#[cfg(target_os = "linux")]
#[test]
fn an_error_of_the_sweep_itself_stops_its_runs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let long = "settings.checkpoint.minutes = 0.001\nsettings.environment_steps = 1_000_000";
    study(path, &STUDY.replace("settings.checkpoint.minutes = 0.001", long));
    let logs = path.join("runs/sweeps/twelve/logs");
    for seed in [2, 3] {
        fs::create_dir_all(logs.join(format!("falling-pixels_hksl-debug_seed-{seed}.log")))
            .unwrap();
    }
    let ended = Command::new(binary())
        .args(["sweep", "study.toml", "--runs", "runs"])
        .current_dir(path)
        .output()
        .unwrap();
    let said = String::from_utf8(ended.stderr).unwrap();
    assert!(!ended.status.success() && said.contains("seed-2.log"), "{said}");
    // Saved, or gone before there was anything to save.
    for _ in 0..600 {
        if processes_in(path) == 0 {
            return;
        }
        sleep(Duration::from_millis(100));
    }
    let log = logs.join("falling-pixels_hksl-debug_seed-1.log");
    panic!("goes on: {}", fs::read_to_string(&log).unwrap());
}

/// How many processes have this as their working folder.
#[cfg(target_os = "linux")]
fn processes_in(folder: &Path) -> usize {
    let folder = folder.canonicalize().unwrap();
    let processes = fs::read_dir("/proc").unwrap().filter_map(|process| {
        let working_folder = process.ok()?.path().join("cwd");
        fs::read_link(working_folder).ok().filter(|path| *path == folder)
    });
    processes.count()
}

#[test]
fn what_is_wrong_in_a_study_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let group = "[[group]]\ntasks = [\"falling-pixels\"]\nseeds = [1]\n";
    for (text, words) in [
        ("name = \"x\"\n".to_owned(), &["no [[group]]"][..]),
        (format!("name = \"x\"\nnmae = 1\n{group}"), &["unknown field `nmae`", "expected one of"]),
        (
            format!("name = \"x\"\n{}", group.replace("falling-pixels", "falling-pixel")),
            &["group 1", "unknown task `falling-pixel`", "did you mean `falling-pixels`"],
        ),
        (
            format!("name = \"x\"\n{group}methods = [\"dqr\"]\n"),
            &["unknown method `dqr`", "did you mean `drq`", "dreamer-v2"],
        ),
        (
            format!("name = \"x\"\n{group}methods = [\"hksl\", \"drq\"]\nablations = [\"no-c\"]\n"),
            &["no-c", "drq", "a group of their own"],
        ),
        (
            format!("name = \"x\"\n{group}seeds = []\n").replace("seeds = [1]\n", ""),
            &["seeds is empty"],
        ),
        (format!("name = \"x\"\n{group}\n{group}"), &["groups 1 and 2", "seed-1", "name = "]),
        (
            format!("name = \"x\"\nsettings.sac.batchsize = 3\n{group}"),
            &["group 1", "hksl on falling-pixels, seed 1", "sac.batchsize", "did you mean"],
        ),
        (format!("name = \"a/b\"\n{group}"), &["name must consist of"]),
        (format!("name = \"..\"\n{group}"), &["name must consist of", "not begin with '.'"]),
        (format!("name = \"x\"\n{group}name = \"../up\"\n"), &["group 1: name must consist of"]),
        (
            format!("name = \"x\"\nsettings.seed = 3\n{group}"),
            &["settings.seed has no effect", "the group's seeds"],
        ),
        (
            format!("name = \"x\"\n{group}settings.threads = 3\n"),
            &["group 1: settings.threads", "local.jobs"],
        ),
        (format!("name = \"x\"\n[local]\njobs = 0\n{group}"), &["local.jobs is 0"]),
        (
            format!("name = \"x\"\n{}", group.replace("[1]", "[1, 2, 1]")),
            &["group 1: seeds has 1 twice", "remove one"],
        ),
        (
            format!("name = \"x\"\n{group}methods = [\"drq\", \"drq\"]\n"),
            &["group 1: methods has drq twice"],
        ),
        (
            format!("name = \"x\"\n{}", group.replace("[1]", "[\"1e2\"]")),
            &["is not a whole number", "write 100 without quotes"],
        ),
        (format!("name = \"x\"\n{}", group.replace("[1]", "[1.5]")), &["1.5 is not a whole"]),
        (
            format!("name = \"x\"\n[local]\njobs = -1\n{group}"),
            &["-1 is not a whole number of at least 0"],
        ),
    ] {
        study(path, &text);
        let ended = hksl(path, &["sweep", "study.toml", "--dry-run"]);
        assert_eq!(ended.code, 2, "{text}\n{}{}", ended.out, ended.err);
        for word in words {
            assert!(ended.err.contains(word), "no `{word}` in {}", ended.err);
        }
    }
    let ended = hksl(path, &["sweep", "nowhere.toml"]);
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("nowhere.toml"), "{}", ended.err);
    let ended = hksl(path, &["sweep"]);
    assert_eq!(ended.code, 2);
}

#[test]
fn a_study_may_come_from_any_editor() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let text = "name = \"x\"\npresets = [\"debug\"]\nsettings.environment_steps = 8e1\n\n[[group]]\n\
                tasks = [\"falling-pixels\"]\nseeds = [1.0, 2]\n[local]\njobs = 2.0\n[slurm]\ncpus = 1.0\n";
    fs::write(path.join("study.toml"), format!("\u{feff}{}", text.replace('\n', "\r\n"))).unwrap();
    let listed = done(path, &["sweep", "study.toml", "--dry-run"]);
    assert!(
        listed.contains("2 runs under") && listed.contains("160 environment steps"),
        "{listed}"
    );
    assert!(listed.contains("seed-2"), "{listed}");
}

/// Without Slurm the job is written, and what to do with it said.
#[test]
fn without_sbatch_the_job_is_left_to_be_submitted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let slurm = "\n[slurm]\npartition = \"gpu\"\ntime = \"1:00:00\"\ngpus = \"1\"\ncpus = 3\nmemory = \"8G\"\nat_once = 4\n\
                 directives = [\"--account=vision\"]\nsetup = [\"module load cuda\"]\n";
    study(path, &(STUDY.to_owned() + slurm));
    let ended = Command::new(binary())
        .args(["sweep", "study.toml", "--runs", "runs", "--launcher", "slurm"])
        .current_dir(path)
        .env("PATH", path)
        .output()
        .unwrap();
    assert_eq!(ended.status.code(), Some(1));
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(said.contains("cannot run sbatch") && said.contains("job.sh"), "{said}");
    let job = fs::read_to_string(path.join("runs/sweeps/twelve/slurm/1/job.sh")).unwrap();
    for line in [
        "#SBATCH --job-name=hksl-twelve",
        "#SBATCH --array=0-11%4",
        "#SBATCH --requeue",
        "#SBATCH --signal=B:USR1@180",
        "#SBATCH --cpus-per-task=3",
        "#SBATCH --partition=gpu",
        "#SBATCH --time=1:00:00",
        "#SBATCH --gpus=1",
        "#SBATCH --mem=8G",
        "#SBATCH --account=vision",
        "module load cuda",
    ] {
        assert!(job.lines().any(|found| found == line), "no `{line}` in {job}");
    }
    let runs = fs::read_to_string(path.join("runs/sweeps/twelve/slurm/1/runs.txt")).unwrap();
    assert_eq!(runs.lines().count(), 12);
    assert!(
        runs.lines().last().unwrap().contains("--name wide --set checkpoint.minutes=0.001"),
        "{runs}"
    );
    let sound =
        Command::new("bash").arg("-n").arg(path.join("runs/sweeps/twelve/slurm/1/job.sh")).status();
    assert!(sound.unwrap().success());
}
