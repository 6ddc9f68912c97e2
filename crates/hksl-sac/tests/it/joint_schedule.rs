//! Compares the joint schedule with its definition: one step of each optimiser, with separate gradients of the
//! representation and the critic losses.

use std::collections::BTreeMap;

use candle_core::{DType, Device, Tensor};
use hksl_core::Encoder;
use hksl_core::nn::{Initialisation, PixelEncoderConfig};
use hksl_core::{Trajectories, rng};
use hksl_sac::Ablation;
use hksl_sac::config::{HkslConfig, SacConfig, UpdateSchedule};
use hksl_sac::hksl::{Architecture, Hksl, Noise, Schedule};
use hksl_sac::{Learner, LearningBatch};
use rand::Rng;

const BATCH: usize = 4;

fn architecture(update_schedule: UpdateSchedule, ablation: &str) -> Architecture {
    let mut architecture = Architecture {
        observation: [3, 18, 17],
        action_dims: 2,
        encoder: PixelEncoderConfig { filters: 5, latent_dims: 6 },
        hksl: HkslConfig {
            skips: vec![1, 3, 3],
            trajectory_length: 6,
            learning_rate: 1e-4,
            actor_update_every: 1,
            update_schedule,
            initialisation: Initialisation::Uniform,
            communication_hidden: 9,
            representation: true,
            communication: true,
            projection: true,
            shared_encoder: false,
        },
        sac: SacConfig {
            batch_size: BATCH,
            learning_rate: 1e-3,
            discount: 0.99,
            initial_temperature: 0.1,
            hidden_units: 16,
            log_std_minimum: -10.0,
            log_std_maximum: 2.0,
            target_update_every: 2,
            critic_tau: 0.01,
            encoder_tau: 0.05,
        },
    };
    Ablation::from_name(ablation, false).unwrap().apply(&mut architecture.hksl);
    architecture
}

fn learner(ablation: &str, seed: u64) -> Hksl {
    let architecture = architecture(UpdateSchedule::Joint, ablation);
    Hksl::new(architecture, seed, &Device::Cpu).unwrap()
}

/// Copies all weights.
fn weights(learner: &Hksl) -> BTreeMap<String, Tensor> {
    let tensors = learner.networks().parameters.tensors().into_iter();
    tensors.map(|(name, tensor)| (name, tensor.copy().unwrap())).collect()
}

/// Copies the learner, with these networks' weights taken from `others`.
fn with(
    mut weights: BTreeMap<String, Tensor>,
    networks: &[&str],
    others: &BTreeMap<String, Tensor>,
    ablation: &str,
) -> Hksl {
    for (name, tensor) in others {
        if networks.iter().any(|network| name.starts_with(network)) {
            weights.insert(name.clone(), tensor.clone());
        }
    }
    let learner = learner(ablation, 0);
    learner.networks().parameters.load(&weights).unwrap();
    learner
}

fn numbers(tensor: &Tensor) -> Vec<f32> {
    let numbers: Vec<f32> = tensor.flatten_all().unwrap().to_vec1().unwrap();
    assert!(numbers.iter().all(|x| x.is_finite()));
    numbers
}

/// With zero moments, Adam changes each weight by its learning rate against the gradient's sign, except where the
/// gradient consists of rounding errors. Checks weights after such steps, given as gradients with learning rates, and
/// returns the number of weights checked.
fn follows(name: &str, moved: &Tensor, steps: &[(&Tensor, f32)]) -> usize {
    let gradients: Vec<(Vec<f32>, f32)> =
        steps.iter().map(|(gradient, rate)| (numbers(gradient), *rate)).collect();
    let largest = |gradient: &[f32]| gradient.iter().fold(0f32, |most, g| most.max(g.abs()));
    let mut compared = 0;
    for (index, moved) in numbers(moved).into_iter().enumerate() {
        let clear = |(gradient, _): &(Vec<f32>, f32)| {
            gradient[index].abs() > 1e-3 * largest(gradient) && gradient[index].abs() > 1e-5
        };
        if gradients.iter().all(clear) {
            let step = |(gradient, rate): &(Vec<f32>, f32)| -rate * gradient[index].signum();
            let expected: f32 = gradients.iter().map(step).sum();
            assert!((moved - expected).abs() < 0.02 * expected.abs(), "{name}: {moved} {expected}");
            compared += 1;
        }
    }
    compared
}

fn batch_and_noise() -> (LearningBatch, Noise) {
    sampled(6, 3)
}

/// A batch of trajectories with `length` transitions, and noise for `levels` levels.
fn sampled(length: usize, levels: usize) -> (LearningBatch, Noise) {
    let mut random = rng::stream(5, "joint");
    let count = (length + 1) * BATCH * 3 * 18 * 17;
    let pixels: Vec<u8> = (0..count).map(|_| random.random()).collect();
    let mut normal =
        |shape: &[usize]| rng::standard_normal(&mut random, shape, &Device::Cpu).unwrap();
    let batch = LearningBatch {
        trajectories: Trajectories {
            observations: Tensor::from_vec(pixels, (length + 1, BATCH, 3, 18, 17), &Device::Cpu)
                .unwrap(),
            actions: normal(&[BATCH, length, 2]).tanh().unwrap(),
        },
        rewards: normal(&[BATCH, length]),
        not_done: Tensor::ones((BATCH, length), DType::F32, &Device::Cpu).unwrap(),
    };
    let critics = (0..levels).map(|_| normal(&[BATCH, 2])).collect();
    (batch, Noise { critics, actor: normal(&[BATCH, 2]) })
}

/// Takes one step and returns its report.
fn step(learner: &mut Hksl, targets: bool) -> BTreeMap<String, f64> {
    let (batch, noise) = batch_and_noise();
    let schedule = Schedule { actor: true, targets };
    let report = learner.step(&batch, &noise, schedule).unwrap().values().unwrap();
    assert!(report.iter().all(|(_, value)| value.is_finite()));
    report.into_iter().collect()
}

/// An encoder changes by the sum of two first steps of Adam, along the signs of the gradients of the representation
/// losses and of the critic losses, each with its learning rate. All other weights change by one step. This test
/// computes the losses one by one.
#[test]
fn the_first_step_follows_both_gradients_each_at_its_rate() {
    for ablation in ["none", "no-repr", "shared-encoder"] {
        let mut learner = learner(ablation, 3);
        let (batch, noise) = batch_and_noise();
        let (mut models, mut critics) = (BTreeMap::new(), BTreeMap::new());
        for level in 0..3 {
            let target = learner.critic_target(level, &batch, &noise.critics[level]).unwrap();
            let first = batch.trajectories.at(0).unwrap();
            let latent = learner.hierarchy().encoder(level).forward(&first).unwrap();
            let (loss, _) = learner.critic_loss(level, &batch, &latent, &target).unwrap();
            add_gradients(&mut critics, &learner, &loss);
            if ablation != "no-repr" {
                let outcome = learner.hierarchy().level_loss(level, &batch.trajectories);
                add_gradients(&mut models, &learner, &outcome.unwrap().loss);
            }
        }
        let before = weights(&learner);
        let report = step(&mut learner, false);
        assert_eq!(report.contains_key("representation_loss_1"), ablation != "no-repr");
        let mut compared = 0;
        for (name, after) in learner.networks().parameters.tensors() {
            let moved = (after - &before[&name]).unwrap();
            let parts = [(models.get(&name), 1e-4), (critics.get(&name), 1e-3)];
            let parts: Vec<(&Tensor, f32)> =
                parts.into_iter().filter_map(|(gradient, rate)| Some((gradient?, rate))).collect();
            match parts[..] {
                [] if name.starts_with("actor.") || name == "log_alpha" => {}
                [] => assert!(numbers(&moved).iter().all(|&x| x == 0.0), "{name} moved"),
                _ => compared += follows(&name, &moved, &parts),
            }
        }
        let least = if ablation == "shared-encoder" { 1500 } else { 2500 };
        assert!(compared > least, "{ablation}: {compared}");
    }
}

/// Accumulates the gradient of a loss for every parameter.
fn add_gradients(sums: &mut BTreeMap<String, Tensor>, learner: &Hksl, loss: &Tensor) {
    let gradients = loss.backward().unwrap();
    for (name, parameter) in learner.networks().parameters.iter() {
        let Some(gradient) = gradients.get(parameter) else { continue };
        let sum = match sums.get(name) {
            Some(sum) => (sum + gradient).unwrap(),
            None => gradient.clone(),
        };
        sums.insert(name.to_owned(), sum);
    }
}

/// The actor loss uses the critics after their step and the encoders before theirs. Actor and temperature step along
/// its gradient. The target networks average the weights after all steps.
#[test]
fn actor_temperature_and_averages_take_their_turns() {
    for ablation in ["none", "no-repr", "shared-encoder"] {
        // Target networks differ from the trained ones, so that mistaking one for the other fails the test.
        let slow = ["targets.", "momentum."];
        let others = weights(&learner(ablation, 4));
        let mut learner = with(weights(&learner(ablation, 3)), &slow, &others, ablation);
        let before = weights(&learner);
        let report = step(&mut learner, true);
        let after = weights(&learner);
        let moved = |name: &str| (&after[name] - &before[name]).unwrap();

        let (batch, noise) = batch_and_noise();
        let seen = with(before.clone(), &["critics."], &after, ablation);
        let first = batch.trajectories.at(0).unwrap();
        let actor_loss = |of: &Hksl| {
            of.actor_loss(&of.hierarchy().encode(&first).unwrap(), &noise.actor).unwrap()
        };
        let (loss, log_prob) = actor_loss(&seen);
        let temperature_loss = seen.temperature().loss(&log_prob).unwrap();
        let value = |loss: &Tensor| f64::from(loss.to_scalar::<f32>().unwrap());
        let off = |loss: &Tensor, name: &str| (value(loss) / report[name] - 1.0).abs();
        assert!(off(&loss, "actor_loss") < 1e-5, "{ablation}: {loss}, {report:?}");
        assert!(off(&temperature_loss, "temperature_loss") < 1e-5, "{ablation}: {report:?}");
        // Another order of the updates would give other losses.
        for networks in [&[][..], &["critics.", "levels.", "encoder."], &["critics.", "log_alpha"]]
        {
            let other = with(before.clone(), networks, &after, ablation);
            let loss = actor_loss(&other).0;
            assert!(off(&loss, "actor_loss") > 1e-4, "{ablation}: {networks:?}");
        }

        let gradients = loss.backward().unwrap();
        let mut compared = 0;
        for (name, parameter) in seen.networks().parameters.under("actor").iter() {
            let step = (gradients.get(parameter).unwrap(), 1e-3);
            compared += follows(name, &moved(name), &[step]);
        }
        assert!(compared > 60, "{ablation}: {compared}");
        let log_alpha = seen.networks().parameters.get("log_alpha").unwrap();
        let gradient = temperature_loss.backward().unwrap().remove(log_alpha).unwrap();
        assert_eq!(follows("log_alpha", &moved("log_alpha"), &[(&gradient, 1e-3)]), 1);

        let mut averages = 0;
        for (name, average) in &after {
            let Some((online, tau)) = online(name) else { continue };
            let expected =
                (&before[name] * (1.0 - tau)).unwrap() + (&after[&online] * tau).unwrap();
            let off = numbers(&(average - expected.unwrap()).unwrap());
            assert!(off.iter().all(|x| x.abs() < 3e-7), "{ablation} {name}: {off:?}");
            averages += 1;
        }
        assert!(averages > 30, "{ablation}: {averages}");
    }
}

/// The source of a target parameter, and its soft update coefficient τ.
fn online(name: &str) -> Option<(String, f64)> {
    if let Some(rest) = name.strip_prefix("targets.") {
        return Some((format!("critics.{rest}"), 0.01));
    }
    let rest = name.strip_prefix("momentum.")?;
    let online = match rest.split_once('.') {
        Some((level, rest)) if level.parse::<usize>().is_ok() => {
            format!("levels.{level}.encoder.{rest}")
        }
        _ => format!("encoder.{rest}"),
    };
    Some((online, 0.05))
}

/// Passes of one step through encoders, as the kernels count them: one forward, two backward.
fn encoder_passes(schedule: UpdateSchedule, skips: &[usize], trajectory_length: usize) -> u64 {
    let mut architecture = architecture(schedule, "none");
    architecture.hksl.skips = skips.to_vec();
    architecture.hksl.trajectory_length = trajectory_length;
    let mut learner = Hksl::new(architecture, 1, &Device::Cpu).unwrap();
    let (batch, noise) = sampled(trajectory_length, skips.len());
    learner.step(&batch, &noise, Schedule { actor: true, targets: true }).unwrap();
    let images = learner.networks().parameters.operations().encoder_images;
    assert!(images.is_multiple_of(BATCH as u64), "{images}");
    images / BATCH as u64
}

/// Three levels with skips 1, 3, 3 and k = 6: 10 target passes, o_1 and o_3 by three encoders, and three encoders with
/// two gradients each.
#[test]
fn takes_the_encoder_passes_of_both_schedules() {
    assert_eq!(encoder_passes(UpdateSchedule::Joint, &[1, 3, 3], 6), 10 + 6 + 15);
    let skips = [1, 3, 5, 7];
    let passes =
        |schedule| (1..=4).map(|h| encoder_passes(schedule, &skips[..h], 7)).collect::<Vec<_>>();
    assert_eq!(passes(UpdateSchedule::Sequential), [15, 30, 49, 73]);
    assert_eq!(passes(UpdateSchedule::Joint), [13, 23, 34, 47]);
}

fn state(learner: &mut dyn Learner) -> BTreeMap<String, Tensor> {
    learner.state().unwrap()
}

fn load(learner: &mut dyn Learner, state: BTreeMap<String, Tensor>) -> hksl_sac::Result<()> {
    learner.load_state(state)
}

#[test]
fn goes_on_from_a_saved_state_to_the_bit() {
    for ablation in ["none", "no-repr", "shared-encoder"] {
        let (mut first, mut second) = (learner(ablation, 1), learner(ablation, 2));
        step(&mut first, true);
        load(&mut second, state(&mut first)).unwrap();
        step(&mut first, false);
        step(&mut second, false);
        let others = state(&mut second);
        for (name, tensor) in state(&mut first) {
            let (a, b) = (tensor, &others[&name]);
            let same =
                a.to_dtype(DType::F64).unwrap().eq(&b.to_dtype(DType::F64).unwrap()).unwrap();
            assert_eq!(same.min_all().unwrap().to_scalar::<u8>().unwrap(), 1, "{name}");
        }
        // The sequential schedule has other optimisers, so its learner rejects the state.
        let architecture = architecture(UpdateSchedule::Sequential, ablation);
        let mut other = Hksl::new(architecture, 1, &Device::Cpu).unwrap();
        assert!(load(&mut other, state(&mut first)).is_err());
    }
}
