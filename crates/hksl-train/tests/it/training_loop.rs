//! The training loop with an agent that only takes notes: what it is asked, when, and whether it learns from
//! what it acted on.

use std::sync::atomic::{AtomicBool, Ordering};

use hksl_train::checkpoint::{self, Checkpoints};
use hksl_train::config::{Config, Request, resolve};
use hksl_train::metrics::read_evaluations;
use hksl_train::sweep::{Standing, standing};
use hksl_train::{Ending, Error, Event, Registry, RunError, RunFolder, RunId};

use crate::support::noted::{Noted, carry_out, config, run};
use crate::support::notes::{LENGTH, Sampled, SharedNotes, read};

#[test]
fn acts_learns_evaluates_and_saves_when_it_should() {
    let runs = tempfile::tempdir().unwrap();
    let (notes, saves, folder) = run(runs.path(), 220);
    let notes = read(&notes);
    assert_eq!(notes.actions.len(), 220);
    // Before that, actions are uniform.
    assert_eq!(notes.policy_asked_at, (70..220).collect::<Vec<usize>>());
    assert_eq!(notes.updates, (70..220).collect::<Vec<u64>>());
    let rows = read_evaluations(&folder.eval_file()).unwrap();
    let steps: Vec<u64> = rows.iter().map(|row| row.environment_step).collect();
    // At 0, at each interval, and at the end.
    assert_eq!(steps, [0, 100, 200, 220]);
    assert_eq!(saves, [0, 100, 150, 200, 220]);
    let kept = Checkpoints::of_run(&folder).list().unwrap().sound;
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
    let notes = read(&notes);
    let size = 3 * notes.frames[0].len();
    let mut compared = 0;
    for Sampled { start, observations, actions, rewards } in &notes.batches {
        let first = start.episode * 50 + start.time;
        assert_eq!(actions[..], notes.actions[first..first + LENGTH]);
        for step in 0..LENGTH {
            let sampled = &observations[step * size..(step + 1) * size];
            // The newest three frames, the episode's first in place of those before it.
            let time = first + step;
            let frames = [2, 1, 0].map(|age| (time.saturating_sub(age)).max(start.episode * 50));
            let seen: Vec<u8> = frames.iter().flat_map(|&at| notes.frames[at].clone()).collect();
            assert!(sampled == seen, "step {step} of {start:?}");
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
    let (first, second) = (read(&first), read(&second));
    assert_eq!((first.resumed, second.resumed), (false, true));
    assert_eq!((first.actions.len(), second.actions.len()), (200, 130));
    assert_eq!(second.updates.first(), Some(&200));
    let (third, saves, _) = run(runs.path(), 330);
    assert_eq!(
        (read(&third).actions.len(), saves.len()),
        (0, 0),
        "a finished run has nothing to do"
    );
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
    assert_eq!((read(&again).actions.len(), saves.len()), (0, 0));
    let done = |budget| matches!(standing(&folder, budget), Standing::Done { .. });
    assert!(done(200));
    let refused = |budget: u64| {
        let other = config(budget);
        let factories = Noted { notes: SharedNotes::default() };
        carry_out(&other, &folder, &factories, &AtomicBool::new(false), &mut |_| {}).unwrap_err()
    };
    let (longer, shorter) = (refused(330), refused(100));
    assert!(matches!(longer, Error::Checkpoint(checkpoint::Error::NoState { .. })), "{longer}");
    assert!(matches!(shorter, Error::Run(RunError::SmallerBudget { .. })), "{shorter}");
    assert!(!done(330) && done(200) && !folder.failed_file().exists());
    // What it was to do cannot be read any more.
    std::fs::write(folder.config_file(), "task = ").unwrap();
    let Standing::Failed { reason } = standing(&folder, 200) else { panic!("not failed") };
    assert!(reason.contains("config.toml"), "{reason}");
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
    let second = read(&second);
    assert!(second.resumed && second.actions.len() == 130);
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
    let error = Config::of_run(&folder).unwrap_err();
    assert!(matches!(error, Error::Files(hksl_files::Error::Damaged { .. })), "{error}");
    let facts = folder.path().join("environment.json");
    let by = |name: &str| format!("\"hksl\": \"{name}\"");
    let text = std::fs::read_to_string(&facts).unwrap();
    let other = text.replace(&by(env!("CARGO_PKG_VERSION")), &by("99.0.0"));
    assert_ne!(text, other);
    std::fs::write(&facts, other).unwrap();
    let message = Config::of_run(&folder).unwrap_err().to_string();
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
        let notes = SharedNotes::default();
        let factories = Noted { notes: notes.clone() };
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
        actions.extend(read(&notes).actions.iter().copied());
        if !was_stopped {
            break;
        }
        stops += 1;
    }
    assert!(stops > 10, "{stops}");
    assert!(actions == read(&whole).actions);
    assert_eq!(returns(&stopped), returns(&folder));
}

/// Event files may be turned off and on again between two starts: what they held stays.
#[test]
fn event_files_outlive_a_time_without_them() {
    let runs = tempfile::tempdir().unwrap();
    let mut written = Vec::new();
    for (steps, on) in [(100, true), (160, false), (220, true)] {
        let mut config = config(steps);
        config.metrics.tensorboard = on;
        let factories = Noted { notes: SharedNotes::default() };
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
        "environment_steps=240",
        "checkpoint.weights_every_environment_steps=80",
        "evaluation.every_environment_steps=80",
        // Saves by the clock would come between on a machine that is busy.
        "checkpoint.minutes=1000",
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
    carry_out(&config, &folder, &Registry, &never, &mut watch).unwrap();
    assert_eq!((pretrained, saves), (5, vec![0, 80, 160, 240]));
}
