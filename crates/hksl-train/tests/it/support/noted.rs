//! Short runs of the training loop in which nothing is learned.

use std::sync::atomic::AtomicBool;

use candle_core::Device;
use hksl_envs::{Environment, Spec};
use hksl_sac::Agent;
use hksl_sac::replay::Layout;
use hksl_train::config::{Config, Request, resolve};
use hksl_train::{Event, Factories, Outcome, Plan, Resume, RunFolder, RunId, train};
use rand_chacha::ChaCha8Rng;

use super::notes::{NoteTaker, NotedDot, SharedNotes, read};

/// Follow the dot, and an agent that takes notes.
pub struct Noted {
    pub notes: SharedNotes,
}

impl Factories for Noted {
    fn environment(&self, _: &Config, rng: ChaCha8Rng) -> hksl_train::Result<Box<dyn Environment>> {
        Ok(Box::new(NotedDot::new(rng, &self.notes)))
    }

    fn agent(&self, config: &Config, spec: &Spec, _: &Device) -> hksl_train::Result<Agent> {
        let frame = [spec.frame.channels, spec.frame.height, spec.frame.width];
        let layout = Layout { frame, stack: 3, action_dims: 1 };
        // The agents before the run's only measure memory.
        let mut notes = read(&self.notes);
        notes.updates.clear();
        notes.batches.clear();
        drop(notes);
        let learner = NoteTaker::new(self.notes.clone(), layout.observation());
        let Config { replay, augmentation, .. } = config;
        Ok(Agent::new(Box::new(learner), layout, replay, augmentation, 1, &Device::Cpu)?)
    }
}

pub fn config(environment_steps: u64) -> Config {
    let sets = [
        &format!("environment_steps={environment_steps}"),
        "environment.action_repeat=1",
        "environment.height=16",
        "environment.width=16",
        "environment.episode_steps=50",
        "training.initial_random_steps=70",
        "evaluation.every_environment_steps=100",
        "evaluation.episodes=2",
        "augmentation.pad=0",
        "checkpoint.weights_every_environment_steps=150",
    ];
    let sets = sets.iter().map(ToString::to_string).collect();
    resolve(&Request { sets, ..Request::default() }).unwrap().config
}

pub fn carry_out(
    config: &Config,
    folder: &RunFolder,
    factories: &dyn Factories,
    stop: &AtomicBool,
    watch: &mut dyn FnMut(&Event),
) -> hksl_train::Result<Outcome> {
    let (device, command, resume) = (Device::Cpu, "test".to_owned(), Resume::Auto);
    train(&Plan { config, folder, factories, device, command, resume, stop }, watch)
}

/// Runs and returns the notes, and the environment steps of all saves.
pub fn run(runs: &std::path::Path, environment_steps: u64) -> (SharedNotes, Vec<u64>, RunFolder) {
    let config = config(environment_steps);
    let notes = SharedNotes::default();
    let factories = Noted { notes: notes.clone() };
    let folder = RunFolder::of(runs, &config, &RunId::default());
    let mut saves = Vec::new();
    let mut watch = |event: &Event| match event {
        Event::Started(summary) => read(&notes).resumed = summary.resumed_at.is_some(),
        Event::Saved { environment_step } => saves.push(*environment_step),
        _ => {}
    };
    carry_out(&config, &folder, &factories, &AtomicBool::new(false), &mut watch).unwrap();
    (notes, saves, folder)
}
