//! The training loop with an agent that only takes notes: what it is asked, when, and whether it learns from
//! what it acted on.
#![allow(clippy::unwrap_used)]

#[path = "support/dot.rs"]
mod dot;
#[path = "support/notes.rs"]
mod notes;

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};

use candle_core::Device;
use dot::FollowTheDot;
use hksl_core::rng;
use hksl_envs::{Environment, Spec};
use hksl_sac::replay::{Layout, Replay};
use hksl_sac::{Acting, Agent};
use hksl_train::config::{Config, Request, resolve};
use hksl_train::metrics::read_evaluations;
use hksl_train::sweep::{Standing, standing};
use hksl_train::{
    Configured, Ending, Error, Event, Factories, Outcome, Plan, Resume, RunFolder, RunId, train,
};
use notes::{LENGTH, NoteTaker, Notes, Sampled};
use rand_chacha::ChaCha8Rng;

struct Noted<'a> {
    config: &'a Config,
    notes: Rc<RefCell<Notes>>,
}

impl Factories for Noted<'_> {
    fn environment(&self, rng: ChaCha8Rng) -> hksl_train::Result<Box<dyn Environment>> {
        Ok(Box::new(FollowTheDot::new(rng)))
    }

    fn agent(&self, spec: &Spec, _: &Device) -> hksl_train::Result<Box<dyn Agent>> {
        let frame = [spec.frame.channels, spec.frame.height, spec.frame.width];
        let layout = Layout { frame, stack: 3, action_dims: 1 };
        let replay = Replay::new(layout, self.config.replay.capacity);
        let (notes, rng) = (Rc::clone(&self.notes), rng::stream(1, "notes"));
        Ok(Box::new(NoteTaker { notes, replay, rng }))
    }
}

fn config(environment_steps: u64) -> Config {
    let sets = [
        &format!("environment_steps={environment_steps}"),
        "environment.action_repeat=1",
        "environment.height=16",
        "environment.width=16",
        "environment.episode_steps=50",
        "training.initial_random_steps=70",
        "evaluation.every_environment_steps=100",
        "evaluation.episodes=2",
        "checkpoint.weights_every_environment_steps=150",
    ];
    let sets = sets.iter().map(ToString::to_string).collect();
    resolve(&Request { sets, ..Request::default() }).unwrap().config
}

fn carry_out(
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
fn run(runs: &std::path::Path, environment_steps: u64) -> (Notes, Vec<u64>, RunFolder) {
    let config = config(environment_steps);
    let notes = Rc::new(RefCell::new(Notes::default()));
    let factories = Noted { config: &config, notes: Rc::clone(&notes) };
    let folder = RunFolder::of(runs, &config, &RunId::default());
    let mut saves = Vec::new();
    let mut watch = |event: &Event| {
        if let Event::Saved { environment_step } = event {
            saves.push(*environment_step);
        }
    };
    carry_out(&config, &folder, &factories, &AtomicBool::new(false), &mut watch).unwrap();
    drop(factories);
    (Rc::into_inner(notes).unwrap().into_inner(), saves, folder)
}

#[test]
fn acts_learns_evaluates_and_saves_when_it_should() {
    let runs = tempfile::tempdir().unwrap();
    let (notes, saves, folder) = run(runs.path(), 220);
    assert_eq!(notes.acting.len(), 220);
    assert!(notes.acting[..70].iter().all(|&acting| acting == Acting::Uniform));
    assert!(notes.acting[70..].iter().all(|&acting| acting == Acting::Sample));
    assert_eq!(notes.updates, (70..220).collect::<Vec<u64>>());
    let rows = read_evaluations(&folder.eval_file()).unwrap();
    let steps: Vec<u64> = rows.iter().map(|row| row.environment_step).collect();
    // At 0, at each interval, and at the end.
    assert_eq!(steps, [0, 100, 200, 220]);
    assert_eq!(saves, [0, 100, 150, 200, 220]);
    let kept = folder.checkpoints().list().unwrap().sound;
    // By interval 0 and 150, the last two states, and the best evaluation if it is another.
    for step in [0, 150, 200, 220] {
        assert!(kept.contains_key(&step), "{step} is gone: {:?}", kept.keys());
    }
}

/// Every sampled trajectory consists of the very observations, actions and rewards of acting.
#[test]
fn learns_from_what_it_acted_on() {
    let runs = tempfile::tempdir().unwrap();
    let (notes, _, _) = run(runs.path(), 220);
    let size = notes.training_observations[0].len();
    let mut compared = 0;
    for Sampled { start, observations, actions, rewards } in &notes.batches {
        let first = start.episode * 50 + start.time;
        assert_eq!(actions[..], notes.actions[first..first + LENGTH]);
        for step in 0..LENGTH {
            let sampled = &observations[step * size..(step + 1) * size];
            assert!(
                sampled == notes.training_observations[first + step],
                "step {step} of {start:?}"
            );
            compared += 1;
        }
        // The newest frame after each action says where dot and agent are, and with it the reward.
        for (step, reward) in rewards.iter().enumerate() {
            let newest = &observations[(step + 1) * size + 2 * 256..(step + 2) * size];
            let column = |row: usize| (0..16).position(|c| newest[row * 16 + c] == 255).unwrap();
            let expected = 1.0 - column(2).abs_diff(column(13)) as f32 / 15.0;
            assert!((reward - expected).abs() < 1e-6, "{reward} {expected}");
        }
    }
    assert!(compared > 500);
}

#[test]
fn a_longer_budget_loads_once_and_goes_on() {
    let runs = tempfile::tempdir().unwrap();
    let (first, _, _) = run(runs.path(), 200);
    let (second, _, _) = run(runs.path(), 330);
    assert_eq!((first.loads, second.loads), (0, 1));
    assert_eq!((first.acting.len(), second.acting.len()), (200, 130));
    assert_eq!(second.updates.first(), Some(&200));
    let (third, saves, _) = run(runs.path(), 330);
    assert_eq!((third.acting.len(), saves.len()), (0, 0), "a finished run has nothing to do");
}

/// What a finished run needs no more may be removed: it stays finished, and cannot be made longer.
#[test]
fn a_finished_run_without_its_states_stays_finished() {
    let runs = tempfile::tempdir().unwrap();
    let (_, _, folder) = run(runs.path(), 200);
    std::fs::remove_dir_all(folder.path().join("replay")).unwrap();
    for checkpoint in std::fs::read_dir(folder.path().join("checkpoints")).unwrap() {
        let state = checkpoint.unwrap().path().join("state");
        if state.is_dir() {
            std::fs::remove_dir_all(state).unwrap();
        }
    }
    let (again, saves, _) = run(runs.path(), 200);
    assert_eq!((again.acting.len(), saves.len()), (0, 0));
    let done = |budget| matches!(standing(&folder, budget), Standing::Done { .. });
    assert!(done(200));
    let refused = |budget: u64| {
        let other = config(budget);
        let factories = Noted { config: &other, notes: Rc::default() };
        carry_out(&other, &folder, &factories, &AtomicBool::new(false), &mut |_| {}).unwrap_err()
    };
    let (longer, shorter) = (refused(330), refused(100));
    assert!(matches!(longer, Error::NoState { .. }), "{longer}");
    assert!(matches!(shorter, Error::SmallerBudget { .. }), "{shorter}");
    assert!(!done(330) && done(200) && !folder.failed_file().exists());
}

/// Numbers that were lost or changed by another program end no run.
#[test]
fn a_run_goes_on_without_its_numbers() {
    let runs = tempfile::tempdir().unwrap();
    let (_, _, folder) = run(runs.path(), 200);
    std::fs::remove_file(folder.metrics_file()).unwrap();
    let rows = std::fs::read_to_string(folder.eval_file()).unwrap();
    std::fs::write(folder.eval_file(), rows.replace('\n', "\r\n")).unwrap();
    let (second, _, _) = run(runs.path(), 330);
    assert_eq!((second.loads, second.acting.len()), (1, 130));
    let steps: Vec<u64> = read_evaluations(&folder.eval_file())
        .unwrap()
        .iter()
        .map(|row| row.environment_step)
        .collect();
    assert_eq!(steps, [0, 100, 200, 300, 330]);
    assert!(folder.path().join("damaged-eval.csv").is_file() && folder.metrics_file().is_file());
}

#[test]
fn a_run_of_another_version_is_told_so() {
    let runs = tempfile::tempdir().unwrap();
    let (_, _, folder) = run(runs.path(), 100);
    let text = std::fs::read_to_string(folder.config_file()).unwrap();
    std::fs::write(folder.config_file(), text.replace("action_repeat = 1\n", "")).unwrap();
    // By this one it would have been written whole.
    let error = folder.config().unwrap_err();
    assert!(matches!(error, Error::Damaged { .. }), "{error}");
    let facts = folder.path().join("environment.json");
    let by = |name: &str| format!("\"hksl\": \"{name}\"");
    let text = std::fs::read_to_string(&facts).unwrap();
    let other = text.replace(&by(env!("CARGO_PKG_VERSION")), &by("99.0.0"));
    assert_ne!(text, other);
    std::fs::write(&facts, other).unwrap();
    let message = folder.config().unwrap_err().to_string();
    for words in ["written by hksl 99.0.0", "lacks environment.action_repeat"] {
        assert!(message.contains(words), "{message}");
    }
}

/// Whether in an evaluation or between steps, a run that is stopped goes on as if it never had been.
#[test]
fn a_stopped_run_goes_on_where_it_was() {
    let uninterrupted = tempfile::tempdir().unwrap();
    let (whole, _, folder) = run(uninterrupted.path(), 220);
    let returns = |folder: &RunFolder| -> Vec<(u64, f64)> {
        let rows = read_evaluations(&folder.eval_file()).unwrap();
        rows.into_iter().map(|row| (row.environment_step, row.episode_return)).collect()
    };
    let (runs, config) = (tempfile::tempdir().unwrap(), config(220));
    let stopped = RunFolder::of(runs.path(), &config, &RunId::default());
    let (mut actions, mut stops) = (Vec::new(), 0);
    loop {
        let notes = Rc::new(RefCell::new(Notes::default()));
        notes.borrow_mut().actions_before = actions.len();
        let factories = Noted { config: &config, notes: Rc::clone(&notes) };
        let stop = AtomicBool::new(false);
        let mut heard = 0;
        let mut watch = |event: &Event| {
            heard += usize::from(matches!(event, Event::Stepped(_)));
            // Every third time within an evaluation.
            let evaluating = matches!(event, Event::EvaluationEpisode { done: 1, .. });
            if heard == 13 || (evaluating && stops % 3 == 2) {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let outcome = carry_out(&config, &stopped, &factories, &stop, &mut watch).unwrap();
        let was_stopped = outcome.ending == Ending::Stopped;
        assert_eq!(was_stopped, !stopped.done_file().is_file());
        actions.extend(notes.borrow().actions.iter().copied());
        if !was_stopped {
            break;
        }
        stops += 1;
    }
    assert!(stops > 10, "{stops}");
    assert!(actions == whole.actions);
    assert_eq!(returns(&stopped), returns(&folder));
}

#[test]
fn a_reward_that_is_no_number_ends_the_run_with_a_post_mortem() {
    let runs = tempfile::tempdir().unwrap();
    let (folder, error) = fail(runs.path(), Fault::Reward);
    let Error::NotFinite { quantity, agent_step, post_mortem, .. } = &error else {
        panic!("{error}");
    };
    assert_eq!((quantity.as_str(), *agent_step), ("reward", 169));
    let text = std::fs::read_to_string(post_mortem).unwrap();
    assert!(text.contains("\"quantity\": \"reward\"") && text.contains("NaN"), "{text}");
    // What was saved before is there.
    assert_eq!(folder.checkpoints().newest().unwrap(), 150);
}

/// An environment that cannot be made, as where models are missing.
struct Nowhere<'a>(Noted<'a>);

impl Factories for Nowhere<'_> {
    fn environment(&self, _: ChaCha8Rng) -> hksl_train::Result<Box<dyn Environment>> {
        let file = "suite/cartpole.xml".to_owned();
        Err(hksl_envs::Error::MissingModel { file, tried: Vec::new() }.into())
    }
    fn agent(&self, spec: &Spec, device: &Device) -> hksl_train::Result<Box<dyn Agent>> {
        self.0.agent(spec, device)
    }
}

#[test]
fn a_run_that_cannot_begin_has_failed_and_one_that_is_anothers_has_not() {
    let runs = tempfile::tempdir().unwrap();
    let config = config(400);
    let factories = Nowhere(Noted { config: &config, notes: Rc::default() });
    let folder = RunFolder::of(runs.path(), &config, &RunId::default());
    let begin = || {
        carry_out(&config, &folder, &factories, &AtomicBool::new(false), &mut |_| {}).unwrap_err()
    };
    let lock = folder.lock().unwrap();
    assert!(matches!(begin(), Error::Locked { .. }));
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

/// Event files may be turned off and on again between two starts: what they held stays.
#[test]
fn event_files_outlive_a_time_without_them() {
    let runs = tempfile::tempdir().unwrap();
    let mut written = Vec::new();
    for (steps, on) in [(100, true), (160, false), (220, true)] {
        let mut config = config(steps);
        config.metrics.tensorboard = on;
        let factories = Noted { config: &config, notes: Rc::default() };
        let folder = RunFolder::of(runs.path(), &config, &RunId::default());
        carry_out(&config, &folder, &factories, &AtomicBool::new(false), &mut |_| {}).unwrap();
        written.push(std::fs::read(folder.event_file()).unwrap());
    }
    assert_eq!(written[0], written[1]);
    assert!(written[2].len() > written[0].len() && written[2].starts_with(&written[0]));
}

/// The steps of learning before the first agent step that learns all belong to one environment step, here one at which
/// weights are kept.
#[test]
fn pretraining_keeps_weights_once() {
    let runs = tempfile::tempdir().unwrap();
    let sets = [
        "environment_steps=60",
        "environment.episode_steps=20",
        "checkpoint.weights_every_environment_steps=20",
    ];
    let sets = sets.iter().map(ToString::to_string).collect();
    let (method, presets) = (Some("pi-sac".to_owned()), vec!["debug".to_owned()]);
    let request = Request { method, presets, sets, ..Request::default() };
    let config = resolve(&request).unwrap().config;
    assert_eq!(config.training.initial_random_steps, 20);
    let folder = RunFolder::of(runs.path(), &config, &RunId::default());
    let (mut saves, mut pretrained) = (Vec::new(), 0);
    let mut watch = |event: &Event| match event {
        Event::Saved { environment_step } => saves.push(*environment_step),
        Event::Pretrained { .. } => pretrained += 1,
        _ => {}
    };
    let never = AtomicBool::new(false);
    carry_out(&config, &folder, &Configured(&config), &never, &mut watch).unwrap();
    assert_eq!((pretrained, saves), (5, vec![0, 20, 40, 60]));
}

/// What goes wrong.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    Physics,
    Reward,
}

/// A run in which this goes wrong, and its end.
fn fail(runs: &std::path::Path, fault: Fault) -> (RunFolder, Error) {
    let config = config(400);
    let notes = Rc::new(RefCell::new(Notes::default()));
    let factories = FailingFactories(Noted { config: &config, notes }, fault);
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

struct FailingFactories<'a>(Noted<'a>, Fault);

impl Factories for FailingFactories<'_> {
    fn environment(&self, rng: ChaCha8Rng) -> hksl_train::Result<Box<dyn Environment>> {
        Ok(Box::new(Failing(FollowTheDot::new(rng), 170, self.1)))
    }
    fn agent(&self, spec: &Spec, device: &Device) -> hksl_train::Result<Box<dyn Agent>> {
        self.0.agent(spec, device)
    }
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
