//! An agent on "follow the dot", through the training loop.

use std::sync::atomic::AtomicBool;

use candle_core::Device;
use hksl_envs::{Environment, Spec};
use hksl_sac::Agent;
use hksl_train::config::{Config, Request, resolve};
use hksl_train::metrics::read_evaluations;
use hksl_train::{Factories, Plan, Resume, RunFolder, RunId, agent, train};
use rand_chacha::ChaCha8Rng;

use super::dot::FollowTheDot;

struct Dot;

impl Factories for Dot {
    fn environment(&self, _: &Config, rng: ChaCha8Rng) -> hksl_train::Result<Box<dyn Environment>> {
        Ok(Box::new(FollowTheDot::new(rng)))
    }

    fn agent(&self, config: &Config, spec: &Spec, device: &Device) -> hksl_train::Result<Agent> {
        agent(config, spec, device)
    }
}

/// The mean returns of 30 episodes at every 250 agent steps, 500 of which are random.
pub fn follow_the_dot(method: &str, seed: u64, agent_steps: u64, more: &[String]) -> Vec<f64> {
    let sets = [
        "environment.action_repeat=1",
        "environment.height=16",
        "environment.width=16",
        "environment.episode_steps=50",
        "training.initial_random_steps=500",
        "encoder.filters=16",
        "augmentation.pad=0",
        "evaluation.every_environment_steps=250",
        "evaluation.episodes=30",
        "device=cpu",
    ];
    let mut sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
    sets.extend([format!("environment_steps={agent_steps}"), format!("seed={seed}")]);
    let small: &[&str] = match method {
        "dreamer-v2" => &[
            "dreamer.batch_sequences=16",
            "dreamer.sequence_length=16",
            "dreamer.deterministic_units=64",
            "dreamer.hidden_units=64",
            "dreamer.variables=8",
            "dreamer.classes=8",
            "dreamer.reward_layers=2",
            "dreamer.reward_units=64",
            "dreamer.behaviour_units=128",
            "dreamer.horizon=8",
        ],
        _ => &["sac.batch_size=64", "sac.hidden_units=128"],
    };
    sets.extend(small.iter().map(ToString::to_string));
    if method == "hksl" {
        sets.extend(["hksl.skips=[1, 3]".to_owned(), "hksl.trajectory_length=6".to_owned()]);
    }
    sets.extend_from_slice(more);
    let method = Some(method.to_owned());
    let config = resolve(&Request { method, sets, ..Request::default() }).unwrap().config;
    let runs = tempfile::tempdir().unwrap();
    let folder = RunFolder::of(runs.path(), &config, &RunId::default());
    let plan = Plan {
        config: &config,
        folder: &folder,
        factories: &Dot,
        device: Device::Cpu,
        command: "follow the dot".to_owned(),
        resume: Resume::Never,
        stop: &AtomicBool::new(false),
    };
    train(&plan, &mut |_| {}).unwrap();
    let rows = read_evaluations(&folder.eval_file()).unwrap();
    rows.iter().map(|row| row.episode_return).collect()
}
