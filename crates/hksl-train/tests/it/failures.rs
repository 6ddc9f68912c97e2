//! Runs that end by an error: what is said of them, and what stays.

use std::sync::atomic::AtomicBool;

use candle_core::Device;
use hksl_envs::{Environment, Spec};
use hksl_sac::Agent;
use hksl_train::checkpoint::Checkpoints;
use hksl_train::config::Config;
use hksl_train::sweep::{Standing, standing};
use hksl_train::{Error, Factories, RunError, RunFolder, RunId};
use rand_chacha::ChaCha8Rng;

use crate::support::dot::FollowTheDot;
use crate::support::noted::{Noted, carry_out, config, run};
use crate::support::notes::SharedNotes;

/// What goes wrong.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    Physics,
    Reward,
}

/// A run in which this goes wrong, and its end.
fn fail(runs: &std::path::Path, fault: Fault) -> (RunFolder, Error) {
    let config = config(400);
    let notes = SharedNotes::default();
    let factories = FailingFactories(Noted { notes }, fault);
    let folder = RunFolder::of(runs, &config, &RunId::default());
    let never = AtomicBool::new(false);
    let outcome = carry_out(&config, &folder, &factories, &never, &mut |_| {});
    (folder, outcome.err().unwrap())
}

/// Follows the dot until the simulation fails.
struct Failing(FollowTheDot, usize, Fault);

impl Environment for Failing {
    fn spec(&self) -> &Spec {
        self.0.spec()
    }
    fn reset(&mut self) -> Result<(), hksl_envs::Error> {
        self.0.reset()
    }
    fn step(&mut self, action: &[f32]) -> Result<hksl_envs::Step, hksl_envs::Error> {
        self.1 -= 1;
        if self.1 == 0 && self.2 == Fault::Reward {
            return Ok(hksl_envs::Step { reward: f64::NAN, ..self.0.step(action)? });
        }
        if self.1 == 0 {
            return Err(hksl_envs::Error::Physics {
                task: "walker-walk".to_owned(),
                warning: "BADQACC",
                time: 1.5,
                control_step: 60,
                before: Box::new(serde_json::json!({ "task": "walker-walk", "actions": [action] })),
            });
        }
        self.0.step(action)
    }
    fn frame(&mut self) -> Result<ndarray::Array3<u8>, hksl_envs::Error> {
        self.0.frame()
    }
    fn readings(&self) -> Vec<Vec<f64>> {
        self.0.readings()
    }
    fn snapshot(&self) -> Result<serde_json::Value, hksl_envs::Error> {
        self.0.snapshot()
    }
    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), hksl_envs::Error> {
        self.0.restore(snapshot)
    }
}

struct FailingFactories(Noted, Fault);

impl Factories for FailingFactories {
    fn environment(&self, _: &Config, rng: ChaCha8Rng) -> hksl_train::Result<Box<dyn Environment>> {
        Ok(Box::new(Failing(FollowTheDot::new(rng), 170, self.1)))
    }
    fn agent(&self, config: &Config, spec: &Spec, device: &Device) -> hksl_train::Result<Agent> {
        self.0.agent(config, spec, device)
    }
}

#[test]
fn a_reward_that_is_no_number_ends_the_run_with_a_post_mortem() {
    let runs = tempfile::tempdir().unwrap();
    let (folder, error) = fail(runs.path(), Fault::Reward);
    let Error::Run(RunError::NotFinite { quantity, agent_step, post_mortem, .. }) = &error else {
        panic!("{error}");
    };
    assert_eq!((quantity.as_str(), *agent_step), ("reward", 169));
    let text = std::fs::read_to_string(post_mortem).unwrap();
    assert!(text.contains("\"quantity\": \"reward\"") && text.contains("NaN"), "{text}");
    // What was saved before is there.
    assert_eq!(Checkpoints::of_run(&folder).newest().unwrap(), 150);
}

/// An environment that cannot be made, as where models are missing.
struct Nowhere(Noted);

impl Factories for Nowhere {
    fn environment(&self, _: &Config, _: ChaCha8Rng) -> hksl_train::Result<Box<dyn Environment>> {
        let file = "suite/cartpole.xml".to_owned();
        Err(hksl_envs::Error::MissingModel { file, tried: Vec::new() }.into())
    }
    fn agent(&self, config: &Config, spec: &Spec, device: &Device) -> hksl_train::Result<Agent> {
        self.0.agent(config, spec, device)
    }
}

#[test]
fn a_run_that_cannot_begin_has_failed_and_one_that_is_anothers_has_not() {
    let runs = tempfile::tempdir().unwrap();
    let config = config(400);
    let factories = Nowhere(Noted { notes: SharedNotes::default() });
    let folder = RunFolder::of(runs.path(), &config, &RunId::default());
    let begin = || {
        carry_out(&config, &folder, &factories, &AtomicBool::new(false), &mut |_| {}).unwrap_err()
    };
    let lock = folder.lock().unwrap();
    assert!(matches!(begin(), Error::Files(hksl_files::Error::Locked { .. })));
    assert_eq!(folder.failure(), None);
    drop(lock);
    let error = begin();
    assert!(!folder.is_begun());
    assert_eq!(standing(&folder, 400), Standing::Failed { reason: error.to_string() });
    // Once it can, it begins, and the mark is gone.
    let (_, saves, folder) = run(runs.path(), 400);
    assert!(!saves.is_empty());
    assert_eq!(folder.failure(), None);
}

#[test]
fn a_failing_simulation_leaves_the_state_that_it_failed_on() {
    let runs = tempfile::tempdir().unwrap();
    let (folder, error) = fail(runs.path(), Fault::Physics);
    assert!(!error.is_usage());
    let source = std::error::Error::source(&error).unwrap().to_string();
    for word in ["walker-walk", "BADQACC", "control step 60"] {
        assert!(source.contains(word), "no `{word}` in: {source}");
    }
    let file = folder.path().join("physics-failure.json");
    assert!(error.to_string().contains(&file.display().to_string()), "{error}");
    let kept: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    assert_eq!(kept["task"], "walker-walk");
    assert!(!folder.done_file().exists());
}
