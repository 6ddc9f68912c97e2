//! Every task of the Control Suite against what dm_control recorded, and what every environment promises.

use hksl_envs::dmc::{ControlTask, Draws};
use hksl_envs::rollout::{Start, Steps, play};
use hksl_envs::{Environment, Error, Settings};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Deserialize;
use serde_json::Value;

const SETTINGS: Settings = Settings::new(84, 84, 1000);
/// For rewards and readings; states are equal to the bit.
const TOLERANCE: f64 = 1e-12;

#[derive(Deserialize)]
struct Fixture {
    task: String,
    trajectories: Vec<Trajectory>,
    resets: Vec<Reset>,
    reset_stats: Value,
}

#[derive(Deserialize)]
struct Trajectory {
    kind: String,
    start: Start,
    expected: Steps,
}

#[derive(Deserialize)]
struct Reset {
    draws: Vec<Draw>,
    qpos: Vec<f64>,
    qvel: Vec<f64>,
    qacc_warmstart: Vec<f64>,
    time: f64,
    model: Value,
    probe: std::collections::BTreeMap<String, Vec<f64>>,
}

/// One draw that dm_control's reset took.
#[derive(Deserialize)]
#[serde(untagged)]
enum Draw {
    Normal { normal: f64 },
    Uniform { low: f64, high: f64, value: f64 },
}

fn fixtures() -> Vec<Fixture> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/control");
    let mut files: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert_eq!(files.len(), 6);
    let read = |file| serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    files.iter().map(read).collect()
}

fn task(name: &str, seed: u64) -> ControlTask {
    hksl_envs::control_task(name, &SETTINGS, ChaCha8Rng::seed_from_u64(seed)).unwrap()
}

fn cartpole(seed: u64) -> ControlTask {
    task("cartpole-swingup", seed)
}

fn cartpole_start() -> Start {
    let fixture = fixtures().into_iter().find(|fixture| fixture.task == "cartpole-swingup");
    fixture.unwrap().trajectories.remove(0).start
}

fn largest_difference<'a>(
    a: impl IntoIterator<Item = &'a f64>,
    b: impl IntoIterator<Item = &'a f64>,
) -> f64 {
    let (a, b): (Vec<_>, Vec<_>) = (a.into_iter().collect(), b.into_iter().collect());
    assert_eq!(a.len(), b.len());
    let difference = |(a, b): (&&f64, &&f64)| {
        let difference = (**a - **b).abs();
        assert!(difference.is_finite(), "{a} against {b}"); // A maximum passes over NaN.
        difference
    };
    a.iter().zip(&b).map(difference).fold(0.0, f64::max)
}

#[test]
fn rollouts_equal_the_recorded_ones() {
    for Fixture { task, trajectories, .. } in fixtures() {
        for Trajectory { kind, start, expected } in trajectories {
            let got = play(&start).unwrap();
            assert_eq!((&got.qpos, &got.qvel), (&expected.qpos, &expected.qvel), "{task} {kind}");
            let readings = |rollout: &Steps| -> Vec<f64> {
                rollout.probe.iter().flat_map(|row| row.values().flatten().copied()).collect()
            };
            let names = |rollout: &Steps| rollout.probe[0].keys().cloned().collect::<Vec<_>>();
            assert_eq!(names(&got), names(&expected));
            for (what, difference) in [
                ("reward", largest_difference(&got.reward, &expected.reward)),
                ("discount", largest_difference(&got.discount, &expected.discount)),
                ("probe", largest_difference(&readings(&got), &readings(&expected))),
            ] {
                assert!(difference <= TOLERANCE, "{task} {kind}: {what} off by {difference:e}");
            }
        }
    }
}

/// The draws that recorded resets took, in order.
struct Replay(std::vec::IntoIter<Draw>);

impl Draws for Replay {
    fn standard_normal(&mut self) -> f64 {
        match self.0.next().unwrap() {
            Draw::Normal { normal } => normal,
            Draw::Uniform { .. } => panic!("dm_control draws a uniform number here"),
        }
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        match self.0.next().unwrap() {
            Draw::Uniform { low: its_low, high: its_high, value } => {
                assert_eq!((low, high), (its_low, its_high));
                value
            }
            Draw::Normal { .. } => panic!("dm_control draws a normal number here"),
        }
    }
}

#[test]
fn the_same_draws_give_the_same_resets() {
    for Fixture { task: name, resets, .. } in fixtures() {
        let mut task = task(&name, 0);
        assert_eq!(resets.len(), 12);
        for reset in resets {
            let mut replay = Replay(reset.draws.into_iter());
            task.reset_with(&mut replay).unwrap();
            assert_eq!(replay.0.len(), 0, "{name}: draws left over");
            assert_eq!((task.qpos(), task.qvel()), (&reset.qpos[..], &reset.qvel[..]), "{name}");
            let snapshot = task.snapshot().unwrap();
            let state: Vec<f64> =
                serde_json::from_value(snapshot["physics"]["integration"].clone()).unwrap();
            assert_eq!(state[0], reset.time, "{name}");
            let warm = |window: &[f64]| window == &reset.qacc_warmstart[..];
            assert!(state.windows(reset.qacc_warmstart.len()).any(warm), "{name}: warm start");
            if reset.model.as_object().unwrap().values().any(|field| field.is_object()) {
                assert_eq!(snapshot["physics"]["model"], reset.model, "{name}");
            }
            let got = task.spec().readings.iter().map(|spec| &*spec.name).zip(task.readings());
            for (reading, numbers) in got {
                let off = largest_difference(&numbers, &reset.probe[reading]);
                assert!(off <= TOLERANCE, "{name}: {reading} off by {off:e}");
            }
            // The next reset must not depend on what came between.
            for _ in 0..3 {
                task.step(&vec![0.25; task.spec().action_dims]).unwrap();
            }
        }
    }
}

#[test]
fn resets_have_the_recorded_moments() {
    for Fixture { task: name, reset_stats: stats, .. } in fixtures() {
        let mut task = task(&name, 17);
        let resets = if name == "cheetah-run" { 400 } else { 2000 };
        let mut draws: Vec<[Vec<f64>; 2]> = Vec::new();
        for _ in 0..resets {
            task.reset().unwrap();
            draws.push([task.qpos().to_vec(), task.qvel().to_vec()]);
        }
        for (part, quantity) in ["qpos", "qvel"].into_iter().enumerate() {
            for joint in 0..draws[0][part].len() {
                let values: Vec<f64> = draws.iter().map(|draw| draw[part][joint]).collect();
                let mean = values.iter().sum::<f64>() / f64::from(resets);
                let variance =
                    values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(resets);
                let recorded = |moment: &str| stats[quantity][moment][joint].as_f64().unwrap();
                let (deviation, expected) = (variance.sqrt(), recorded("std"));
                // 200 recorded resets: their mean is off by 0.07 deviations, five of which pass.
                let off = (mean - recorded("mean")).abs();
                let place = format!("{name} {quantity}[{joint}]");
                assert!(off <= 0.4 * expected + 1e-12, "{place}: mean {mean}");
                assert!(
                    (deviation - expected).abs() <= 0.35 * expected + 1e-12,
                    "{place}: {deviation}"
                );
            }
        }
    }
}

/// An action that depends on nothing but the step and the actuator.
fn action(step: usize, actuators: usize) -> Vec<f32> {
    (0..actuators).map(|i| ((step * 7 + i * 5 + 3) % 11) as f32 / 5.0 - 1.0).collect()
}

/// Rewards and positions, as bits, over `steps` steps; resets at the end of episodes.
fn trace(task: &mut ControlTask, steps: usize) -> Vec<u64> {
    let mut bits = Vec::new();
    for step in 0..steps {
        let outcome = task.step(&action(step, task.spec().action_dims)).unwrap();
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
    for Fixture { task: name, .. } in fixtures() {
        let mut original = task(&name, 5);
        original.reset().unwrap();
        // At the very start, in mid-episode, and right before the reset at the end of an episode.
        for steps in [0, 333, 666] {
            trace(&mut original, steps);
            let text = original.snapshot().unwrap().to_string();
            let mut copy = task(&name, 99);
            copy.restore(&serde_json::from_str(&text).unwrap()).unwrap();
            assert_eq!(copy.readings(), original.readings());
            let mut reference = task(&name, 98);
            reference.restore(&original.snapshot().unwrap()).unwrap();
            assert!(trace(&mut copy, 1200) == trace(&mut reference, 1200));
            let ahead = trace(&mut original, 100);
            copy.restore(&serde_json::from_str(&text).unwrap()).unwrap();
            assert!(trace(&mut copy, 100) == ahead, "{name} after {steps} more steps");
        }
    }
}

/// Cartpole's motion does not depend on them, but other tasks' does.
#[test]
fn warm_start_and_time_are_part_of_a_start_and_of_a_snapshot() {
    let mut start = cartpole_start();
    (start.qacc_warmstart, start.time) = (Some(vec![0.125, -0.375]), 0.625);
    let mut task = cartpole(0);
    task.start(&start).unwrap();
    let mut copy = cartpole(1);
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
    for Fixture { task: name, .. } in fixtures() {
        let run = |seed| {
            let mut task = task(&name, seed);
            task.reset().unwrap();
            trace(&mut task, 1200)
        };
        assert!(run(3) == run(3));
        assert!(run(3) != run(4));
    }
}

#[test]
fn the_time_limit_ends_an_episode_and_is_not_terminal() {
    for Fixture { task: name, .. } in fixtures() {
        let mut task = task(&name, 0);
        let idle = vec![0.0; task.spec().action_dims];
        assert!(matches!(task.step(&idle), Err(Error::NotReset { .. })));
        assert!(matches!(task.frame(), Err(Error::NotReset { .. })));
        task.reset().unwrap();
        for step in 1..=1000 {
            let outcome = task.step(&action(step, idle.len())).unwrap();
            assert!(!outcome.terminal && (0.0..=1.0).contains(&outcome.reward));
            assert_eq!(outcome.last, step == 1000);
        }
        assert!(matches!(task.step(&idle), Err(Error::EpisodeOver { steps: 1000 })));
    }
}

#[test]
fn faulty_actions_are_named_and_change_nothing() {
    let mut task = cartpole(0);
    task.reset().unwrap();
    let before = task.qpos().to_vec();
    assert!(matches!(task.step(&[]), Err(Error::ActionLength { expected: 1, got: 0, .. })));
    assert!(matches!(task.step(&[f32::NAN]), Err(Error::ActionNotFinite { index: 0, .. })));
    assert_eq!(task.qpos(), before);
    task.step(&[0.0]).unwrap();
}

#[test]
fn the_first_reading_is_the_cart_and_the_pole_is_half_a_metre_from_it() {
    let mut task = cartpole(0);
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
    let mut start = cartpole_start();
    start.qvel = vec![1e11, 0.0];
    match play(&start) {
        Err(Error::Physics { warning, .. }) => assert!(warning.starts_with("BAD"), "{warning}"),
        other => panic!("expected a physics error, got {other:?}"),
    }
    let mut task = cartpole(0);
    task.reset().unwrap();
    task.start(&start).unwrap();
    let Err(Error::Physics { control_step: 0, before, .. }) = task.step(&[0.0]) else {
        panic!("expected a physics error")
    };
    // What it tells can be played again, to the same end.
    let again = Start::parse(&before.to_string()).unwrap();
    assert_eq!((&again.qvel, &again.actions), (&start.qvel, &vec![vec![0.0]]));
    assert!(matches!(play(&again), Err(Error::Physics { control_step: 0, .. })));
    assert!(matches!(task.step(&[0.0]), Err(Error::NotReset { .. })));
    task.reset().unwrap();
    task.step(&[0.0]).unwrap();
}

/// Uniformly random actions, each held for the task's action repeat, over a few episodes: within the spread that
/// dm_control's own random policy showed over ten.
#[test]
fn random_policies_earn_what_dm_controls_earn() {
    use rand::Rng;
    // Task, action repeat, and of ten recorded episodes: mean, standard deviation, largest return.
    for (name, repeat, mean, deviation, most) in [
        ("cartpole-swingup", 8, 132.9, 35.1, 182.0),
        ("finger-spin", 2, 1.5, 2.3, 7.0),
        ("reacher-easy", 4, 41.9, 42.5, 115.0),
        ("cheetah-run", 4, 17.1, 5.8, 28.0),
        ("walker-walk", 2, 39.5, 7.3, 51.0),
        ("ball_in_cup-catch", 4, 47.3, 114.7, 387.0),
    ] {
        let (mut task, mut rng) = (task(name, 2), ChaCha8Rng::seed_from_u64(3));
        let episodes = 10;
        let mut returns = 0.0;
        for _ in 0..episodes {
            task.reset().unwrap();
            let mut last = false;
            while !last {
                let action: Vec<f32> =
                    (0..task.spec().action_dims).map(|_| rng.random_range(-1.0..1.0)).collect();
                for _ in 0..repeat {
                    let step = task.step(&action).unwrap();
                    (returns, last) = (returns + step.reward, step.last);
                }
            }
        }
        let got = returns / f64::from(episodes);
        println!("{name}: {got:.1}, recorded {mean} ± {deviation}");
        // Means of ten and ten episodes, whose tails are heavy: three of their joint deviations, or the largest.
        let spread = 3.0 * deviation * (2.0_f64 / 10.0).sqrt();
        assert!((got - mean).abs() <= spread.max(most - mean) && got >= 0.0, "{name}: {got}");
    }
}
