//! Effects of each ablation on the agent in one learning step.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_core::nn::{Initialisation, PixelEncoderConfig};
use hksl_core::{Trajectories, rng};
use hksl_sac::Ablation;
use hksl_sac::config::{HkslConfig, SacConfig, UpdateSchedule};
use hksl_sac::hksl::{Architecture, Hksl, Noise, Schedule};
use hksl_sac::{Learner, LearningBatch};
use rand::Rng;

const BATCH: usize = 4;
const IMAGE: [usize; 3] = [3, 16, 16];
const LATENT: usize = 5;

fn learner(ablation: &str, skips: &[usize]) -> Hksl {
    let mut hksl = HkslConfig {
        skips: skips.to_vec(),
        trajectory_length: 6,
        learning_rate: 1e-3,
        actor_update_every: 1,
        update_schedule: UpdateSchedule::Sequential,
        initialisation: Initialisation::Uniform,
        communication_hidden: 7,
        representation: true,
        communication: true,
        projection: true,
        shared_encoder: false,
    };
    Ablation::from_name(ablation, true).unwrap().apply(&mut hksl);
    let sac = SacConfig {
        batch_size: BATCH,
        learning_rate: 1e-3,
        discount: 0.9,
        initial_temperature: 0.1,
        hidden_units: 8,
        log_std_minimum: -10.0,
        log_std_maximum: 2.0,
        target_update_every: 2,
        critic_tau: 0.01,
        encoder_tau: 0.05,
    };
    let encoder = PixelEncoderConfig { filters: 3, latent_dims: LATENT };
    let architecture = Architecture { observation: IMAGE, action_dims: 2, encoder, hksl, sac };
    Hksl::new(architecture, 1, &Device::Cpu).unwrap()
}

fn batch(length: usize) -> LearningBatch {
    let mut rng = rng::stream(2, "batch");
    let [c, h, w] = IMAGE;
    let pixels = (0..(length + 1) * BATCH * c * h * w).map(|_| rng.random::<u8>()).collect();
    let observations =
        Tensor::from_vec(pixels, (length + 1, BATCH, c, h, w), &Device::Cpu).unwrap();
    let mut draw = |shape: &[usize]| rng::standard_normal(&mut rng, shape, &Device::Cpu).unwrap();
    let actions = draw(&[BATCH, length, 2]).tanh().unwrap();
    let rewards = draw(&[BATCH, length]);
    let not_done = rewards.ones_like().unwrap();
    LearningBatch { trajectories: Trajectories { observations, actions }, rewards, not_done }
}

fn noise(levels: usize) -> Noise {
    let mut rng = rng::stream(3, "noise");
    let mut draw = |_| rng::standard_normal(&mut rng, &[BATCH, 2], &Device::Cpu).unwrap();
    Noise { critics: (0..levels).map(&mut draw).collect(), actor: draw(0) }
}

/// Names of the parameters that one learning step changes.
fn moved(learner: &mut Hksl) -> Vec<String> {
    let numbers = |learner: &Hksl| -> BTreeMap<String, Vec<f32>> {
        let flat = |tensor: Tensor| tensor.flatten_all().unwrap().to_vec1().unwrap();
        let tensors = learner.networks().parameters.tensors();
        tensors.into_iter().map(|(name, tensor)| (name, flat(tensor))).collect()
    };
    let before = numbers(learner);
    let hksl = &learner.architecture().hksl;
    let (length, levels) = (hksl.trajectory_length, hksl.skips.len());
    let schedule = Schedule { actor: true, targets: true };
    learner.step(&batch(length), &noise(levels), schedule).unwrap();
    let after = numbers(learner);
    before.into_iter().filter(|(name, old)| after[name] != *old).map(|(name, _)| name).collect()
}

fn has(names: &[String], part: &str) -> bool {
    names.iter().any(|name| name.contains(part))
}

fn names(learner: &Hksl) -> Vec<String> {
    learner.networks().parameters.names().map(str::to_owned).collect()
}

#[test]
fn the_full_method_moves_every_network() {
    let mut full = learner("none", &[1, 3]);
    let moved = moved(&mut full);
    let networks = [
        "levels.0.encoder",
        "levels.1.encoder",
        "levels.0.forward_model.update_action",
        "levels.0.forward_model.update_context",
        "levels.0.communication",
        "levels.0.projection",
        "levels.1.forward_model",
        "levels.1.projection",
        "momentum.0",
        "momentum.1",
        "critics.0.q1",
        "critics.1.q2",
        "targets.1.q1",
        "actor",
        "log_alpha",
    ];
    for part in networks {
        assert!(has(&moved, part), "{part} stayed as it was");
    }
}

#[test]
fn without_representation_critics_alone_move_the_encoders() {
    let moved = moved(&mut learner("no-repr", &[1, 3]));
    for part in ["forward_model", "communication", "projection"] {
        assert!(!has(&moved, part), "{part} moved");
    }
    for part in ["levels.0.encoder", "levels.1.encoder", "momentum.1", "critics.1", "actor"] {
        assert!(has(&moved, part), "{part} stayed as it was");
    }
}

#[test]
fn with_all_skips_one_every_level_predicts_and_bootstraps_one_transition() {
    let ablated = learner("all-n1", &[1, 3]);
    let batch = batch(6);
    let latents = ablated.hierarchy().level_loss(1, &batch.trajectories).unwrap().latents;
    assert_eq!(latents.len(), 6);
    // The target depends on the first reward alone.
    let target = |rewards: &Tensor| {
        let batch = LearningBatch { rewards: rewards.clone(), ..batch.clone() };
        let target = ablated.critic_target(1, &batch, &noise(2).critics[1]).unwrap();
        target.flatten_all().unwrap().to_vec1::<f32>().unwrap()
    };
    let first = batch.rewards.narrow(1, 0, 1).unwrap();
    let others = batch.rewards.narrow(1, 1, 5).unwrap();
    let with_others_doubled = Tensor::cat(&[&first, &(&others * 2.0).unwrap()], 1).unwrap();
    let with_first_doubled = Tensor::cat(&[&(&first * 2.0).unwrap(), &others], 1).unwrap();
    assert_eq!(target(&batch.rewards), target(&with_others_doubled));
    assert_ne!(target(&batch.rewards), target(&with_first_doubled));
}

#[test]
fn without_communication_a_levels_loss_reaches_that_level_alone() {
    let (full, ablated) = (learner("none", &[1, 3]), learner("no-c", &[1, 3]));
    assert!(has(&names(&full), "communication") && has(&names(&full), "_context"));
    assert!(!has(&names(&ablated), "communication") && !has(&names(&ablated), "_context"));
    for (learner, reaches) in [(&full, true), (&ablated, false)] {
        let loss = learner.hierarchy().level_loss(0, &batch(6).trajectories).unwrap().loss;
        let gradients = loss.backward().unwrap();
        let upper = learner.networks().parameters.under("levels.1.encoder");
        assert_eq!(upper.iter().any(|(_, p)| gradients.get(p).is_some()), reaches);
    }
}

#[test]
fn a_shared_encoder_is_one_encoder_with_a_moment_set_for_the_model_and_each_critic() {
    let mut ablated = learner("shared-encoder", &[1, 3]);
    let names = names(&ablated);
    assert!(!has(&names, "levels.0.encoder") && !has(&names, "momentum.0"));
    let actor_inputs =
        ablated.networks().parameters.get("actor.trunk.0.weight").unwrap().dim(1).unwrap();
    assert_eq!(actor_inputs, LATENT);
    let moved = moved(&mut ablated);
    assert!(has(&moved, "encoder.convs.0") && has(&moved, "momentum.convs.0"));
    let learner: &mut dyn Learner = &mut ablated;
    let state = learner.state().unwrap();
    let steps = |set: &str| {
        state[&format!("moments.{set}.encoder.convs.0.weight.steps")].to_scalar::<u32>().unwrap()
    };
    assert_eq!(steps("representation.shared"), 2, "once after each level's backward");
    assert_eq!((steps("critic.0"), steps("critic.1")), (1, 1));
    let sets = state.keys().filter(|name| name.ends_with("encoder.convs.0.weight.steps")).count();
    assert_eq!(sets, 3);
}

#[test]
fn one_level_has_one_critic_and_nobody_to_talk_to() {
    let ablated = learner("h1", &[1, 3]);
    let names = names(&ablated);
    assert!(!has(&names, "levels.1") && !has(&names, "critics.1") && !has(&names, "communication"));
    let actor_inputs =
        ablated.networks().parameters.get("actor.trunk.0.weight").unwrap().dim(1).unwrap();
    assert_eq!(actor_inputs, LATENT);
}

#[test]
fn without_projection_the_loss_holds_the_predictions_themselves_against_the_targets() {
    let ablated = learner("no-w", &[1, 3]);
    assert!(!has(&names(&ablated), "projection"));
    let outcome = ablated.hierarchy().level_loss(1, &batch(6).trajectories).unwrap();
    let direct =
        hksl_core::hierarchy::prediction_loss(&outcome.latents, &outcome.targets, None).unwrap();
    let (loss, direct) = (outcome.loss.to_scalar::<f32>(), direct.to_scalar::<f32>());
    assert_eq!(loss.unwrap(), direct.unwrap());
}

#[test]
fn numbers_of_levels_have_their_own_skips_and_critics() {
    for (name, steps) in [("h2", vec![6, 2]), ("h3", vec![6, 2, 1]), ("h4", vec![7, 2, 1, 1])] {
        let mut ablated = learner(name, &[1, 3, 5]);
        let config = ablated.hierarchy().config().clone();
        let taken: Vec<usize> = (0..config.levels()).map(|level| config.steps(level)).collect();
        assert_eq!(taken, steps, "{name}");
        assert!(has(&moved(&mut ablated), &format!("critics.{}", steps.len() - 1)));
    }
}
