//! Written, read back, set to itself, compared.

use std::path::Path;

use hksl_train::config::{Config, Request, Resolved, tasks};
use proptest::prelude::*;

use super::{request, resolved};

/// The lines `key = value` of a configuration, keys dotted.
fn leaves(resolved: &Resolved) -> Vec<(String, String)> {
    let mut section = String::new();
    let mut leaves = Vec::new();
    for line in resolved.config.to_toml().unwrap().lines() {
        if let Some(name) = line.strip_prefix('[') {
            section = format!("{}.", name.trim_end_matches(']'));
        } else if let Some((name, value)) = line.split_once(" = ") {
            leaves.push((format!("{section}{name}"), value.to_owned()));
        }
    }
    leaves
}

#[test]
fn a_written_configuration_reads_back_unchanged() {
    for task in tasks() {
        let config = resolved(&request(task, &["sac.learning_rate=0.0001234567890123"])).config;
        let text = config.to_toml().unwrap();
        assert_eq!(Config::from_toml(&text, Path::new("config.toml")).unwrap(), config);
    }
}

#[test]
fn a_written_configuration_serves_as_a_users_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("config.toml");
    let config = resolved(&request("cartpole-swingup", &["ablation=h1", "seed=9"])).config;
    std::fs::write(&path, config.to_toml().unwrap()).unwrap();
    let again = resolved(&Request { file: Some(path), ..Request::default() });
    assert_eq!(again.config, config);
}

#[test]
fn every_value_has_an_origin_and_is_printed_with_it() {
    let resolved = resolved(&request("falling-pixels", &["seed=3"]));
    let leaves = leaves(&resolved);
    let keys: Vec<_> = leaves.iter().map(|(key, _)| key.clone()).collect();
    let mut with_origin: Vec<_> = resolved.origins.keys().cloned().collect();
    let mut sorted = keys.clone();
    sorted.sort();
    with_origin.sort();
    assert_eq!(sorted, with_origin);

    let printed = resolved.to_toml_with_origins().unwrap();
    let columns: Vec<_> = printed.lines().filter_map(|line| line.find("  # ")).collect();
    assert_eq!(columns.len(), keys.len());
    let aligned = |line: &str| line.rfind("# ");
    let first = printed.lines().find_map(aligned);
    assert!(printed.lines().filter_map(aligned).all(|column| Some(column) == first));
    assert!(printed.contains("# --set\n"), "{printed}");
    assert!(Config::from_toml(&printed, Path::new("printed")).is_ok());
}

#[test]
fn differences_say_what_may_change_on_resume() {
    let saved = resolved(&request("falling-pixels", &[])).config;
    assert!(saved.difference(&saved).unwrap().is_empty());
    let requested = resolved(&request(
        "falling-pixels",
        &[
            "environment_steps=300000",
            "device=cpu",
            "threads=1",
            "checkpoint.minutes=1",
            "metrics.every_agent_steps=7",
            "seed=2",
            "hksl.skips=[1]",
            "evaluation.episodes=2",
        ],
    ))
    .config;
    let differences = saved.difference(&requested).unwrap();
    let keys = |may_change| -> Vec<_> {
        let chosen = differences.iter().filter(|difference| difference.may_change == may_change);
        chosen.map(|difference| difference.key.as_str()).collect()
    };
    assert_eq!(
        keys(true),
        [
            "checkpoint.minutes",
            "device",
            "environment_steps",
            "metrics.every_agent_steps",
            "threads"
        ]
    );
    assert_eq!(keys(false), ["evaluation.episodes", "hksl.skips", "seed"]);
    let skips = differences.iter().find(|difference| difference.key == "hksl.skips").unwrap();
    assert_eq!((skips.saved.as_str(), skips.requested.as_str()), ("[1, 3, 5]", "[1]"));
}

proptest! {
    /// Setting any values to what they are anyway changes nothing.
    #[test]
    fn setting_a_value_to_itself_changes_nothing(
        task in 0..tasks().len(),
        debug in any::<bool>(),
        chosen in proptest::collection::vec(any::<proptest::sample::Index>(), 1..6),
    ) {
        let mut request = request(tasks()[task], &[]);
        request.presets = if debug { vec!["debug".to_owned()] } else { Vec::new() };
        let before = resolved(&request);
        let leaves = leaves(&before);
        for index in &chosen {
            let (key, value) = index.get(&leaves);
            request.sets.push(format!("{key}={value}"));
        }
        prop_assert_eq!(resolved(&request).config, before.config);
    }

    /// Numbers survive writing and reading to the bit.
    #[test]
    fn numbers_round_trip(rate in 1e-12..1.0f64, minutes in 1e-3..1e5f64, seed in 0..=i64::MAX) {
        let sets = [
            format!("sac.learning_rate={rate:e}"),
            format!("checkpoint.minutes={minutes:?}"),
            format!("seed={seed}"),
        ];
        let sets: Vec<_> = sets.iter().map(String::as_str).collect();
        let config = resolved(&request("falling-pixels", &sets)).config;
        prop_assert_eq!(config.sac.learning_rate.to_bits(), rate.to_bits());
        let text = config.to_toml().unwrap();
        prop_assert_eq!(Config::from_toml(&text, Path::new("config.toml")).unwrap(), config);
    }
}
