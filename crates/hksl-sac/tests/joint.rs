//! The joint schedule against the definition: one step on the sum of all losses.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;

use candle_core::{DType, Device, Tensor};
use hksl_core::nn::{Initialisation, PixelEncoderConfig};
use hksl_core::{Trajectories, rng};
use hksl_sac::config::{HkslConfig, SacConfig, UpdateSchedule};
use hksl_sac::learner::{Architecture, HkslLearner, LearningBatch, Noise, Operations, Schedule};
use rand::Rng;

const BATCH: usize = 4;

fn architecture(update_schedule: UpdateSchedule, shared_encoder: bool) -> Architecture {
    Architecture {
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
            shared_encoder,
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
    }
}

fn batch_and_noise() -> (LearningBatch, Noise) {
    let mut random = rng::stream(5, "joint");
    let pixels: Vec<u8> = (0..7 * BATCH * 3 * 18 * 17).map(|_| random.random()).collect();
    let mut normal =
        |shape: &[usize]| rng::standard_normal(&mut random, shape, &Device::Cpu).unwrap();
    let batch = LearningBatch {
        trajectories: Trajectories {
            observations: Tensor::from_vec(pixels, (7, BATCH, 3, 18, 17), &Device::Cpu).unwrap(),
            actions: normal(&[BATCH, 6, 2]).tanh().unwrap(),
        },
        rewards: normal(&[BATCH, 6]),
        not_done: Tensor::ones((BATCH, 6), DType::F32, &Device::Cpu).unwrap(),
    };
    let critics = (0..3).map(|_| normal(&[BATCH, 2])).collect();
    (batch, Noise { critics, actor: normal(&[BATCH, 2]) })
}

fn step(learner: &mut HkslLearner, targets: bool) {
    let (batch, noise) = batch_and_noise();
    let schedule = Schedule { actor: true, targets };
    let report = learner.step(&batch, &noise, schedule).unwrap();
    assert!(report.values().unwrap().iter().all(|(_, value)| value.is_finite()));
}

/// Before any moment has grown, Adam moves each weight by its rate against the gradient's sign (but where the
/// gradient is all rounding): the signs must be those of the sum of all losses, each computed by itself.
#[test]
fn the_first_step_follows_the_summed_gradient_at_each_parts_rate() {
    let mut learner =
        HkslLearner::new(architecture(UpdateSchedule::Joint, false), 3, &Device::Cpu).unwrap();
    let (batch, noise) = batch_and_noise();
    let mut sums: BTreeMap<String, Tensor> = BTreeMap::new();
    for level in 0..3 {
        let target = learner.critic_target(level, &batch, &noise.critics[level]).unwrap();
        let critic = learner.critic_loss(level, &batch, &target).unwrap().0;
        let model = learner.hierarchy().level_loss(level, &batch.trajectories).unwrap().loss;
        for loss in [critic, model] {
            let gradients = loss.backward().unwrap();
            for (name, parameter) in learner.parameters().iter() {
                let Some(gradient) = gradients.get(parameter) else { continue };
                let sum = match sums.get(name) {
                    Some(sum) => (sum + gradient).unwrap(),
                    None => gradient.clone(),
                };
                sums.insert(name.to_owned(), sum);
            }
        }
    }
    let before = learner.parameters().tensors().into_iter();
    let before: BTreeMap<_, _> = before.map(|(name, x)| (name, x.copy().unwrap())).collect();
    let encodings = learner.hierarchy().encode(&batch.trajectories.at(0).unwrap()).unwrap();
    step(&mut learner, false);
    let mut compared = 0;
    for (name, gradient) in &sums {
        let rate =
            if name.starts_with("critics.") || name.contains(".encoder.") { 1e-3 } else { 1e-4 };
        let moved = (&learner.parameters().tensors()[name] - &before[name]).unwrap();
        let numbers = |x: &Tensor| x.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let (moved, gradient) = (numbers(&moved), numbers(gradient));
        let largest = gradient.iter().fold(0f32, |most, g| most.max(g.abs()));
        for (moved, gradient) in moved.into_iter().zip(gradient) {
            if gradient.abs() > 1e-3 * largest && gradient.abs() > 1e-5 {
                assert!((moved + rate * gradient.signum()).abs() < 0.01 * rate, "{name}: {moved}");
                compared += 1;
            }
        }
    }
    assert!(compared > 3000, "{compared}");
    let after = learner.hierarchy().encode(&batch.trajectories.at(0).unwrap()).unwrap();
    let moved = (after - encodings).unwrap().abs().unwrap().sum_all().unwrap();
    assert!(moved.to_scalar::<f32>().unwrap() > 0.0);
}

/// Three levels, n = 1, 3, 3 of k = 6: 10 target passes, o_1 and o_3 by three encoders, three with gradient.
#[test]
fn counts_the_encoder_passes_of_both_schedules() {
    let count = |skips: &[usize], k, schedule| {
        let mut architecture = architecture(schedule, false);
        architecture.hksl.skips = skips.to_vec();
        architecture.hksl.trajectory_length = k;
        Operations::of(&architecture).unwrap().encoder_passes
    };
    assert_eq!(count(&[1, 3, 3], 6, UpdateSchedule::Joint), 10 + 6 + 9);
    let skips = [1, 3, 5, 7];
    let passes = |schedule| (1..=4).map(|h| count(&skips[..h], 7, schedule)).collect::<Vec<_>>();
    assert_eq!(passes(UpdateSchedule::Sequential), [15, 30, 49, 73]);
    assert_eq!(passes(UpdateSchedule::Joint), [11, 19, 28, 39]);
}

#[test]
fn goes_on_from_a_saved_state_to_the_bit() {
    for shared in [false, true] {
        let new = |seed| {
            let architecture = architecture(UpdateSchedule::Joint, shared);
            HkslLearner::new(architecture, seed, &Device::Cpu).unwrap()
        };
        let (mut first, mut second) = (new(1), new(2));
        step(&mut first, true);
        second.load(&first.state().unwrap()).unwrap();
        step(&mut first, false);
        step(&mut second, false);
        for (name, tensor) in first.state().unwrap() {
            let (a, b) = (tensor, &second.state().unwrap()[&name]);
            let same =
                a.to_dtype(DType::F64).unwrap().eq(&b.to_dtype(DType::F64).unwrap()).unwrap();
            assert_eq!(same.min_all().unwrap().to_scalar::<u8>().unwrap(), 1, "{name}");
        }
        // The sequential schedule has other optimisers: its learner refuses the state.
        let architecture = architecture(UpdateSchedule::Sequential, shared);
        let mut other = HkslLearner::new(architecture, 1, &Device::Cpu).unwrap();
        assert!(other.load(&first.state().unwrap()).is_err());
    }
}
