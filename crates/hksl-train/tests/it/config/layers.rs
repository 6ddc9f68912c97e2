//! Precedence, origins, and that every shipped file fits every other.

use std::path::PathBuf;

use hksl_core::nn::Initialisation;
use hksl_sac::Ablation;
use hksl_train::config::{Flag, METHODS, Origin, Request, presets, resolve, tasks};

use super::{assert_words, refusal, request, resolved};

/// A folder with a configuration file in it.
fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("my.toml");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

#[test]
fn each_layer_wins_over_the_ones_before_it() {
    let (_folder, path) = file("[sac]\nbatch_size = 32\n[hksl]\ncommunication = true\n");
    let mut request = request("cartpole-swingup", &[]);
    let batch = |request: &Request| {
        let resolved = resolved(request);
        (resolved.config.sac.batch_size, resolved.origins["sac.batch_size"].clone())
    };
    assert_eq!(batch(&request), (128, Origin::Default));
    request.presets = vec!["debug".into()];
    assert_eq!(batch(&request), (8, Origin::Preset("debug".into())));
    request.file = Some(path.clone());
    assert_eq!(batch(&request), (32, Origin::File(path)));
    request.sets = vec!["sac.batch_size=33".into(), "sac.batch_size=34".into()];
    assert_eq!(batch(&request), (34, Origin::Set));
    request.flags = vec![Flag { key: "sac.batch_size", value: 35.into(), name: "--batch-size" }];
    assert_eq!(batch(&request), (35, Origin::Flag("--batch-size")));
}

#[test]
fn a_task_states_what_belongs_to_it() {
    let pixels = resolved(&Request::default());
    assert_eq!(pixels.config.task, "falling-pixels");
    assert_eq!(pixels.origins["task"], Origin::Default);
    assert_eq!(pixels.config.environment_steps, 200_000);
    assert_eq!(pixels.config.evaluation.every_environment_steps, 2_500);
    assert_eq!((pixels.config.environment.height, pixels.config.environment.width), (35, 15));
    assert_eq!(pixels.config.frame_size(), [43, 23]);
    assert_eq!(pixels.config.hksl.skips, [1, 3, 5]);

    let cartpole = resolved(&request("cartpole-swingup", &[]));
    assert_eq!(cartpole.origins["task"], Origin::Flag("TASK"));
    assert_eq!(cartpole.config.environment_steps, 100_000);
    assert_eq!(cartpole.config.episode_agent_steps(), 125);
    assert_eq!(cartpole.config.budget_agent_steps(), 12_500);
    assert_eq!(cartpole.config.hksl.skips, [1, 3]);
    let origin = &cartpole.origins["environment.action_repeat"];
    assert_eq!(origin.to_string(), "tasks/cartpole-swingup.toml");
}

#[test]
fn an_ablation_stands_above_presets() {
    let mut request = request("cartpole-swingup", &[]);
    request.ablation = Some("no-c".into());
    let ablated = resolved(&request);
    assert!(!ablated.config.hksl.communication);
    assert_eq!(ablated.config.ablation, "no-c");
    assert_eq!(ablated.origins["hksl.communication"], Origin::Ablation("no-c".into()));
    assert_eq!(ablated.origins["hksl.projection"], Origin::Default);

    // What agrees with it may be said; what undoes it would make the run's name a lie.
    request.sets = vec!["hksl.communication=false".into()];
    assert_eq!(resolved(&request).origins["hksl.communication"], Origin::Set);
    request.sets = vec!["hksl.communication=true".into()];
    let said = refusal(&request);
    assert_words(&said, &["`no-c` requires hksl.communication = false", "true by --set", "--name"]);
}

#[test]
fn a_file_of_all_settings_does_not_undo_what_is_asked_for_beside_it() {
    let whole = resolved(&request("cartpole-swingup", &[])).config.to_toml().unwrap();
    let (_folder, path) = file(&whole);
    let plain = Request { file: Some(path.clone()), ..Request::default() };
    assert_eq!(resolved(&plain).config.ablation, "none");
    let with = |ablation: Option<&str>, distractor: Option<&str>| Request {
        ablation: ablation.map(Into::into),
        distractor: distractor.map(Into::into),
        ..plain.clone()
    };
    assert_words(
        &refusal(&with(Some("h1"), None)),
        &["hksl.skips = [1]", "[1, 3] by file", "(--ablation)"],
    );
    let said = refusal(&with(None, Some("color-easy")));
    assert_words(
        &said,
        &["distractors.color.", "0.0", "distractor color-easy (--distractor) has 0."],
    );
    let ablated = resolved(&request("cartpole-swingup", &["ablation=no-c"])).config;
    let (_ablated, path_of_ablated) = file(&ablated.to_toml().unwrap());
    let whole = Request {
        file: Some(path_of_ablated),
        ablation: Some("none".into()),
        ..Request::default()
    };
    let said = refusal(&whole);
    assert_words(&said, &["hksl.communication = false", "ablation none (--ablation) has true"]);
    // A part of a file, and a longer trajectory, are nobody else's.
    let (_part, path_of_part) = file("distractors.color.max_delta = 0.2\n");
    let part = Request {
        file: Some(path_of_part),
        task: Some("cartpole-swingup".into()),
        distractor: Some("color-easy".into()),
        ..Request::default()
    };
    assert_eq!(resolved(&part).config.distractors.color.max_delta, 0.2);
    let longer = ["ablation=h3", "hksl.trajectory_length=10"];
    assert_eq!(resolved(&request("falling-pixels", &longer)).config.hksl.trajectory_length, 10);
    // A run's own file, tuned, is whole again.
    let tuned =
        request("cartpole-swingup", &["distractor=color-easy", "distractors.color.max_delta=0.2"]);
    let tuned = resolved(&tuned).config;
    let (_folder, path) = file(&tuned.to_toml().unwrap());
    let again = Request { file: Some(path), ..Request::default() };
    assert_eq!(resolved(&again).config, tuned);
    let named = Request { distractor: Some("color-easy".into()), ..again };
    assert_eq!(resolved(&named).config, tuned);
}

#[test]
fn the_users_file_may_choose_task_and_ablation() {
    let (_folder, path) = file("task = \"cartpole-swingup\"\nablation = \"h1\"\n");
    let mut request = Request { file: Some(path), ..Request::default() };
    let chosen = resolved(&request);
    assert_eq!(chosen.config.environment.action_repeat, 8);
    assert_eq!(chosen.config.hksl.skips, [1]);
    request.task = Some("falling-pixels".into());
    assert_eq!(resolved(&request).config.environment.action_repeat, 1);
}

#[test]
fn presets_apply_in_order_and_paper_is_the_one_of_a_run_that_names_none() {
    assert_eq!(resolved(&Request::default()).presets, ["paper"]);
    let mut request = request("falling-pixels", &[]);
    request.presets = vec!["debug".into(), "paper".into()];
    let resolved = resolved(&request);
    assert_eq!(resolved.presets, ["debug", "paper"]);
    assert_eq!(resolved.config.sac.batch_size, 8);
}

#[test]
fn every_combination_of_shipped_files_resolves() {
    for (info, task) in hksl_envs::tasks().iter().zip(tasks()) {
        for row in METHODS {
            let method = row.name;
            let dreamer = method == "dreamer-v2";
            for preset in presets().into_iter().filter(|preset| dreamer || *preset != "original") {
                let ablations = match row.has_ablations {
                    true => Ablation::names(info.varies_levels),
                    false => vec!["none"],
                };
                for ablation in ablations {
                    let mut request = request(task, &[]);
                    request.method = Some(method.into());
                    request.presets = vec![preset.into()];
                    request.ablation = Some(ablation.into());
                    let config = resolved(&request).config;
                    assert!(config.budget_agent_steps() > config.training.initial_random_steps);
                }
            }
        }
    }
}

#[test]
fn a_methods_file_may_tell_tasks_apart() {
    for (task, steps) in [
        ("cartpole-swingup", 5000),
        ("walker-walk", 10000),
        ("finger-spin", 0),
        ("falling-pixels", 0),
    ] {
        let method = Some("pi-sac".to_owned());
        let resolved = resolved(&Request { method, ..request(task, &[]) });
        assert_eq!(resolved.config.pi_sac.pretraining_steps, steps, "{task}");
        let origin = &resolved.origins["pi_sac.pretraining_steps"];
        assert_eq!(origin, &Origin::Method("pi-sac".into()));
    }
    // A convolution that reads its centre alone sees none of Falling Pixels' bottom row.
    for method in ["curl", "dbc"] {
        for (task, expected) in [
            ("cartpole-swingup", Initialisation::DeltaOrthogonal),
            ("falling-pixels", Initialisation::Orthogonal),
        ] {
            let request = Request { method: Some(method.to_owned()), ..request(task, &[]) };
            assert_eq!(resolved(&request).config.baseline.initialisation, expected, "{method}");
        }
    }
}

/// What other methods read is not part of a configuration: not printed, not compared, and the same whatever presets say.
#[test]
fn a_configuration_is_its_methods() {
    let drq = |presets: &[&str]| {
        let presets = presets.iter().map(ToString::to_string).collect();
        let method = Some("drq".to_owned());
        resolved(&Request { method, presets, ..request("cartpole-swingup", &[]) })
    };
    let (paper, debug) = (drq(&[]), drq(&["debug"]));
    assert_eq!(paper.config.hksl, debug.config.hksl);
    let text = debug.config.to_toml().unwrap();
    assert!(text.contains("[drq]") && text.contains("[baseline]"), "{text}");
    assert!(!text.contains("[hksl]") && !text.contains("[curl]"), "{text}");
    assert!(!debug.origins.keys().any(|key| key.starts_with("hksl.")));
}

#[test]
fn the_debug_preset_fits_every_action_repeat_and_trajectory_of_the_paper() {
    for (repeat, trajectory_length) in [(1, 6), (2, 3), (2, 6), (4, 3), (4, 6), (4, 10), (8, 6)] {
        let mut request = request(
            "cartpole-swingup",
            &[
                &format!("environment.action_repeat={repeat}"),
                &format!("hksl.trajectory_length={trajectory_length}"),
            ],
        );
        request.presets = vec!["debug".into()];
        resolve(&request).unwrap();
    }
}

#[test]
fn the_registry_and_the_configurations_know_the_same_tasks() {
    let registered: Vec<_> = hksl_envs::tasks().iter().map(|info| info.name).collect();
    assert_eq!(registered, tasks());
    for info in hksl_envs::tasks() {
        let config = resolved(&request(info.name, &[])).config;
        assert_eq!(config.environment.episode_steps, info.control_steps_per_episode);
    }
}

#[test]
fn values_of_inline_tables_are_merged_key_by_key() {
    let resolved = resolved(&request("falling-pixels", &["sac={batch_size=16, discount=1}"]));
    assert_eq!((resolved.config.sac.batch_size, resolved.config.sac.discount), (16, 1.0));
    assert_eq!(resolved.origins["sac.discount"], Origin::Set);
    assert_eq!(resolved.config.sac.hidden_units, 1024);
}
