//! `hksl probe`, `analyze-comm` and `attention` on runs of the debug preset.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use hksl_tests::{PLAIN_RENDERING, done, hksl, rows_of, run_folder, train_arguments};
use serde_json::Value;

/// Two runs on Falling Pixels, full and without communication.
fn runs(folder: &Path) -> (PathBuf, PathBuf) {
    done(folder, &train_arguments(folder, &["falling-pixels"]));
    done(folder, &train_arguments(folder, &["falling-pixels", "--ablation", "no-c"]));
    (run_folder(folder, "falling-pixels"), folder.join("falling-pixels/hksl-no-c-debug/seed-1"))
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn number(row: &BTreeMap<String, String>, name: &str) -> f64 {
    row[name].parse().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Arguments that every call here has: little data, kept in the test's own folder.
fn small<'a>(arguments: &[&'a str]) -> Vec<&'a str> {
    [arguments, &["--device", "cpu", "--threads", "2", "--cache", "cache"]].concat()
}

#[test]
fn probes_of_two_runs_say_the_same_twice() {
    let folder = tempfile::tempdir().unwrap();
    let (full, silent) = runs(folder.path());
    let arguments = |out: &'static str| {
        let few = ["--train-episodes", "3", "--test-episodes", "2", "--checkpoints", "0,480"];
        small(&[&["probe", text(&full), text(&silent)], &few[..], &["--out", out]].concat())
    };
    let printed = done(folder.path(), &arguments("first"));
    for word in ["hksl-debug", "hksl-no-c-debug", "t+1", "t+3", "t+5", "level 3", "all", "the mean"]
    {
        assert!(printed.contains(word), "no `{word}` in {printed}");
    }
    let first = folder.path().join("first");
    let found = rows_of(&first.join("probe.csv"));
    // Two runs, two checkpoints, three levels and all of them, three horizons.
    assert_eq!(found.len(), 2 * 2 * 4 * 3);
    for row in &found {
        assert!(number(row, "mse") > 0.0 && number(row, "constant_mse") > 0.0, "{row:?}");
        assert_eq!((row["test_episodes"].as_str(), row["transfer"].as_str()), ("2", "false"));
    }
    // What knowing nothing brings is the same for all: they saw the same episodes.
    let constant = |label: &str| {
        let of =
            found.iter().find(|row| row["label"] == label && row["horizon_agent_steps"] == "3");
        of.unwrap()["constant_mse"].clone()
    };
    assert_eq!(constant("hksl-debug"), constant("hksl-no-c-debug"));
    let episodes = rows_of(&first.join("probe-episodes.csv"));
    assert_eq!(episodes.len(), 2 * found.len());
    let mean = (number(&episodes[0], "mse") + number(&episodes[1], "mse")) / 2.0;
    assert!((mean / number(&found[0], "mse") - 1.0).abs() < 1e-9);
    let whole = json(&first.join("probe.json"));
    assert_eq!(whole["results"].as_array().unwrap().len(), found.len());
    assert_eq!(whole["settings"]["coordinates"]["falling-pixels"][0], "agent_column");
    for file in ["probe-falling-pixels-0.svg", "probe-encoders-falling-pixels-480.svg"] {
        let picture = fs::read_to_string(first.join(file)).unwrap();
        assert!(picture.contains("hksl-no-c-debug") && picture.contains("t+5"), "{file}");
    }

    // What is drawn, as numbers: with one seed a bar is a row of the table.
    let bars = rows_of(&first.join("probe-falling-pixels-480.csv"));
    assert_eq!(bars.len(), 2 * 3);
    for bar in &bars {
        let of = |row: &&BTreeMap<String, String>| {
            row["label"] == bar["bar"]
                && row["horizon_agent_steps"] == bar["horizon_agent_steps"]
                && (row["environment_step"].as_str(), row["encoder"].as_str()) == ("480", "all")
        };
        let row = found.iter().find(of).unwrap();
        assert!((number(row, "mse") / number(bar, "mse") - 1.0).abs() < 1e-12, "{bar:?}");
        assert!((number(row, "mse_std") / number(bar, "mse_std") - 1.0).abs() < 1e-9, "{bar:?}");
    }

    // Again, from the cache, which is not written anew: to the byte the same.
    let cached = || {
        let mut files = fs::read_dir(folder.path().join("cache")).unwrap();
        let file = files.next().unwrap().unwrap();
        assert!(files.next().is_none());
        file.metadata().unwrap().modified().unwrap()
    };
    let written = cached();
    done(folder.path(), &arguments("second"));
    assert_eq!(cached(), written);
    for file in ["probe.csv", "probe-episodes.csv", "probe.json", "probe-falling-pixels-480.svg"] {
        let bytes = |out: &str| fs::read(folder.path().join(out).join(file)).unwrap();
        assert_eq!(bytes("first"), bytes("second"), "{file}");
    }
    // And without it.
    fs::remove_dir_all(folder.path().join("cache")).unwrap();
    done(folder.path(), &arguments("third"));
    let bytes = |out: &str| fs::read(folder.path().join(out).join("probe.csv")).unwrap();
    assert_eq!(bytes("first"), bytes("third"));

    // Nothing is overwritten; bad input is named, and leaves nothing.
    let refused = |arguments: &[&str], code: i32, words: &[&str]| {
        let ended = hksl(folder.path(), &small(arguments));
        assert_eq!(ended.code, code, "{arguments:?}: {}", ended.err);
        for word in words {
            assert!(ended.err.contains(word), "no `{word}` in {}", ended.err);
        }
        assert!(!folder.path().join("new").exists(), "{arguments:?}");
    };
    let run = text(&full);
    fs::write(folder.path().join("file"), "").unwrap();
    refused(&["probe", run, "--out", "file/new"], 1, &["file is a file"]);
    refused(&["probe", run, "--horizons", "0", "--out", "new"], 2, &["0", "--horizons"]);
    refused(
        &["probe", run, "--fit", "gradient-descent", "--penalty", "1", "--out", "new"],
        2,
        &["--penalty applies only to --fit ridge"],
    );
    for command in ["analyze-comm", "attention"] {
        refused(&[command, run, "--checkpoint", "7", "--out", "new"], 1, &["available: 0, 240"]);
        refused(&[command, run, "--out", "file"], 1, &["file"]);
    }
    refused(&["probe", run, "--out", "first"], 1, &["first", "not empty", "--out"]);
    refused(
        &["probe", run, "--checkpoints", "7", "--out", "new"],
        1,
        &["step 7", "available: 0, 240"],
    );
    refused(
        &["probe", run, "--horizons", "999", "--out", "new"],
        2,
        &["999", "falling-pixels", "up to"],
    );
    refused(
        &["probe", run, "--coordinates", "column", "--out", "new"],
        2,
        &["column", "agent_column, pixel_row.0"],
    );
    refused(&["probe", run, "--policy", "nowhere", "--out", "new"], 1, &["nowhere", "--policy"]);
    refused(&["probe", run, "--distractors", "color-easy", "--out", "new"], 2, &["falling-pixels"]);
    refused(&["probe", run, "--penalty=-1", "--out", "new"], 2, &["--penalty -1"]);
    refused(&["probe", "nowhere", "--out", "new"], 1, &["nowhere"]);
    fs::remove_dir_all(silent.join("checkpoints")).unwrap();
    refused(&["probe", text(&silent), "--out", "new"], 1, &["has no checkpoint"]);
}

#[test]
fn a_policy_and_other_coordinates_can_be_named() {
    let folder = tempfile::tempdir().unwrap();
    done(folder.path(), &train_arguments(folder.path(), &["falling-pixels"]));
    let run = run_folder(folder.path(), "falling-pixels");
    let run = text(&run);
    let few = ["--train-episodes", "2", "--test-episodes", "1", "--horizons", "2", "--policy", run];
    let more = ["--coordinates", "agent_column,pixel_row.3", "--fit", "gradient-descent"];
    let arguments = [&["probe", run], &few[..], &more].concat();
    done(folder.path(), &small(&arguments));
    let found = rows_of(&folder.path().join("probe/probe.csv"));
    assert_eq!(found.len(), 4);
    let whole = json(&folder.path().join("probe/probe.json"));
    assert_eq!(whole["results"][0]["mse_by_coordinate"].as_array().unwrap().len(), 2);
    assert_eq!(whole["settings"]["policy"]["run"], run);
    assert_eq!(whole["settings"]["policy"]["environment_step"], 480);
    // Random actions lead elsewhere. The folder is a new one; a run named twice is one; the last checkpoint is taken for
    // those that are not there.
    let more = ["--coordinates", "agent_column,pixel_row.3", "--fit", "gradient-descent"];
    let few = ["--train-episodes", "2", "--test-episodes", "1", "--horizons", "2,2"];
    let printed = done(folder.path(), &small(&[&["probe", run, run], &few[..], &more].concat()));
    assert!(
        printed.contains("no checkpoint at 50,000 or 100,000: using the last one"),
        "{printed}"
    );
    let random = rows_of(&folder.path().join("probe-2/probe.csv"));
    assert_eq!(random.len(), 4);
    assert!(random[0]["constant_mse"] != found[0]["constant_mse"]);

    // Another seed under other settings is no repetition of the first, which is said.
    let elsewhere = folder.path().join("elsewhere");
    let other = ["falling-pixels", "--seed", "2", "--set", "sac.batch_size=9"];
    done(folder.path(), &train_arguments(&elsewhere, &other));
    let other = elsewhere.join("falling-pixels/hksl-debug/seed-2");
    let few = ["--train-episodes", "1", "--test-episodes", "1", "--horizons", "2"];
    let printed = done(folder.path(), &small(&[&["probe", run, text(&other)], &few[..]].concat()));
    assert!(printed.contains("do not have the same settings (sac.batch_size)"), "{printed}");
    // A policy acts where it was trained.
    let arguments = ["cartpole-swingup", "--environment-steps", "8"];
    done(folder.path(), &train_arguments(folder.path(), &arguments));
    let cart = run_folder(folder.path(), "cartpole-swingup");
    let ended = hksl(folder.path(), &small(&["probe", run, "--policy", text(&cart)]));
    assert_eq!(ended.code, 2, "{}", ended.err);
    assert!(ended.err.contains("was trained on cartpole-swingup"), "{}", ended.err);
}

#[test]
fn channels_of_every_pair_of_levels() {
    let folder = tempfile::tempdir().unwrap();
    let (full, silent) = runs(folder.path());
    let few = ["--episodes", "2", "--trajectories", "12", "--projected", "5"];
    let arguments = [&["analyze-comm", text(&full)], &few[..]].concat();
    let printed = done(folder.path(), &small(&arguments));
    assert!(
        printed.contains("from level 3 to level 2") && printed.contains("silhouette"),
        "{printed}"
    );
    let out = folder.path().join("analyze-comm");
    let summary = json(&out.join("summary.json"));
    assert_eq!(summary["channels"].as_array().unwrap().len(), 2);
    for channel in summary["channels"].as_array().unwrap() {
        let name = format!("{}-to-{}", channel["from_level"], channel["to_level"]);
        let matrix = channel["distances"].as_array().unwrap();
        let cells = rows_of(&out.join(format!("distances-{name}.csv")));
        assert_eq!(cells.len(), matrix.len() * matrix.len());
        for cell in &cells {
            let (one, other) = (number(cell, "step"), number(cell, "other_step"));
            let distance = number(cell, "mean_distance");
            assert_eq!(matrix[one as usize - 1][other as usize - 1], distance);
            assert_eq!(distance == 0.0, one == other, "{cell:?}");
        }
        let points = rows_of(&out.join(format!("pca-{name}.csv")));
        assert_eq!(points.len(), 5 * matrix.len());
        let ratios = channel["explained_variance_ratio"].as_array().unwrap();
        let total: f64 = ratios.iter().map(|ratio| ratio.as_f64().unwrap()).sum();
        assert!(total > 0.0 && total <= 1.0 + 1e-12);
        for picture in ["distances", "distances-by-difference", "pca"] {
            let svg = fs::read_to_string(out.join(format!("{picture}-{name}.svg"))).unwrap();
            assert!(svg.contains("to level"), "{picture}-{name}");
        }
    }
    // The same again, to the byte.
    done(folder.path(), &small(&[&arguments[..], &["--out", "again"]].concat()));
    let files = |out: &Path| -> BTreeSet<PathBuf> {
        fs::read_dir(out).unwrap().map(|file| file.unwrap().path()).collect()
    };
    for file in files(&out) {
        let again = folder.path().join("again").join(file.file_name().unwrap());
        assert!(fs::read(&file).unwrap() == fs::read(again).unwrap(), "{}", file.display());
    }
    // More trajectories than there are: all of them, and it says so.
    let many = ["--episodes", "1", "--trajectories", "100000"];
    let printed =
        done(folder.path(), &small(&[&["analyze-comm", text(&full)], &many[..]].concat()));
    assert!(printed.contains("fewer than the 100000 requested"), "{printed}");

    let ended = hksl(folder.path(), &small(&["analyze-comm", text(&silent), "--out", "new"]));
    assert_eq!(ended.code, 1);
    assert!(ended.err.contains("no-c") && ended.err.contains("no communication"), "{}", ended.err);
    assert!(!folder.path().join("new").exists());
}

#[test]
fn channels_that_nothing_trained_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let few = ["--episodes", "2", "--trajectories", "12", "--projected", "5"];
    let run = |ablation: &str| {
        done(
            folder.path(),
            &train_arguments(folder.path(), &["falling-pixels", "--ablation", ablation]),
        );
        folder.path().join(format!("falling-pixels/hksl-{ablation}-debug/seed-1"))
    };
    let look = |run: &Path, out: &str, more: &[&str]| {
        let arguments = [&["analyze-comm", text(run), "--out", out], &few[..], more].concat();
        done(folder.path(), &small(&arguments))
    };
    let summary = |out: &str| json(&folder.path().join(out).join("summary.json"));

    let untrained = run("no-repr");
    let printed = look(&untrained, "no-repr", &[]);
    assert!(printed.contains("ablation no-repr") && printed.contains("are untrained"), "{printed}");
    assert_eq!(summary("no-repr")["channels_trained"], false);

    // Four levels: the highest take one step in a trajectory, and one cannot be apart from itself.
    let four = run("h4");
    let printed = look(&four, "four", &[]);
    assert!(!printed.contains("are untrained"), "{printed}");
    let found = summary("four");
    assert_eq!(
        (&found["channels_trained"], found["channels"].as_array().unwrap().len()),
        (&true.into(), 3)
    );
    let single = |channel: &&Value| channel["distances"].as_array().unwrap().len() == 1;
    for channel in found["channels"].as_array().unwrap().iter().filter(single) {
        assert!(channel["silhouette"].is_null(), "{channel}");
    }
    let printed = look(&four, "before", &["--checkpoint", "0"]);
    assert!(printed.contains("learning had not started at this step"), "{printed}");
    assert_eq!(summary("before")["channels_trained"], false);

    let alone = run("h1");
    let ended = hksl(folder.path(), &small(&["analyze-comm", text(&alone), "--out", "new"]));
    assert_eq!(ended.code, 1);
    assert!(ended.err.contains("a single level"), "{}", ended.err);
}

#[test]
fn attention_shows_frames_and_maps() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [&["cartpole-swingup"], &PLAIN_RENDERING[..]].concat();
    done(folder.path(), &train_arguments(folder.path(), &arguments));
    let run = run_folder(folder.path(), "cartpole-swingup");
    let arguments = ["attention", text(&run), "--steps", "0,5"];
    done(folder.path(), &small(&arguments));
    let out = folder.path().join("attention");
    let summary = json(&out.join("summary.json"));
    let (steps, encoders) = (summary["agent_steps"].as_u64().unwrap(), &summary["encoders"]);
    assert_eq!(encoders.as_array().unwrap().len(), 2);
    let maps = rows_of(&out.join("maps.csv"));
    let height = encoders[0]["map"][0].as_u64().unwrap();
    assert_eq!(maps.len() as u64, 2 * (steps + 1) * height);
    let smallest = maps.iter().filter(|row| row["encoder"] == "level 1").flat_map(|row| {
        row.iter()
            .filter(|(name, _)| name.starts_with("column_"))
            .map(|(_, value)| value.parse::<f64>().unwrap())
    });
    let smallest = smallest.fold(f64::INFINITY, f64::min);
    assert!((smallest - encoders[0]["smallest"].as_f64().unwrap()).abs() < 1e-6);
    for step in [0, 5] {
        let file = fs::File::open(out.join(format!("step-{step:06}.png"))).unwrap();
        let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let size = reader.next_frame(&mut pixels).unwrap();
        // Rows: three frames, two maps, two overlays; the newest frame is not the one before it, but at the start.
        let (width, third) = (size.width as usize, size.height as usize / 3);
        let tile = |line: usize, column: usize| -> Vec<u8> {
            let left = 8 + column * (width - 8) / 3 + 20;
            let rows = line * third + 60..line * third + 200;
            rows.flat_map(|row| pixels[3 * (row * width + left)..][..3 * 200].to_vec()).collect()
        };
        assert_eq!(tile(0, 1) == tile(0, 2), step == 0);
        let shades = tile(1, 0).into_iter().collect::<std::collections::BTreeSet<u8>>();
        assert!(shades.len() > 10, "an empty map in step {step}");
        assert!(tile(2, 0) != tile(2, 1) && tile(2, 0) != tile(0, 2));
        assert!(tile(1, 2).iter().all(|&value| value == 255), "a third map of two levels");
    }
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let file = fs::File::open(out.join("episode.gif")).unwrap();
    let mut animation = options.read_info(std::io::BufReader::new(file)).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = animation.read_next_frame().unwrap() {
        frames.push(frame.buffer.to_vec());
    }
    assert_eq!(frames.len() as u64, steps + 1);
    assert!(frames.first() != frames.last());

    // The same again, to the byte.
    done(folder.path(), &small(&[&arguments[..], &["--out", "again"]].concat()));
    for file in ["maps.csv", "step-000005.png", "episode.gif"] {
        let bytes = |out: &Path| fs::read(out.join(file)).unwrap();
        assert!(bytes(&out) == bytes(&folder.path().join("again")), "{file}");
    }

    // Probed where it was trained and elsewhere, side by side.
    let few = ["--train-episodes", "1", "--test-episodes", "1", "--horizons", "1"];
    let arguments = [&["probe", text(&run), "--distractors", "color-easy,none"], &few[..]].concat();
    let printed = done(folder.path(), &small(&arguments));
    assert!(printed.contains("color-easy (transfer from none)"), "{printed}");
    let found = rows_of(&folder.path().join("probe/probe.csv"));
    let transfer = |name: &str| found.iter().filter(|row| row["transfer"] == name).count();
    assert_eq!((transfer("true"), transfer("false")), (3, 3));
    let picture =
        fs::read_to_string(folder.path().join("probe/probe-cartpole-swingup-480.svg")).unwrap();
    assert!(picture.contains("transfer from none") && picture.contains("m²"));
    let beyond =
        hksl(folder.path(), &small(&["attention", text(&run), "--steps", "9999", "--out", "new"]));
    assert_eq!(beyond.code, 2);
    assert!(
        beyond.err.contains("9999") && beyond.err.contains(&format!("0 to {steps}")),
        "{}",
        beyond.err
    );
}

#[test]
fn a_task_without_coordinates_says_how_to_name_some() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["reacher-easy", "--environment-steps", "8"];
    done(folder.path(), &train_arguments(folder.path(), &arguments));
    let run = run_folder(folder.path(), "reacher-easy");
    let ended = hksl(folder.path(), &small(&["probe", text(&run)]));
    assert_eq!(ended.code, 2, "{}", ended.err);
    assert!(ended.err.contains("--coordinates finger.x,finger.y"), "{}", ended.err);
}
