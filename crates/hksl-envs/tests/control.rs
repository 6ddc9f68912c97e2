//! Cartpole-swingup against what dm_control recorded, and what every environment promises.
#![cfg(feature = "mujoco")]
#![allow(clippy::unwrap_used)] // A test that cannot go on should stop.

use hksl_envs::dmc::{ControlTask, Draws};
use hksl_envs::rollout::{Rollout, Start, play};
use hksl_envs::{Environment, Error, Settings};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Deserialize;
use serde_json::Value;

const SETTINGS: Settings = Settings { height: 84, width: 84, episode_steps: 1000 };
const TOLERANCE: f64 = 1e-12;

#[derive(Deserialize)]
struct Recorded {
    kind: String,
    standard_normals: Option<Vec<f64>>,
    start: Start,
    expected: Rollout,
}

fn fixture() -> Value {
    let text = include_str!("fixtures/cartpole_swingup.json");
    serde_json::from_str(text).unwrap()
}

fn recorded() -> Vec<Recorded> {
    serde_json::from_value(fixture()["trajectories"].clone()).unwrap()
}

fn task(seed: u64) -> ControlTask {
    ControlTask::new("cartpole-swingup", &SETTINGS, ChaCha8Rng::seed_from_u64(seed)).unwrap()
}

fn largest_difference<'a>(
    a: impl IntoIterator<Item = &'a f64>,
    b: impl IntoIterator<Item = &'a f64>,
) -> f64 {
    let (a, b): (Vec<_>, Vec<_>) = (a.into_iter().collect(), b.into_iter().collect());
    assert_eq!(a.len(), b.len());
    a.iter().zip(&b).map(|(a, b)| (**a - **b).abs()).fold(0.0, f64::max)
}

#[test]
fn rollouts_equal_the_recorded_ones() {
    for Recorded { kind, start, expected, .. } in recorded() {
        let got = play(&start).unwrap();
        let differences = [
            ("reward", largest_difference(&got.reward, &expected.reward)),
            ("discount", largest_difference(&got.discount, &expected.discount)),
            ("qpos", largest_difference(got.qpos.iter().flatten(), expected.qpos.iter().flatten())),
            ("qvel", largest_difference(got.qvel.iter().flatten(), expected.qvel.iter().flatten())),
            (
                "probe",
                largest_difference(
                    got.probe.iter().flat_map(|row| row.values().flatten()),
                    expected.probe.iter().flat_map(|row| row.values().flatten()),
                ),
            ),
        ];
        println!("{kind}: {differences:?}");
        let names = |rollout: &Rollout| rollout.probe[0].keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&got), names(&expected));
        for (quantity, difference) in differences {
            assert!(difference <= TOLERANCE, "{kind}: {quantity} off by {difference:e}");
        }
    }
}

/// The draws that a recorded reset took, in order.
struct Replay(std::vec::IntoIter<f64>);

impl Draws for Replay {
    fn standard_normal(&mut self) -> f64 {
        self.0.next().unwrap()
    }
    fn uniform(&mut self, _: f64, _: f64) -> f64 {
        panic!("cartpole's reset takes no uniform draw")
    }
}

#[test]
fn resets_and_steps_equal_the_recorded_ones() {
    let mut seen = 0;
    for Recorded { standard_normals, start, expected, .. } in recorded() {
        let Some(draws) = standard_normals else { continue };
        seen += 1;
        let mut task = task(0);
        let mut replay = Replay(draws.into_iter());
        task.reset_with(&mut replay).unwrap();
        assert_eq!(replay.0.len(), 0, "draws left over");
        assert_eq!((task.qpos(), task.qvel()), (&start.qpos[..], &start.qvel[..]));
        for (index, action) in start.actions.iter().enumerate() {
            let step = task.step(&[action[0] as f32]).unwrap();
            assert!((step.reward - expected.reward[index]).abs() <= TOLERANCE);
            assert!(largest_difference(task.qpos(), &expected.qpos[index]) <= TOLERANCE);
            assert!(largest_difference(task.qvel(), &expected.qvel[index]) <= TOLERANCE);
        }
    }
    assert_eq!(seen, 2);
}

#[test]
fn resets_have_the_recorded_moments() {
    let stats = fixture()["reset_stats"].clone();
    let mut task = task(17);
    let resets = 2000;
    let mut draws: Vec<[Vec<f64>; 2]> = Vec::new();
    for _ in 0..resets {
        task.reset().unwrap();
        draws.push([task.qpos().to_vec(), task.qvel().to_vec()]);
    }
    for (part, name) in ["qpos", "qvel"].into_iter().enumerate() {
        for joint in 0..2 {
            let values: Vec<f64> = draws.iter().map(|draw| draw[part][joint]).collect();
            let mean = values.iter().sum::<f64>() / resets as f64;
            let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / resets as f64;
            let recorded = |moment: &str| stats[name][moment][joint].as_f64().unwrap();
            // 200 recorded resets: their mean deviates by 7e-4, their deviation by 5 %.
            assert!((mean - recorded("mean")).abs() < 3e-3, "{name}[{joint}] mean {mean}");
            let ratio = variance.sqrt() / recorded("std");
            assert!((0.8..1.2).contains(&ratio), "{name}[{joint}] deviation off by {ratio}");
        }
    }
}

/// An action that depends on nothing but the step.
fn action(step: usize) -> [f32; 1] {
    [((step * 7 + 3) % 11) as f32 / 5.0 - 1.0]
}

/// Rewards and positions, as bits, over `steps` steps; resets at the end of episodes.
fn trace(task: &mut ControlTask, steps: usize) -> Vec<u64> {
    let mut bits = Vec::new();
    for step in 0..steps {
        let outcome = task.step(&action(step)).unwrap();
        bits.push(outcome.reward.to_bits());
        bits.extend(task.qpos().iter().chain(task.qvel()).map(|value| value.to_bits()));
        bits.extend(task.readings().iter().flatten().map(|value| value.to_bits()));
        if outcome.last {
            task.reset().unwrap();
        }
    }
    bits
}

#[test]
fn a_restored_snapshot_goes_on_bit_for_bit() {
    let mut original = task(5);
    original.reset().unwrap();
    // At the very start, in mid-episode, and right before the reset at the end of an episode.
    for steps in [0, 333, 666] {
        trace(&mut original, steps);
        let text = original.snapshot().unwrap().to_string();
        let mut copy = task(99);
        copy.restore(&serde_json::from_str(&text).unwrap()).unwrap();
        assert_eq!(copy.readings(), original.readings());
        let mut reference = task(98);
        reference.restore(&original.snapshot().unwrap()).unwrap();
        assert!(trace(&mut copy, 1200) == trace(&mut reference, 1200));
        let ahead = trace(&mut original, 100);
        copy.restore(&serde_json::from_str(&text).unwrap()).unwrap();
        assert!(trace(&mut copy, 100) == ahead, "after {steps} more steps");
    }
}

/// Cartpole's motion does not depend on them, but other tasks' does.
#[test]
fn warm_start_and_time_are_part_of_a_start_and_of_a_snapshot() {
    let mut start = recorded().remove(0).start;
    (start.qacc_warmstart, start.time) = (Some(vec![0.125, -0.375]), 0.625);
    let mut task = task(0);
    task.start(&start).unwrap();
    let mut copy = self::task(1);
    copy.restore(&task.snapshot().unwrap()).unwrap();
    for task in [task, copy] {
        let snapshot = task.snapshot().unwrap();
        let state: Vec<f64> =
            serde_json::from_value(snapshot["physics"]["integration"].clone()).unwrap();
        assert!([0.625, 0.125, -0.375].iter().all(|value| state.contains(value)), "{state:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_episodes_and_another_does_not() {
    let run = |seed| {
        let mut task = task(seed);
        task.reset().unwrap();
        trace(&mut task, 1500)
    };
    assert!(run(3) == run(3));
    assert!(run(3) != run(4));
}

#[test]
fn the_time_limit_ends_an_episode_and_is_not_terminal() {
    let mut task = task(0);
    assert!(matches!(task.step(&[0.0]), Err(Error::NotReset { .. })));
    assert!(matches!(task.frame(), Err(Error::NotReset { .. })));
    task.reset().unwrap();
    for step in 1..=1000 {
        let outcome = task.step(&action(step)).unwrap();
        assert!(!outcome.terminal && (0.0..=1.0).contains(&outcome.reward));
        assert_eq!(outcome.last, step == 1000);
    }
    assert!(matches!(task.step(&[0.0]), Err(Error::EpisodeOver { steps: 1000 })));
}

#[test]
fn faulty_actions_are_named_and_change_nothing() {
    let mut task = task(0);
    task.reset().unwrap();
    let before = task.qpos().to_vec();
    assert!(matches!(task.step(&[]), Err(Error::ActionLength { expected: 1, got: 0 })));
    assert!(matches!(task.step(&[f32::NAN]), Err(Error::ActionNotFinite { index: 0, .. })));
    assert_eq!(task.qpos(), before);
    task.step(&[0.0]).unwrap();
}

#[test]
fn the_first_reading_is_the_cart_and_the_pole_is_half_a_metre_from_it() {
    let mut task = task(0);
    task.reset().unwrap();
    let [cart, pole, tip]: [Vec<f64>; 3] = task.readings().try_into().unwrap();
    assert!((cart[0] - task.qpos()[0]).abs() < 1e-12 && cart[2] == 1.0);
    let angle = task.qpos()[1];
    for (point, length) in [(pole, 0.5), (tip, 1.0)] {
        assert!((point[0] - (cart[0] + length * angle.sin())).abs() < 1e-12);
        assert!((point[2] - (1.0 + length * angle.cos())).abs() < 1e-12);
    }
}

#[test]
fn a_failing_simulation_names_the_warning_and_needs_a_reset() {
    let mut start = recorded().remove(0).start;
    start.qvel = vec![1e11, 0.0];
    match play(&start) {
        Err(Error::Physics { warning, .. }) => assert!(warning.starts_with("BAD"), "{warning}"),
        other => panic!("expected a physics error, got {other:?}"),
    }
    let mut task = task(0);
    task.reset().unwrap();
    task.start(&start).unwrap();
    assert!(matches!(task.step(&[0.0]), Err(Error::Physics { .. })));
    assert!(matches!(task.step(&[0.0]), Err(Error::NotReset { .. })));
    task.reset().unwrap();
    task.step(&[0.0]).unwrap();
}
