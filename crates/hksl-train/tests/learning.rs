//! The whole agent, through the training loop, must learn a task that the PyTorch reference learns.
#![allow(clippy::unwrap_used)]

#[path = "support/dot.rs"]
mod dot;

use std::sync::atomic::AtomicBool;

use candle_core::Device;
use dot::FollowTheDot;
use hksl_envs::{Environment, Spec};
use hksl_sac::Agent;
use hksl_train::config::{Config, Request, resolve};
use hksl_train::metrics::read_evaluations;
use hksl_train::{Factories, Plan, Resume, RunFolder, RunId, hksl_agent, train};
use rand_chacha::ChaCha8Rng;

struct Dot<'a>(&'a Config);

impl Factories for Dot<'_> {
    fn environment(&self, rng: ChaCha8Rng) -> hksl_train::Result<Box<dyn Environment>> {
        Ok(Box::new(FollowTheDot::new(rng)))
    }

    fn agent(&self, spec: &Spec, device: &Device) -> hksl_train::Result<Box<dyn Agent>> {
        Ok(Box::new(hksl_agent(self.0, spec, device)?))
    }
}

/// The reference goes from 31–35 of 50, untrained, to 45–47 within 1,500 agent steps, 500 of them random.
#[test]
fn hksl_learns_to_follow_the_dot() {
    let sets = [
        "environment_steps=1500",
        "environment.action_repeat=1",
        "environment.height=16",
        "environment.width=16",
        "environment.episode_steps=50",
        "training.initial_random_steps=500",
        "hksl.skips=[1, 3]",
        "hksl.trajectory_length=6",
        "sac.batch_size=64",
        "sac.hidden_units=128",
        "encoder.filters=16",
        "augmentation.pad=0",
        "evaluation.every_environment_steps=250",
        "evaluation.episodes=30",
    ];
    let sets = sets.iter().map(ToString::to_string).collect();
    let config = resolve(&Request { sets, ..Request::default() }).unwrap().config;
    let runs = tempfile::tempdir().unwrap();
    let folder = RunFolder::of(runs.path(), &config, &RunId::default());
    let plan = Plan {
        config: &config,
        folder: &folder,
        factories: &Dot(&config),
        device: Device::Cpu,
        command: "test".to_owned(),
        resume: Resume::Never,
        stop: &AtomicBool::new(false),
    };
    train(&plan, &mut |_| {}).unwrap();
    let rows = read_evaluations(&folder.eval_file()).unwrap();
    let returns: Vec<f64> = rows.iter().map(|row| row.episode_return).collect();
    println!("returns at every 250 agent steps: {returns:.1?}");
    let [untrained, .., a, b, c] = returns[..] else { panic!("too few evaluations: {returns:?}") };
    // The best of three, since a policy that moves every step can be caught in a bad moment.
    let trained = a.max(b).max(c);
    assert!(untrained < 39.0, "the untrained agent is too good: {returns:?}");
    assert!(trained > 41.0, "it has not learnt: {returns:?}");
}
