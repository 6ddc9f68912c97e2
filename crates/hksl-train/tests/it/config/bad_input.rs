//! Each fault is one message that names the value and what would be valid.

use std::path::Path;

use hksl_train::config::{Config, Error, Request, resolve};

use super::{assert_words, refusal, request, resolved};

#[test]
fn unknown_names_come_with_the_nearest_and_all() {
    let mut bad = request("cartpole-swing-up", &[]);
    assert_words(
        &refusal(&bad),
        &[
            "task `cartpole-swing-up`",
            "(TASK)",
            "did you mean `cartpole-swingup`",
            "falling-pixels",
        ],
    );
    bad = Request { method: Some("hskl".into()), ..Request::default() };
    assert_words(&refusal(&bad), &["method `hskl`", "(--method)", "did you mean `hksl`"]);
    bad = Request { presets: vec!["debgu".into()], ..Request::default() };
    assert_words(&refusal(&bad), &["preset `debgu`", "did you mean `debug`", "paper, debug"]);
    bad = Request { ablation: Some("no-rep".into()), ..Request::default() };
    assert_words(&refusal(&bad), &["ablation `no-rep`", "did you mean `no-repr`", "all-n1", "h4"]);
    bad = request("falling-pixels", &["ablation=none-at-all"]);
    assert_words(&refusal(&bad), &["(--set)", "none-at-all"]);
}

#[test]
fn levels_on_another_task_point_to_the_skips() {
    let mut bad = request("cartpole-swingup", &[]);
    bad.ablation = Some("h4".into());
    assert_words(
        &refusal(&bad),
        &["h4", "falling-pixels", "cartpole-swingup", "--set hksl.skips=[1,3,5]"],
    );
}

#[test]
fn what_belongs_to_another_method_is_refused_with_what_is_valid() {
    let of = |method: &str, sets: &[&str]| Request {
        method: Some(method.into()),
        ..request("cartpole-swingup", sets)
    };
    let message = refusal(&of("drq", &["hksl.skips=[1]"]));
    assert_words(
        &message,
        &["hksl.skips = [1]", "(--set)", "only used by hksl", "drq", "[baseline] and [drq]"],
    );
    let message = refusal(&of("hksl", &["curl.double_encoder_step=false"]));
    assert_words(&message, &["only used by curl", "the method is hksl", "[hksl]"]);
    // What changes nothing is no mistake: a file may hold every key.
    resolve(&of("drq", &["hksl.skips=[1, 3]"])).unwrap();
    let message = refusal(&of("dreamer-v2", &["sac.batch_size=16"]));
    assert_words(
        &message,
        &["sac.batch_size = 16", "by hksl, sac, drq", "dreamer-v2", "[dreamer]"],
    );
    let mut bad = of("drq", &[]);
    bad.presets = vec!["original".into()];
    assert_words(&refusal(&bad), &["preset `original`", "--method dreamer-v2", "drq"]);
    let message = refusal(&of("dreamer-v2", &["dreamer.vision=original"]));
    assert_words(&message, &["dreamer.vision = original", "(--set)", "64×64", "84×84", "shared"]);
    let mut bad = of("curl", &[]);
    bad.ablation = Some("no-c".into());
    assert_words(&refusal(&bad), &["no-c", "(--ablation)", "applies only to method hksl", "curl"]);
}

#[test]
fn unknown_keys_come_with_the_nearest() {
    for (set, key, suggestion) in [
        ("batch_size=3", "`batch_size`", "`sac.batch_size`"),
        ("sac.bach_size=3", "`sac.bach_size`", "`sac.batch_size`"),
        ("hksl={skip=[1]}", "`hksl.skip`", "`hksl.skips`"),
        ("sac.batch_size.more=3", "`sac.batch_size.more`", "`sac.batch_size`"),
        ("sed=3", "`sed`", "`seed`"),
    ] {
        let message = refusal(&request("falling-pixels", &[set]));
        assert_words(&message, &["unknown key", key, "(--set)", "did you mean", suggestion]);
    }
    let message = refusal(&request("falling-pixels", &["qqqqqqqqqqq=3"]));
    assert!(!message.contains("did you mean"), "{message}");
}

#[test]
fn a_users_file_is_held_to_the_same_rules() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("my.toml");
    let mut bad = Request { file: Some(path.clone()), ..Request::default() };
    assert_words(&refusal(&bad), &["my.toml", "cannot read"]);
    for (text, words) in [
        ("[sac]\nbatchsize = 3\n", &["`sac.batchsize`", "my.toml", "`sac.batch_size`"][..]),
        ("seed = \"one\"\n", &["seed", "\"one\"", "my.toml", "expected an integer"]),
        ("seed = 1\nsac = 3\n", &["sac = 3", "my.toml", "a table of keys"]),
        ("seed = 1\n[sac\n", &["my.toml", "not valid TOML", "line 2"]),
        ("[hksl]\nlearning_rate = -1\n", &["hksl.learning_rate", "-1", "my.toml", "above 0"]),
    ] {
        std::fs::write(&path, text).unwrap();
        bad.sets.clear();
        assert_words(&refusal(&bad), words);
    }
}

#[test]
fn wrong_types_and_ranges_name_key_value_origin_and_range() {
    for (set, words) in [
        ("sac.batch_size=many", &["sac.batch_size = \"many\"", "(--set)", "an integer"][..]),
        ("sac.batch_size=1.5", &["sac.batch_size = 1.5", "an integer"]),
        ("hksl.communication=1", &["hksl.communication = 1", "true or false"]),
        ("hksl.skips=3", &["hksl.skips = 3", "a list of integers"]),
        ("seed=-1", &["seed = -1", "(--set)", "at least 0"]),
        ("sac.discount=1.01", &["sac.discount = 1.01", "from 0 to 1"]),
        ("sac.batch_size=0", &["sac.batch_size = 0", "from 1 to"]),
        ("hksl.initialisation=ortogonal", &["\"ortogonal\"", "uniform, orthogonal"]),
        ("device=gpu", &["device = \"gpu\"", "(--set)", "auto, cpu, cuda or cuda:N"]),
        ("sac.batch_size", &["sac.batch_size", "no `=`", "KEY=VALUE"]),
    ] {
        assert_words(&refusal(&request("falling-pixels", &[set])), words);
    }
}

#[test]
fn values_in_conflict_name_both() {
    for (set, words) in [
        ("hksl.skips=[1,7]", &["hksl.skips = [1, 7]", "(--set)", "hksl.trajectory_length = 6"][..]),
        ("environment.width=14", &["environment.width = 14", "84×14", "15×15"]),
        ("environment.height=9", &["environment.height = 9", "9×84", "15×15"]),
        ("environment.border=1001", &["environment.border = 1001", "from 0 to 1000"]),
        ("environment_steps=100001", &["environment_steps = 100001", "100000 or 100008"]),
        ("environment_steps=3", &["environment_steps = 3", "action_repeat = 8", "nearest: 8"]),
        (
            "evaluation.every_environment_steps=2501",
            &["evaluation.every_environment_steps = 2501", "2496 or 2504"],
        ),
        ("environment.episode_steps=40", &["environment.episode_steps = 40", "at least 48"]),
        ("replay.capacity=249", &["replay.capacity = 249", "250"]),
        ("sac.log_std_minimum=2", &["sac.log_std_minimum = 2", "log_std_maximum = 2"]),
    ] {
        let message = refusal(&request("cartpole-swingup", &[set]));
        assert_words(&message, words);
        assert_words(&message, &["(--set)"]);
    }
}

#[cfg(not(feature = "cuda"))]
#[test]
fn cuda_names_its_feature_but_a_saved_configuration_may_be_read_without_it() {
    let message = refusal(&request("falling-pixels", &["device=cuda:1"]));
    assert_words(&message, &["\"cuda:1\"", "--features cuda"]);
    let mut config = resolved(&Request::default()).config;
    config.device = "cuda:1".into();
    let text = config.to_toml().unwrap();
    assert_eq!(Config::from_toml(&text, Path::new("config.toml")).unwrap(), config);
}

#[test]
fn a_saved_configuration_must_be_complete() {
    let text = resolved(&Request::default()).config.to_toml().unwrap();
    // But for what decides no number, which an earlier version may not have known.
    let earlier = text.replace("tensorboard = true\n", "").replace("video = false\n", "");
    assert!(earlier.len() < text.len());
    Config::from_toml(&earlier, Path::new("config.toml")).unwrap();
    // And for what came later and keeps earlier runs as they were.
    let earlier = text.replace("border = 4\n", "").replace("shift_per = \"observation\"\n", "");
    assert!(earlier.len() + 30 < text.len());
    Config::from_toml(&earlier, Path::new("config.toml")).unwrap();
    let text = text.replace("discount = 0.99\n", "");
    let error = Config::from_toml(&text, Path::new("run/config.toml")).unwrap_err();
    assert!(matches!(error, Error::MissingKeys { .. }));
    assert_words(&error.to_string(), &["run/config.toml", "sac.discount"]);
}
