//! `hksl probe`, `analyze-comm` and `attention` on runs of the debug preset.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use hksl_tests::{done, hksl, run_folder, train_arguments};
use serde_json::Value;

/// Two runs on Falling Pixels, full and without communication.
fn runs(folder: &Path) -> (PathBuf, PathBuf) {
    done(folder, &train_arguments(folder, &["falling-pixels"]));
    done(folder, &train_arguments(folder, &["falling-pixels", "--ablation", "no-c"]));
    (run_folder(folder, "falling-pixels"), folder.join("falling-pixels/hksl-no-c-debug/seed-1"))
}

fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<_> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| {
            names.iter().map(|n| (*n).to_owned()).zip(line.split(',').map(str::to_owned)).collect()
        })
        .collect()
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
    let found = rows(&first.join("probe.csv"));
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
    let episodes = rows(&first.join("probe-episodes.csv"));
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
        1,
        &["--penalty is ridge's"],
    );
    for command in ["analyze-comm", "attention"] {
        refused(&[command, run, "--checkpoint", "7", "--out", "new"], 1, &["there are 0, 240"]);
        refused(&[command, run, "--out", "file"], 1, &["file"]);
    }
    refused(&["probe", run, "--out", "first"], 1, &["first", "not empty", "--out"]);
    refused(
        &["probe", run, "--checkpoints", "7", "--out", "new"],
        1,
        &["step 7", "there are 0, 240"],
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
    refused(&["probe", run, "--penalty=-1", "--out", "new"], 1, &["--penalty -1"]);
    refused(&["probe", "nowhere", "--out", "new"], 1, &["nowhere"]);
    fs::remove_dir_all(silent.join("checkpoints")).unwrap();
    refused(&["probe", text(&silent), "--out", "new"], 1, &["no checkpoint", "none yet"]);
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
    let found = rows(&folder.path().join("probe/probe.csv"));
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
        printed.contains("no checkpoint at 50,000 or 100,000: the last one is taken"),
        "{printed}"
    );
    let random = rows(&folder.path().join("probe-2/probe.csv"));
    assert_eq!(random.len(), 4);
    assert!(random[0]["constant_mse"] != found[0]["constant_mse"]);
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
        let cells = rows(&out.join(format!("distances-{name}.csv")));
        assert_eq!(cells.len(), matrix.len() * matrix.len());
        for cell in &cells {
            let (one, other) = (number(cell, "step"), number(cell, "other_step"));
            let distance = number(cell, "mean_distance");
            assert_eq!(matrix[one as usize - 1][other as usize - 1], distance);
            assert_eq!(distance == 0.0, one == other, "{cell:?}");
        }
        let points = rows(&out.join(format!("pca-{name}.csv")));
        assert_eq!(points.len(), 5 * matrix.len());
        let ratios = channel["explained_variance_ratio"].as_array().unwrap();
        let total: f64 = ratios.iter().map(|ratio| ratio.as_f64().unwrap()).sum();
        assert!(total > 0.0 && total <= 1.0 + 1e-12);
        for picture in ["distances", "distances-by-difference", "pca"] {
            let svg = fs::read_to_string(out.join(format!("{picture}-{name}.svg"))).unwrap();
            assert!(svg.contains("to level"), "{picture}-{name}");
        }
    }
    // More trajectories than there are: all of them, and it says so.
    let many = ["--episodes", "1", "--trajectories", "100000"];
    let printed =
        done(folder.path(), &small(&[&["analyze-comm", text(&full)], &many[..]].concat()));
    assert!(printed.contains("fewer than the 100000 asked for"), "{printed}");

    let ended = hksl(folder.path(), &small(&["analyze-comm", text(&silent), "--out", "new"]));
    assert_eq!(ended.code, 1);
    assert!(ended.err.contains("no-c") && ended.err.contains("no communication"), "{}", ended.err);
    assert!(!folder.path().join("new").exists());
}

#[test]
fn attention_shows_frames_and_maps() {
    let folder = tempfile::tempdir().unwrap();
    done(folder.path(), &train_arguments(folder.path(), &["cartpole-swingup"]));
    let run = run_folder(folder.path(), "cartpole-swingup");
    let arguments = ["attention", text(&run), "--steps", "0,5"];
    done(folder.path(), &small(&arguments));
    let out = folder.path().join("attention");
    let summary = json(&out.join("summary.json"));
    let (steps, encoders) = (summary["agent_steps"].as_u64().unwrap(), &summary["encoders"]);
    assert_eq!(encoders.as_array().unwrap().len(), 2);
    let maps = rows(&out.join("maps.csv"));
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

    // Probed where it was trained and elsewhere, side by side.
    let few = ["--train-episodes", "1", "--test-episodes", "1", "--horizons", "1"];
    let arguments = [&["probe", text(&run), "--distractors", "color-easy,none"], &few[..]].concat();
    let printed = done(folder.path(), &small(&arguments));
    assert!(printed.contains("color-easy (transfer from none)"), "{printed}");
    let found = rows(&folder.path().join("probe/probe.csv"));
    let transfer = |name: &str| found.iter().filter(|row| row["transfer"] == name).count();
    assert_eq!((transfer("true"), transfer("false")), (3, 3));
    let picture =
        fs::read_to_string(folder.path().join("probe/probe-cartpole-swingup-480.svg")).unwrap();
    assert!(picture.contains("transfer from none") && picture.contains("m²"));
    let beyond =
        hksl(folder.path(), &small(&["attention", text(&run), "--steps", "9999", "--out", "new"]));
    assert_eq!(beyond.code, 1);
    assert!(
        beyond.err.contains("9999") && beyond.err.contains(&format!("0 to {steps}")),
        "{}",
        beyond.err
    );
}

#[test]
fn a_task_without_coordinates_says_how_to_name_some() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["reacher-easy", "--environment-steps", "4"];
    done(folder.path(), &train_arguments(folder.path(), &arguments));
    let run = run_folder(folder.path(), "reacher-easy");
    let ended = hksl(folder.path(), &small(&["probe", text(&run)]));
    assert_eq!(ended.code, 2, "{}", ended.err);
    assert!(ended.err.contains("--coordinates finger.x,finger.y"), "{}", ended.err);
}
