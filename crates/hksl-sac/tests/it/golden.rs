//! Compares the learning step with reference values from PyTorch (`hksl-core/tests/golden/README.md`).

use candle_core::{Device, Tensor};
use hksl_core::Encoder;
use hksl_core::kernels::Kernels;
use hksl_core::nn::Initialisation;
use hksl_sac::config::{HkslConfig, SacConfig, UpdateSchedule};
use hksl_sac::hksl::{Architecture, Hksl, Noise, Schedule};
use hksl_sac::{Learner, LearningBatch};

use crate::fixture::{Case, cases_and_kernels, largest};

const TOLERANCE: f64 = 1e-5;
/// Tolerance of weight changes, relative to a tensor's largest change. f32 resolves a weight to 3e-4 of the hierarchy's
/// learning rate.
const MOVEMENTS: f64 = 1e-3;
const HKSL_RATE: f64 = 1e-4;
const SAC_RATE: f64 = 1e-3;

/// The learner with the weights of a reference file, its batch and its noise.
fn learner(case: &Case, kernels: Kernels) -> (Hksl, LearningBatch, Noise) {
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
    let learner =
        Hksl::with_kernels(architecture, 0, case.tensor("input.obs").device(), kernels).unwrap();
    learner.networks().parameters.load(&case.under("before.")).unwrap();
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
            let first = batch.trajectories.at(0).unwrap();
            let latent = learner.hierarchy().encoder(level).forward(&first).unwrap();
            let (loss, _) = learner.critic_loss(level, &batch, &latent, &target).unwrap();
            case.check(&format!("value.critic_loss.{level}"), &loss, TOLERANCE);
            let gradients = loss.backward().unwrap();
            let expected = case.under(&format!("grad.critic_loss.{level}."));
            let mut compared = 0;
            for (name, parameter) in learner.networks().parameters.iter() {
                let Some(gradient) = gradients.get(parameter) else { continue };
                if expected.contains_key(name) {
                    case.check(&format!("grad.critic_loss.{level}.{name}"), gradient, TOLERANCE);
                    compared += 1;
                } else {
                    // The reference files omit parameters without gradient.
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
        let first = batch.trajectories.at(0).unwrap();
        let latents = learner.hierarchy().encode(&first).unwrap();
        let (loss, log_prob) = learner.actor_loss(&latents, &noise.actor).unwrap();
        case.check("value.actor_loss", &loss, TOLERANCE);
        case.check("value.log_prob", &log_prob, TOLERANCE);
        let temperature_loss = learner.temperature().loss(&log_prob).unwrap();
        case.check("value.alpha_loss", &temperature_loss, TOLERANCE);
        let gradients = loss.backward().unwrap();
        let expected = case.under("grad.actor_loss.");
        let mut compared = 0;
        for (name, parameter) in learner.networks().parameters.iter() {
            let Some(gradient) = gradients.get(parameter) else { continue };
            let key = name.strip_prefix("actor.").expect("the actor alone has a gradient");
            case.check(&format!("grad.actor_loss.{key}"), gradient, TOLERANCE);
            compared += 1;
        }
        assert_eq!(compared, expected.len(), "{}", case.name);
    }
}

/// Each loss depends on the updates before it, so the losses verify the order of the updates. The change of each weight
/// verifies that its steps were taken.
#[test]
fn golden_losses_and_weights_of_a_step() {
    for (case, kernels) in cases_and_kernels() {
        let (mut learner, batch, noise) = learner(&case, kernels);
        let schedule = Schedule { actor: true, targets: true };
        let report = learner.step(&batch, &noise, schedule).unwrap().values().unwrap();
        let check = |name: &str, own: &str| {
            let found = report.iter().find(|(known, _)| known == own).unwrap().1;
            let found = Tensor::new(found as f32, &Device::Cpu).unwrap();
            case.check(&format!("step.{name}"), &found, TOLERANCE);
        };
        for level in 0..case.sizes.skips.len() {
            check(&format!("level_loss.{level}"), &format!("representation_loss_{}", level + 1));
            check(&format!("critic_loss.{level}"), &format!("critic_loss_{}", level + 1));
        }
        check("actor_loss", "actor_loss");
        check("alpha_loss", "temperature_loss");
        assert_eq!(learner.networks().parameters.names().count(), case.under("after.").len());
        for (name, parameter) in learner.networks().parameters.iter() {
            case.check_movement(name, parameter, MOVEMENTS);
        }
    }
}
