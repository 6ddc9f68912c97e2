//! What episodes and start states write into a model does not outlive them.

use hksl_envs::dmc::{ControlTask, ModelEdits};
use hksl_envs::rollout::Start;
use hksl_envs::{Environment, Settings};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

fn task(name: &str, seed: u64) -> ControlTask {
    let rng = ChaCha8Rng::seed_from_u64(seed);
    hksl_envs::control_task(name, &Settings::new(84, 84, 1000), rng).unwrap()
}

/// A state of two joints.
fn start(task: &str, model: ModelEdits) -> Start {
    Start {
        task: task.to_owned(),
        qpos: vec![0.25, -0.5],
        qvel: vec![0.0, 0.0],
        qacc_warmstart: None,
        time: 0.0,
        model,
        actions: Vec::new(),
    }
}

/// Each reset of reacher writes a target; a state that names none has the model's own.
#[test]
fn what_an_episode_wrote() {
    let start = start("reacher-easy", ModelEdits::new());
    let [mut fresh, mut used] = [0, 1].map(|seed| task("reacher-easy", seed));
    used.reset().unwrap();
    for task in [&mut fresh, &mut used] {
        task.start(&start).unwrap();
    }
    assert_eq!(used.readings(), fresh.readings());
    let snapshot = fresh.snapshot().unwrap();
    used.reset().unwrap();
    assert_ne!(used.readings(), fresh.readings());
    used.restore(&snapshot).unwrap();
    assert_eq!(used.readings(), fresh.readings());
    assert_eq!(used.snapshot().unwrap(), snapshot);
}

#[test]
fn what_a_start_state_wrote() {
    let damping = [("slider".to_owned(), vec![3.0])].into();
    let start = start("cartpole-swingup", [("dof_damping".to_owned(), damping)].into());
    let mut task = task("cartpole-swingup", 0);
    task.start(&start).unwrap();
    let model = |task: &ControlTask| task.snapshot().unwrap()["physics"]["model"].clone();
    assert_eq!(model(&task)["dof_damping"]["slider"][0], 3.0);
    task.reset().unwrap();
    assert_eq!(model(&task), serde_json::json!({}));
}
