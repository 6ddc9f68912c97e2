//! The same seed gives the same bits; a run that was stopped and resumed is the run that was
//! never stopped.

use std::fs;
use std::path::Path;

use hksl_tests::{assert_same_run, done, evaluations_without_times, run_folder, train_arguments};

const TASKS: [&str; 2] = ["falling-pixels", "cartpole-swingup"];

fn run(runs: &Path, arguments: &[&str]) {
    done(runs, &train_arguments(runs, arguments));
}

/// Two processes: whatever hashes by a random key would differ between them.
#[test]
fn the_same_seed_gives_the_same_bits() {
    for task in TASKS {
        let runs = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        for runs in &runs {
            run(runs.path(), &[task]);
        }
        let [a, b] = runs.each_ref().map(|runs| run_folder(runs.path(), task));
        assert_same_run(&a, &b, 480);
    }
}

/// With networks of the paper's width, so that work is split.
#[test]
fn the_number_of_threads_changes_no_bit() {
    let fixed =
        ["--preset", "debug", "--environment-steps", "240", "--device", "cpu", "--runs", "."];
    let wide = ["--set", "encoder.filters=32"];
    let wide_heads = ["--set", "sac.hidden_units=1024", "--set", "sac.batch_size=32"];
    for method in ["hksl", "sac", "drq", "curl", "pi-sac", "dbc", "dreamer-v2"] {
        let heads = if method == "dreamer-v2" { &[] } else { &wide_heads[..] };
        let state = |threads: &str| {
            let runs = tempfile::tempdir().unwrap();
            let arguments = ["train", "falling-pixels", "--method", method, "--threads", threads];
            done(runs.path(), &[&arguments, &fixed[..], &wide, heads].concat());
            let run = runs.path().join(format!("falling-pixels/{method}-debug/seed-1"));
            fs::read(run.join("checkpoints/step-000000240/state/agent.safetensors")).unwrap()
        };
        assert!(state("1") == state("3"), "{method}");
    }
}

#[test]
fn another_seed_gives_other_bits() {
    let runs = tempfile::tempdir().unwrap();
    for seed in ["1", "2"] {
        run(runs.path(), &["falling-pixels", "--seed", seed, "--environment-steps", "240"]);
    }
    let weights = |seed: u64| {
        let run = runs.path().join(format!("falling-pixels/hksl-debug/seed-{seed}"));
        fs::read(run.join("checkpoints/step-000000240/weights.safetensors")).unwrap()
    };
    assert!(weights(1) != weights(2));
}

#[test]
fn a_run_that_was_cut_goes_on_as_if_it_had_not_been() {
    for task in TASKS {
        let (straight, cut) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        run(straight.path(), &[task]);
        // A budget that ends in the middle of an episode and of a window of metrics, but at an evaluation.
        run(cut.path(), &[task, "--environment-steps", "240"]);
        run(cut.path(), &[task]);
        let [a, b] = [&straight, &cut].map(|runs| run_folder(runs.path(), task));
        assert_same_run(&a, &b, 480);
    }
}

#[test]
fn a_replay_in_files_gives_the_same_bits() {
    let (memory, files) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    run(memory.path(), &["falling-pixels"]);
    // Saved and put into files often; cut and gone on with, from memory and from files.
    let often = ["--set", "checkpoint.minutes=0.0001", "--set"];
    let set = |storage: &'static str, steps| {
        let arguments = ["falling-pixels", "--environment-steps", steps];
        run(files.path(), &[&arguments, &often[..], &[storage]].concat());
    };
    set("replay.storage=memory", "240");
    set("replay.storage=file", "480");
    let [a, b] = [&memory, &files].map(|runs| run_folder(runs.path(), "falling-pixels"));
    assert_same_run(&a, &b, 480);
}

/// The event file goes on where it was cut; it says what metrics.jsonl and eval.csv say, and its loss ends no run.
#[test]
fn event_files_are_resumed_and_hang_no_run() {
    let runs = tempfile::tempdir().unwrap();
    let file = run_folder(runs.path(), "falling-pixels")
        .join("tensorboard/events.out.tfevents.0000000000.hksl");
    run(runs.path(), &["falling-pixels", "--environment-steps", "240"]);
    let before = fs::read(&file).unwrap();
    let count = |bytes: &[u8], tag: &str| {
        bytes.windows(tag.len()).filter(|part| *part == tag.as_bytes()).count()
    };
    assert_eq!(count(&before, "evaluation/episode_return_min"), 2);
    assert_eq!(count(&before, "evaluation/first_episode"), 2);
    assert_eq!(count(&before, "[hksl]"), 1);
    run(runs.path(), &["falling-pixels"]);
    let after = fs::read(&file).unwrap();
    assert!(after.starts_with(&before) && after.len() > before.len());
    assert_eq!(count(&after, "evaluation/episode_return_min"), 3);
    let lines = fs::read_to_string(run_folder(runs.path(), "falling-pixels").join("metrics.jsonl"))
        .unwrap();
    assert_eq!(count(&after, "training/wall_seconds"), lines.lines().count());
    fs::remove_dir_all(file.parent().unwrap()).unwrap();
    run(
        runs.path(),
        &["falling-pixels", "--environment-steps", "720", "--set", "evaluation.video=true"],
    );
    assert!(file.is_file());
    let video = run_folder(runs.path(), "falling-pixels").join("videos/step-000000720.gif");
    assert!(fs::read(video).unwrap().starts_with(b"GIF89a"));
}

/// `hksl eval` on a checkpoint gives the row that the run itself wrote there.
#[test]
fn evaluation_repeats_the_runs_own() {
    let runs = tempfile::tempdir().unwrap();
    run(runs.path(), &["falling-pixels", "--environment-steps", "240"]);
    let run = run_folder(runs.path(), "falling-pixels");
    let rows = evaluations_without_times(&run.join("eval.csv"));
    let mean: f64 = rows[2].split(',').nth(7).unwrap().parse().unwrap();
    let text = done(runs.path(), &["eval", run.to_str().unwrap(), "--checkpoint", "240"]);
    assert!(
        text.starts_with(&format!(
            "falling-pixels seed 1 at environment step 240: return {mean:.2} ± "
        )),
        "{text}"
    );
    let other = done(runs.path(), &["eval", run.to_str().unwrap(), "--episodes", "7"]);
    assert!(other.contains("over 7 episodes"), "{other}");
}
