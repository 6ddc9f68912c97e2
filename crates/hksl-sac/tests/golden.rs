//! The learning step against golden numbers from PyTorch (`hksl-core/tests/golden/README.md`).
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../../hksl-core/tests/golden/fixture.rs"]
mod fixture;

use candle_core::{Device, Tensor};
use fixture::{Case, cases_and_kernels, largest};
use hksl_core::Encoder;
use hksl_core::kernels::Kernels;
use hksl_core::nn::Initialisation;
use hksl_sac::config::{HkslConfig, SacConfig, UpdateSchedule};
use hksl_sac::learner::{Architecture, HkslLearner, LearningBatch, Noise, Schedule};

const TOLERANCE: f64 = 1e-5;
const HKSL_RATE: f64 = 1e-4;
const SAC_RATE: f64 = 1e-3;

/// The learner with a file's weights, its batch and its noise.
fn learner(case: &Case, kernels: Kernels) -> (HkslLearner, LearningBatch, Noise) {
    let sizes = &case.sizes;
    let architecture = Architecture {
        observation: sizes.obs,
        action_dims: sizes.action,
        encoder: case.encoder_config(),
        hksl: HkslConfig {
            skips: sizes.skips.clone(),
            trajectory_length: sizes.k,
            learning_rate: HKSL_RATE,
            actor_update_every: 1,
            update_schedule: UpdateSchedule::Sequential,
            initialisation: Initialisation::Uniform,
            communication_hidden: sizes.communication_hidden,
            representation: true,
            communication: true,
            projection: true,
            shared_encoder: false,
        },
        sac: SacConfig {
            batch_size: case.tensor("input.rewards").dims()[0],
            learning_rate: SAC_RATE,
            discount: sizes.discount,
            initial_temperature: 0.1,
            hidden_units: sizes.hidden,
            log_std_minimum: -10.0,
            log_std_maximum: 2.0,
            target_update_every: 2,
            critic_tau: sizes.q_tau,
            encoder_tau: sizes.encoder_tau,
        },
    };
    let learner = HkslLearner::with_kernels(architecture, 0, &Device::Cpu, kernels).unwrap();
    learner.parameters().load(&case.under("before.")).unwrap();
    let batch = LearningBatch {
        trajectories: case.trajectories(),
        rewards: case.tensor("input.rewards").clone(),
        not_done: case.tensor("input.not_done").clone(),
    };
    let noise = |index: usize| case.tensor(&format!("input.noise.{index}")).clone();
    let levels = sizes.skips.len();
    let noise = Noise { critics: (0..levels).map(noise).collect(), actor: noise(levels) };
    (learner, batch, noise)
}

#[test]
fn golden_encodings_and_rollouts_of_the_agents_hierarchy() {
    for (case, kernels) in cases_and_kernels() {
        let (learner, batch, _) = learner(&case, kernels);
        let (hierarchy, trajectories) = (learner.hierarchy(), &batch.trajectories);
        let first = trajectories.at(0).unwrap();
        for level in 0..case.sizes.skips.len() {
            let encoding = hierarchy.frozen_encoder(level).forward(&first).unwrap();
            case.check(&format!("value.encoding.{level}"), &encoding, TOLERANCE);
            let outcome = hierarchy.level_loss(level, trajectories).unwrap();
            case.check(&format!("value.level_loss.{level}"), &outcome.loss, TOLERANCE);
            let latents = Tensor::stack(&outcome.latents, 0).unwrap();
            case.check(&format!("value.rollout.{level}"), &latents, TOLERANCE);
        }
    }
}

#[test]
fn golden_critic_targets_and_gradients() {
    for (case, kernels) in cases_and_kernels() {
        let (learner, batch, noise) = learner(&case, kernels);
        for (level, noise) in noise.critics.iter().enumerate() {
            let target = learner.critic_target(level, &batch, noise).unwrap();
            case.check(&format!("value.critic_target.{level}"), &target, TOLERANCE);
            let (loss, _) = learner.critic_loss(level, &batch, &target).unwrap();
            case.check(&format!("value.critic_loss.{level}"), &loss, TOLERANCE);
            let gradients = loss.backward().unwrap();
            let expected = case.under(&format!("grad.critic_loss.{level}."));
            let mut compared = 0;
            for (name, parameter) in learner.parameters().iter() {
                let Some(gradient) = gradients.get(parameter) else { continue };
                if expected.contains_key(name) {
                    case.check(&format!("grad.critic_loss.{level}.{name}"), gradient, TOLERANCE);
                    compared += 1;
                } else {
                    // The files leave out what has no gradient at all.
                    assert_eq!(largest(gradient), 0.0, "{} {name}", case.name);
                }
            }
            assert_eq!(compared, expected.len(), "{} level {level}", case.name);
        }
    }
}

#[test]
fn golden_actor_and_temperature() {
    for (case, kernels) in cases_and_kernels() {
        let (learner, batch, noise) = learner(&case, kernels);
        let (loss, log_prob) = learner.actor_loss(&batch, &noise.actor).unwrap();
        case.check("value.actor_loss", &loss, TOLERANCE);
        case.check("value.log_prob", &log_prob, TOLERANCE);
        let temperature_loss = learner.temperature_loss(&log_prob).unwrap();
        case.check("value.alpha_loss", &temperature_loss, TOLERANCE);
        let gradients = loss.backward().unwrap();
        let expected = case.under("grad.actor_loss.");
        let mut compared = 0;
        for (name, parameter) in learner.parameters().iter() {
            let Some(gradient) = gradients.get(parameter) else { continue };
            let key = name.strip_prefix("actor.").expect("the actor alone has a gradient");
            case.check(&format!("grad.actor_loss.{key}"), gradient, TOLERANCE);
            compared += 1;
        }
        assert_eq!(compared, expected.len(), "{}", case.name);
    }
}

/// How far one element may move in the step at most, all the steps it takes added up.
fn reach(name: &str, case: &Case) -> f64 {
    let parts: Vec<&str> = name.split('.').collect();
    let by_losses = |level: &str| (level.parse::<f64>().unwrap() + 1.0) * HKSL_RATE;
    match (parts[0], parts.get(2)) {
        ("levels", Some(&"encoder")) => by_losses(parts[1]) + SAC_RATE,
        ("levels", _) => by_losses(parts[1]),
        ("momentum", _) => case.sizes.encoder_tau * (by_losses(parts[1]) + SAC_RATE),
        ("targets", _) => case.sizes.q_tau * SAC_RATE,
        _ => SAC_RATE,
    }
}

/// Adam divides a gradient by its own size in its first step, so where a gradient is all rounding, its sign
/// and with it the whole step may differ: one element of a tensor, or one in a thousand, may.
#[test]
fn golden_weights_after_a_step() {
    for (case, kernels) in cases_and_kernels() {
        let (mut learner, batch, noise) = learner(&case, kernels);
        learner.step(&batch, &noise, Schedule { actor: true, targets: true }).unwrap();
        let after = case.under("after.");
        assert_eq!(learner.parameters().names().count(), after.len(), "{}", case.name);
        let (mut turned, mut elements) = (0, 0);
        for (name, parameter) in learner.parameters().iter() {
            let expected = &after[name];
            let difference = (parameter.as_tensor() - expected).unwrap();
            let differences = difference.abs().unwrap().flatten_all().unwrap();
            let differences = differences.to_vec1::<f32>().unwrap();
            let tolerance = 3e-4 * largest(expected);
            let off: Vec<f64> =
                differences.iter().map(|&d| f64::from(d)).filter(|&d| d > tolerance).collect();
            let allowed = (differences.len() / 1000).max(1);
            let worst = off.iter().copied().fold(0.0, f64::max);
            assert!(
                off.len() <= allowed && worst <= 2.0 * reach(name, &case),
                "{} {name}: {} of {} elements off by up to {worst:.3e}",
                case.name,
                off.len(),
                differences.len()
            );
            turned += off.len();
            elements += differences.len();
        }
        println!(
            "{}, {kernels}: {turned} of {elements} weights took a step of another sign",
            case.name
        );
    }
}
