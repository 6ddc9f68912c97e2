//! `hksl bench`: what it reports, not how fast it is.

use hksl_tests::{done, hksl};
use serde_json::Value;

#[test]
fn a_step_is_reported_phase_by_phase() {
    let folder = tempfile::tempdir().unwrap();
    for (schedule, passes) in [("sequential", 29), ("joint", 22)] {
        let set = format!("hksl.update_schedule={schedule}");
        let options = ["--set", "hksl.skips=[1, 3]", "--set", "hksl.trajectory_length=6"];
        let mut arguments = vec!["bench", "step", "falling-pixels", "--preset", "debug", "--json"];
        arguments.extend(["--set", &set, "--runs", "3", "--batch", "8", "--threads", "1"]);
        arguments.extend(options);
        let report: Value = serde_json::from_str(&done(folder.path(), &arguments)).unwrap();
        let number = |key: &str| report[key].as_f64().unwrap();
        assert_eq!(report["runs"], 3);
        assert_eq!(report["threads"], 1);
        assert_eq!(report["batch"], 8);
        assert_eq!(report["update_schedule"], schedule);
        assert_eq!(report["encoder_passes"], passes);
        assert!(number("parameters") > 0.0, "{report}");
        assert!(0.0 < number("min_s") && number("min_s") <= number("median_s"), "{report}");
        assert!(number("median_s") <= number("max_s"), "{report}");
        assert!(number("gflop_executed") <= number("gflop"), "{report}");
        let phases = report["phases"].as_object().unwrap();
        for phase in ["sample", "augment", "representation", "critics", "actor", "target_networks"]
        {
            assert!(phases.contains_key(phase), "no {phase} in {report}");
        }
        let total: f64 = phases.values().map(|seconds| seconds.as_f64().unwrap()).sum();
        assert!(total <= 1.5 * number("max_s"), "{report}");
    }
}

#[test]
fn frames_are_timed_beside_what_simulates_them() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["bench", "render", "falling-pixels", "--runs", "5", "--json"];
    let report: Value = serde_json::from_str(&done(folder.path(), &arguments)).unwrap();
    assert_eq!(report["runs"], 5);
    assert_eq!(report["frame"], serde_json::json!([1, 43, 23]));
    for phase in ["simulate", "draw"] {
        assert!(report["phases"][phase].as_f64().unwrap() > 0.0, "{report}");
    }
}

#[test]
fn saves_are_measured_and_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let more = ["--preset", "debug", "--transitions", "200", "--json"];
    let arguments = [&["bench", "checkpoint", "falling-pixels"], &more[..]].concat();
    let report: Value = serde_json::from_str(&done(folder.path(), &arguments)).unwrap();
    let save = &report["saves"][0];
    // Whole episodes of 10 steps: twenty, and one more.
    assert_eq!(save["transitions"], 210);
    for number in ["whole_s", "next_s", "load_s", "checkpoint_bytes", "replay_bytes"] {
        assert!(save[number].as_f64().unwrap() > 0.0, "{report}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn nothing_can_be_measured_in_no_runs() {
    let folder = tempfile::tempdir().unwrap();
    for what in ["step", "render"] {
        let ended = hksl(folder.path(), &["bench", what, "falling-pixels", "--runs", "0"]);
        assert_eq!(ended.code, 2, "{}", ended.err);
        assert!(ended.err.contains("--runs") && ended.err.contains('0'), "{}", ended.err);
    }
}
