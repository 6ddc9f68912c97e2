//! Readers of what a user may hand in, each as one function of any bytes: it may refuse them, but not panic. The
//! fuzz targets in `fuzz/` and the test of their corpora call the same functions.

use std::path::Path;

use hksl_envs::Settings;
use hksl_sac::replay::{Episode, Layout, Replay};
use hksl_train::checkpoint::{RunState, Summary};
use hksl_train::config::{Config, Request, resolve};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// The configuration's resolver: each line is a `--set`, and the whole is a run's `config.toml`.
pub fn configuration(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let path = Path::new("config.toml");
    if let Ok(config) = Config::from_toml(text, path) {
        // What is valid can be written and read back, and gives sizes that can be computed.
        let again = Config::from_toml(&config.to_toml().unwrap(), path).unwrap();
        assert_eq!(config, again);
        assert!(config.budget_agent_steps() <= config.environment_steps);
        let _ = (config.distraction(), config.render_device(), config.task_label());
    }
    let sets = text.lines().map(str::to_owned).collect();
    if let Ok(resolved) = resolve(&Request { sets, ..Request::default() }) {
        assert!(Config::from_toml(&resolved.config.to_toml().unwrap(), path).is_ok());
    }
}

/// A checkpoint: `checkpoint.json`, `run.json` with the environment in it, and tensors.
pub fn checkpoint(bytes: &[u8]) {
    let _ = Summary::from_bytes(Path::new("checkpoint.json"), bytes);
    let _ = hksl_core::from_safetensors(bytes);
    let Ok(state) = serde_json::from_slice::<RunState>(bytes) else { return };
    let settings = Settings::new(35, 15, 80);
    let random = ChaCha8Rng::seed_from_u64(1);
    let Ok(mut environment) = hksl_envs::make("falling-pixels", &settings, random) else { return };
    if environment.restore(&state.environment).is_err() {
        return;
    }
    // A state that was accepted is one to go on from.
    for _ in 0..50 {
        let step = environment.step(&[0.3]);
        if step.as_ref().map_or(true, |step| step.last) {
            break;
        }
        environment.frame().unwrap();
    }
}

/// The file of `hksl rollout --from`, played.
#[cfg(feature = "mujoco")]
pub fn rollout(bytes: &[u8]) {
    use hksl_envs::rollout::{Start, play};
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(start) = Start::parse(text) {
        if start.actions.len() > 50 {
            return;
        }
        let _ = play(&start);
    }
}

/// An episode of a replay, and sampling from it.
pub fn episode(bytes: &[u8]) {
    let layout = Layout { frame: [1, 2, 2], stack: 3, action_dims: 2 };
    let Ok(tensors) = hksl_core::from_safetensors(bytes) else { return };
    let Ok(episode) = Episode::from_tensors(&tensors, &layout) else { return };
    let again = episode.to_tensors(&layout).unwrap();
    assert_eq!(Episode::from_tensors(&again, &layout).unwrap(), episode);
    let mut replay = Replay::new(layout, 1000);
    if replay.restore(vec![episode], None).is_err() {
        return;
    }
    let mut random = ChaCha8Rng::seed_from_u64(1);
    if let Some(starts) = replay.starts(&mut random, 8, 2) {
        let batch = hksl_sac::replay::Sampler::new(1).batch(&replay, &starts, 2, &mut random);
        assert_eq!(batch.rewards.len(), 16);
    }
}
