//! `hksl report`: numbers, files, what it leaves out, what it refuses.

use std::fs;

use hksl_report::statistics::{Aggregate, Bootstrap, Scores, aggregate_intervals};
use hksl_tests::synthetic::Synthetic;
use hksl_tests::{done, hksl, rows_of};

const TASKS: [&str; 2] = ["cartpole-swingup", "walker-walk"];

fn cells() -> impl Iterator<Item = Synthetic<'static>> {
    TASKS.into_iter().flat_map(|task| {
        ["none", "color-easy"].into_iter().flat_map(move |distractor| {
            ["hksl", "drq", "curl"].into_iter().flat_map(move |method| {
                (1..=3).map(move |seed| Synthetic {
                    task,
                    distractor,
                    method,
                    seed,
                    ..Synthetic::default()
                })
            })
        })
    })
}

#[test]
fn a_study_becomes_numbers_pictures_and_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    cells().for_each(|run| drop(run.write(&runs)));
    for ablation in ["no-repr", "no-c"] {
        for seed in 1..=3 {
            Synthetic { ablation, seed, ..Synthetic::default() }.write(&runs);
        }
    }
    for (ablation, method) in [("none", "hksl"), ("h1", "hksl"), ("none", "drq")] {
        Synthetic { task: "falling-pixels", ablation, method, ..Synthetic::default() }.write(&runs);
    }
    let said = done(folder.path(), &["report", "runs", "--replicates", "2000"]);
    assert!(said.contains("IQM") && said.contains("report/index.html"), "{said}");
    let report = folder.path().join("report");

    // The aggregates are those of the same scores, computed here.
    let of_task = |task: &str, distractor: &str| -> Vec<f64> {
        let runs = cells()
            .filter(|run| run.task == task && run.distractor == distractor && run.method == "drq");
        runs.map(|run| run.returns()[10] / 1000.0).collect()
    };
    let scores: Vec<(String, Vec<f64>)> = ["none", "color-easy"]
        .into_iter()
        .flat_map(|distractor| {
            TASKS.map(|task| (format!("{task} {distractor}"), of_task(task, distractor)))
        })
        .collect();
    let scores = Scores::new(scores).unwrap();
    let kinds =
        [("IQM", Aggregate::Iqm), ("optimality gap", Aggregate::OptimalityGap { gamma: 1.0 })];
    let rows = rows_of(&report.join("tables/control-methods-aggregates.csv"));
    for (name, kind) in kinds {
        let row =
            rows.iter().find(|row| row["method"] == "drq" && row["aggregate"] == name).unwrap();
        let expected =
            aggregate_intervals(&scores, &[kind], &Bootstrap::drawn(2000, 9, "")).unwrap()[0];
        let number = |column: &str| row[column].parse::<f64>().unwrap();
        assert!((number("point") - expected.point).abs() < 1e-12, "{row:?}");
        assert!((number("low") - expected.low).abs() < 0.01, "{row:?} {expected:?}");
        assert!((number("high") - expected.high).abs() < 0.01, "{row:?} {expected:?}");
    }
    let efficiency = rows_of(&report.join("tables/control-methods-efficiency.csv"));
    assert_eq!(efficiency.len(), 3 * 11);
    let returns = rows_of(&report.join("tables/control-methods-returns-color-easy.csv"));
    assert_eq!(returns.len(), 3 * 2 * 11);
    let ablations = rows_of(&report.join("tables/control-ablations-by-task.csv"));
    assert_eq!(
        ablations.iter().map(|row| row["method"].as_str()).collect::<Vec<_>>(),
        ["hksl", "hksl-no-repr", "hksl-no-c"]
    );
    let levels = rows_of(&report.join("tables/falling-pixels-ablations-efficiency.csv"));
    assert_eq!(levels.len(), 2 * 11);

    // Every figure is there as SVG, PNG and CSV, and on the page, which refers to nothing outside.
    let page = fs::read_to_string(report.join("index.html")).unwrap();
    let mut figures = 0;
    for entry in fs::read_dir(report.join("figures")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let bytes = fs::read(&path).unwrap();
        match path.extension().unwrap().to_str().unwrap() {
            "png" => assert!(bytes.starts_with(b"\x89PNG") && bytes.len() > 3000, "{name}"),
            "svg" => assert!(bytes.starts_with(b"<svg"), "{name}"),
            other => panic!("{other}"),
        }
        figures += 1;
        assert!(page.contains(&format!("<figure id=\"{name}\"")), "{name}");
        assert!(report.join(format!("tables/{name}.csv")).is_file(), "{name}");
    }
    assert!(figures >= 2 * 10, "{figures}");
    assert!(
        !page.contains("http://")
            || page.matches("http://").count() == page.matches("http://www.w3.org/").count()
    );
    for words in [
        "hksl train walker-walk --method drq --seed 3",
        "batch_size",
        "control-methods-aggregates.csv",
    ] {
        assert!(page.contains(words), "no `{words}`");
    }

    // The same again to the byte, and beside the first.
    done(folder.path(), &["report", "runs", "--replicates", "2000"]);
    assert_eq!(fs::read_to_string(folder.path().join("report-2/index.html")).unwrap(), page);
}

#[test]
fn a_partial_study_says_what_it_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    for run in cells() {
        match (run.method, run.task, run.seed) {
            ("curl", "walker-walk", _) | ("drq", "cartpole-swingup", 2) => {}
            ("drq", "walker-walk", 3) => {
                let run = Synthetic { evaluations: 5, ..run }.write(&runs);
                fs::write(run.join("failed"), "the simulation became unstable\n").unwrap();
            }
            _ => drop(run.write(&runs)),
        }
    }
    // Outside of what the study lists.
    Synthetic { task: "falling-pixels", ..Synthetic::default() }.write(&runs);
    fs::write(runs.join("cartpole-swingup/hksl/seed-1/eval.csv"), "agent,task\nhksl,cartpole\n")
        .unwrap();
    let study = "name = \"mine\"\n[[group]]\ntasks = [\"cartpole-swingup\", \"walker-walk\"]\n\
                 methods = [\"hksl\", \"drq\", \"curl\"]\ndistractors = [\"none\", \"color-easy\"]\nseeds = [1, 2, 3]\n";
    fs::write(folder.path().join("mine.toml"), study).unwrap();
    let few = ["report", "runs", "--replicates", "500"];
    for (arguments, out) in
        [(&few[..], "report"), (&[&few[..], &["--study", "mine.toml"]].concat(), "report-2")]
    {
        let said = done(folder.path(), arguments);
        for words in [
            "exclusions and caveats",
            "cartpole-swingup/hksl/seed-1",
            "2 of 27 runs have no evaluation at environment step 100,000",
            "from 2 to 3 complete runs",
            "aggregates exclude curl (no complete run on walker-walk, walker-walk-color-easy)",
            "missing or unfinished: 11 runs",
        ] {
            assert!(said.contains(words), "no `{words}` in: {said}");
        }
        assert_eq!(
            said.contains("1 of 28 runs are not part of the study mine"),
            out == "report-2",
            "{said}"
        );
        let report = folder.path().join(out);
        let missing = fs::read_to_string(report.join("tables/missing.csv")).unwrap();
        for row in [
            "cartpole-swingup,drq,2,no run",
            "walker-walk,curl,1 2 3,no run",
            "walker-walk,drq,3,\"failed, last evaluated at 40,000: the simulation became unstable\"",
            "cartpole-swingup,hksl,1,damaged",
        ] {
            assert!(missing.contains(row), "no `{row}` in: {missing}");
        }
        let page = fs::read_to_string(report.join("index.html")).unwrap();
        assert!(
            page.contains("the simulation became unstable") && page.contains("id=\"left-out\"")
        );
        // The failed run is in the curve of returns as far as it got.
        let returns = rows_of(&report.join("tables/control-methods-returns-undisturbed.csv"));
        let count = |step: &str| {
            let row = returns.iter().find(|row| {
                row["task"] == "walker-walk"
                    && row["method"] == "drq"
                    && row["environment_step"] == step
            });
            row.unwrap()["runs"].clone()
        };
        assert_eq!((count("40000").as_str(), count("50000").as_str()), ("3", "2"));
    }
}

#[test]
fn other_peoples_curves_lie_beside_ours() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 1..=2 {
        Synthetic { seed, ..Synthetic::default() }.write(&folder.path().join("runs"));
    }
    let mut text = ",agent,task,seed,frame,episode_reward,hour\n".to_owned();
    for seed in 1..=2 {
        for index in 0..10 {
            let (frame, value) = (20_000 * index, 90.0 * index as f64 + seed as f64);
            for (agent, task) in [
                ("DrQ-v2", "cartpole_swingup"),
                ("DrQ-v2", "humanoid_walk"),
                ("hksl", "cartpole_swingup"),
            ] {
                text += &format!("{index},{agent},{task},{seed},{frame},{value},0.5\n");
            }
        }
    }
    fs::write(folder.path().join("theirs.csv"), text).unwrap();
    let refused = hksl(folder.path(), &["report", "runs", "theirs.csv"]);
    assert!(refused.err.contains("--every STEPS") && refused.code == 2, "{}", refused.err);
    for (sources, every, way_out) in [
        (&["runs", "theirs.csv"][..], "30000", "--every STEPS"),
        (&["runs", "theirs.csv"], "60000", "choose --at 60000, or another --every"),
        (&["runs"], "7", "--at 70000, or another --every"),
        (&["runs"], "11", "choose another --every"),
    ] {
        let refused = hksl(folder.path(), &[&["report"], sources, &["--every", every]].concat());
        assert!(refused.err.contains(way_out) && refused.code == 2, "{}", refused.err);
    }
    let options = ["report", "runs", "theirs.csv", "--every", "20000", "--replicates", "500"];
    let said = done(folder.path(), &options);
    assert!(said.contains("unknown task: humanoid_walk"), "{said}");
    let rows = rows_of(&folder.path().join("report/tables/scores.csv"));
    // At our budget, and their hksl apart from ours.
    let of = |method: &str| {
        let row = rows.iter().find(|row| row["method"] == method).unwrap();
        (row["mean_return"].clone(), row["runs"].clone())
    };
    for theirs in ["DrQ-v2", "hksl (theirs.csv)"] {
        assert_eq!(of(theirs), ("451.5".to_owned(), "2".to_owned()), "{theirs}");
    }
    assert_eq!(of("hksl").1, "2");
    // A run's numbers alone are enough, too.
    fs::create_dir(folder.path().join("numbers")).unwrap();
    let kept = folder.path().join("runs/cartpole-swingup/hksl/seed-1/eval.csv");
    fs::copy(kept, folder.path().join("numbers/first.csv")).unwrap();
    let said =
        done(folder.path(), &["report", "numbers", "--out", "second", "--replicates", "500"]);
    assert!(said.starts_with("1 run;") && said.contains("have a single run per task"), "{said}");
}

#[test]
fn what_is_not_a_runs_own_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    let paths: Vec<_> =
        (1..=4).map(|seed| Synthetic { seed, ..Synthetic::default() }.write(&runs)).collect();
    // Another run's evaluations, a task that there is not, a return that is none, evaluations cut off.
    let other = Synthetic { seed: 9, method: "drq", ..Synthetic::default() }
        .write(&folder.path().join("other"));
    fs::copy(other.join("eval.csv"), paths[0].join("eval.csv")).unwrap();
    let config = fs::read_to_string(paths[1].join("config.toml")).unwrap();
    fs::write(paths[1].join("config.toml"), config.replace("cartpole-swingup", "chess")).unwrap();
    let config = fs::read_to_string(paths[3].join("config.toml")).unwrap();
    let smaller = config.replace("batch_size = 128", "batch_size = 64");
    assert_ne!(smaller, config);
    fs::write(paths[3].join("config.toml"), smaller).unwrap();
    let rows = fs::read_to_string(paths[2].join("eval.csv")).unwrap();
    let cut: Vec<&str> = rows.lines().take(6).collect();
    fs::write(paths[2].join("eval.csv"), cut.join("\n")).unwrap();
    fs::write(
        runs.join("broken.csv"),
        "agent,task,seed,frame,episode_reward\na,cartpole_swingup,1,0,nan\n",
    )
    .unwrap();
    fs::write(runs.join("nearly.csv"), "agent,task,seed,frame,reward\n").unwrap();
    fs::write(runs.join("other.csv"), "a,b\n").unwrap();
    let said = done(folder.path(), &["report", "runs", "--replicates", "500"]);
    for words in [
        "it records drq on cartpole-swingup, seed 9",
        "chess",
        "1 of 2 runs have no evaluation",
        "the runs of hksl on cartpole-swingup do not have the same settings (sac.batch_size)",
        "broken.csv",
        "it lacks the column episode_reward",
        "have a single run per task",
    ] {
        assert!(said.contains(words), "no `{words}` in: {said}");
    }
    assert!(said.contains("skipped files without runs or curves: other.csv"), "{said}");
    let missing = fs::read_to_string(folder.path().join("report/tables/missing.csv")).unwrap();
    assert!(
        missing.contains("cartpole-swingup,hksl,3,\"done, last evaluated at 40,000\""),
        "{missing}"
    );
    let aggregates =
        fs::read_to_string(folder.path().join("report/tables/aggregates.csv")).unwrap();
    assert!(aggregates.contains("control-methods,hksl,100000,IQM,"), "{aggregates}");
    // Where nothing is left, the reasons are what is said.
    let refused = hksl(folder.path(), &["report", paths[1].to_str().unwrap()]);
    assert!(refused.code == 2 && refused.err.contains("chess"), "{}", refused.err);
    // Where none has come far enough, it is said how far all have.
    for (seed, evaluations) in [(1, 5), (2, 3)] {
        Synthetic { seed, evaluations, ..Synthetic::default() }.write(&folder.path().join("young"));
    }
    let young = ["report", "young", "--replicates", "500", "--out"];
    let said = done(folder.path(), &[&young[..], &["young-1"]].concat());
    assert!(said.contains("all runs have evaluations up to 20,000: use --at 20000"), "{said}");
    Synthetic { seed: 3, evaluations: 1, ..Synthetic::default() }
        .write(&folder.path().join("young"));
    let said = done(folder.path(), &[&young[..], &["young-2"]].concat());
    assert!(
        said.contains("no evaluation after the start of learning") && !said.contains("--at 0"),
        "{said}"
    );
    // Between two evaluations there is nothing to compare.
    let said = done(folder.path(), &["report", "runs", "--at", "55000", "--replicates", "500"]);
    assert!(said.contains("the nearest evaluations are at 50,000 and 60,000"), "{said}");
}

#[test]
fn what_cannot_be_compared_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let refused = |arguments: &[&str], code: i32, words: &[&str]| {
        let ended = hksl(path, &[&["report"], arguments].concat());
        assert_eq!(ended.code, code, "{arguments:?}: {}{}", ended.out, ended.err);
        for word in words {
            assert!(ended.err.contains(word), "no `{word}` in: {}", ended.err);
        }
        assert!(!path.join("report").exists(), "{arguments:?}");
    };
    fs::create_dir(path.join("empty")).unwrap();
    refused(&["empty"], 2, &["no runs and no CSV files of curves in empty"]);
    refused(&["nowhere"], 1, &["nowhere"]);
    fs::write(path.join("other.csv"), "a,b\n1,2\n").unwrap();
    refused(
        &["other.csv"],
        2,
        &["other.csv", "it lacks agent", "agent, task, seed, frame and episode_reward"],
    );

    Synthetic::default().write(&path.join("one"));
    Synthetic::default().write(&path.join("two"));
    refused(
        &["one", "two"],
        2,
        &["one/cartpole", "two/cartpole", "are both hksl on cartpole-swingup, seed 1"],
    );
    let longer = &["environment_steps=200000", "evaluation.every_environment_steps=20000"];
    Synthetic { seed: 2, sets: longer, ..Synthetic::default() }.write(&path.join("three"));
    refused(&["one", "three"], 2, &["budget of 100000", "200000", "--at 100000"]);
    refused(
        &["one", "three", "--at", "100000"],
        2,
        &["environment step 10000", "three/", "--every"],
    );
    refused(&["one", "--methods", "hksl,drq"], 2, &["no run of method drq", "available: hksl"]);
    refused(
        &["one", "--tasks", "walker-walk"],
        2,
        &["no run of task walker-walk", "available: cartpole-swingup"],
    );
    refused(&["one", "--replicates", "0"], 2, &["from 1 to 1000000"]);
    fs::write(
        path.join("mine.toml"),
        "name = \"x\"\n[[group]]\ntasks = [\"chess\"]\nseeds = [1]\n",
    )
    .unwrap();
    refused(&["one", "--study", "mine.toml"], 2, &["mine.toml", "unknown task `chess`"]);
    fs::create_dir(path.join("full")).unwrap();
    fs::write(path.join("full/file"), "").unwrap();
    refused(&["one", "--out", "full"], 1, &["full is not empty"]);
}

/// As pandas, a spreadsheet and an editor on Windows leave them.
#[test]
fn evaluations_are_read_however_they_were_saved() {
    let folder = tempfile::tempdir().unwrap();
    let run = Synthetic::default().write(&folder.path().join("runs"));
    let text = fs::read_to_string(run.join("eval.csv")).unwrap();
    let per_line = |change: &dyn Fn(usize, &str) -> String| -> String {
        text.lines().enumerate().map(|(index, line)| change(index, line) + "\n").collect()
    };
    let row_number = |index: usize| match index {
        0 => String::new(),
        index => (index - 1).to_string(),
    };
    let forms = [
        per_line(&|index, line| format!("{},{line}", row_number(index))),
        per_line(&|index, line| format!("{line},{}", if index == 0 { "note" } else { "good" })),
        text.replace(',', ", "),
        format!("\u{feff}{}", text.replace('\n', "\r\n")),
        text.replace(',', ";"),
        text.replace("none,1,", "none,1.0,"),
    ];
    for (index, form) in forms.iter().enumerate() {
        fs::write(run.join("eval.csv"), form).unwrap();
        fs::create_dir_all(folder.path().join("away")).unwrap();
        fs::write(folder.path().join("away/curve.csv"), form).unwrap();
        for source in ["runs", "away"] {
            let out = format!("{source}-{index}");
            let report = ["report", source, "--replicates", "100", "--out", &out];
            let said = done(folder.path(), &report);
            assert!(said.starts_with("1 run;"), "{form}: {said}");
            let told = said.contains("the column note is ignored");
            assert_eq!(told, index == 1, "{said}");
            let scores = rows_of(&folder.path().join(&out).join("tables/scores.csv"));
            assert_eq!(scores.len(), 1, "{form}");
        }
    }
}

#[test]
fn an_older_versions_run_is_reported_by_its_evaluations() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    let old = Synthetic::default().write(&runs);
    Synthetic { seed: 2, ..Synthetic::default() }.write(&runs);
    let config = fs::read_to_string(old.join("config.toml")).unwrap();
    let config = config.replace("batch_size = 128\n", "").replace("[sac]", "[sac]\nbatch = 128");
    fs::write(old.join("config.toml"), config).unwrap();
    let text = fs::read_to_string(old.join("eval.csv")).unwrap();
    let first_columns = text.lines().map(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        [&cells[..2], &cells[3..6], &cells[7..8]].concat().join(",") + "\n"
    });
    fs::write(old.join("eval.csv"), first_columns.collect::<String>()).unwrap();
    let said = done(folder.path(), &["report", "runs", "--replicates", "100"]);
    assert!(said.starts_with("2 runs;"), "{said}");
    assert!(said.contains("its evaluations are used, but its settings are not shown"), "{said}");
    let scores = rows_of(&folder.path().join("report/tables/scores.csv"));
    assert_eq!(scores[0]["runs"], "2");
    // Where it stands needs no more either.
    let printed = done(folder.path(), &["sweep", "status", "runs"]);
    assert!(!printed.contains("batch"), "{printed}");
}

#[test]
fn files_that_are_passed_over_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    Synthetic::default().write(&runs);
    fs::create_dir_all(runs.join("sweeps/mine/logs")).unwrap();
    fs::write(runs.join("sweeps/mine/logs/a.log"), "").unwrap();
    done(folder.path(), &["report", "runs", "--replicates", "100", "--out", "runs/report"]);
    for name in ["notes.txt", "other.CSV", "curves.json"] {
        fs::write(runs.join(name), "a,b\n1,2\n").unwrap();
    }
    let said = done(folder.path(), &["report", "runs", "--replicates", "100", "--out", "second"]);
    let line = "runs: skipped files without runs or curves: curves.json, notes.txt, other.CSV\n";
    assert!(said.contains(line), "{said}");
}
