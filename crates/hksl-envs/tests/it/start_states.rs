//! What a malformed start state is answered with.

use hksl_envs::rollout::{Start, play};
use serde_json::{Value, json};

fn valid() -> Value {
    json!({
        "task": "cartpole-swingup", "qpos": [0.0, 3.1], "qvel": [0.0, 0.0],
        "qacc_warmstart": [0.0, 0.0], "time": 0.0, "model": {}, "actions": [[0.5], [-0.5]],
    })
}

/// The message for the valid start with one field replaced.
fn message(field: &str, value: Value) -> String {
    let mut start = valid();
    start[field] = value;
    message_of(&start.to_string())
}

fn message_of(text: &str) -> String {
    Start::parse(text).and_then(|start| play(&start)).unwrap_err().to_string()
}

fn assert_names(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "'{message}' lacks '{part}'");
    }
}

#[test]
fn a_valid_start_plays_every_action() {
    let start = Start::parse(&valid().to_string()).unwrap();
    let rollout = play(&start).unwrap();
    assert_eq!((rollout.reward.len(), rollout.qpos.len(), rollout.probe.len()), (2, 2, 2));
    let written = serde_json::to_string(&rollout).unwrap();
    assert_eq!(serde_json::from_str::<hksl_envs::rollout::Steps>(&written).unwrap(), rollout);
}

#[test]
fn warm_start_time_and_model_may_be_left_out() {
    let mut short = valid();
    for field in ["qacc_warmstart", "time", "model"] {
        short.as_object_mut().unwrap().remove(field);
    }
    let short = Start::parse(&short.to_string()).unwrap();
    let full = Start::parse(&valid().to_string()).unwrap();
    assert_eq!(play(&short).unwrap(), play(&full).unwrap());
}

#[test]
fn faults_are_named_with_what_is_expected() {
    assert_names(
        &message("task", json!("cartpole-swing")),
        &["task", "'cartpole-swing'", "cartpole-swingup"],
    );
    assert_names(
        &message("task", json!("falling-pixels")),
        &["falling-pixels", "cartpole-swingup"],
    );
    assert_names(&message("qpos", json!([0.0])), &["qpos", "1 numbers, expected 2"]);
    assert_names(&message("qvel", json!([0.0, 0.0, 0.0])), &["qvel", "3 numbers, expected 2"]);
    assert_names(&message("qacc_warmstart", json!([])), &["qacc_warmstart", "expected 2"]);
    assert_names(&message("actions", json!([[0.1], []])), &["actions[1]", "expected 1"]);
    assert_names(&message("qpos", json!("no")), &["expected a sequence", "line 1"]);
    assert_names(&message("speed", json!(1)), &["speed", "expected one of", "qpos"]);
    assert_names(&message_of("{\"task\": \"cartpole-swingup\"}"), &["missing field `qpos`"]);
    assert_names(&message_of("{"), &["malformed start state", "EOF"]);
    let huge = valid().to_string().replace("3.1", "1e999");
    assert_names(&message_of(&huge), &["number out of range"]);
}

#[test]
fn model_edits_are_checked_and_take_effect() {
    assert_names(&message("model", json!({"mass": {}})), &["model.mass", "dof_damping"]);
    assert_names(
        &message("model", json!({"geom_pos": {"pole_9": [0.0, 0.0, 0.0]}})),
        &["model.geom_pos.pole_9", "no geom"],
    );
    assert_names(
        &message("model", json!({"geom_size": {"pole_1": [0.1]}})),
        &["model.geom_size.pole_1", "1 numbers, expected 3"],
    );
    let mut damped = valid();
    damped["qvel"] = json!([0.0, 2.0]);
    let free = play(&Start::parse(&damped.to_string()).unwrap()).unwrap();
    damped["model"] = json!({"dof_damping": {"hinge_1": [0.5]}});
    let slowed = play(&Start::parse(&damped.to_string()).unwrap()).unwrap();
    assert!(slowed.qvel[1][1].abs() < free.qvel[1][1].abs() - 0.01);
}
