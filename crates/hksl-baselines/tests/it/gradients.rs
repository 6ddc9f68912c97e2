//! Compares gradients of the methods' losses with finite differences, and tests effects of their options.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_baselines::config::{
    CurlConfig, DbcConfig, DreamerConfig, PiSacConfig, Transition, Vision,
};
use hksl_baselines::dreamer::{DreamerV2, Sequences, Sizes};
use hksl_baselines::{Curl, CurlBatch, Dbc, DbcBatch, PiSac, PiSacBatch};
use hksl_core::Parameters;
use hksl_core::kernels::Kernels;
use hksl_core::nn::PixelEncoderConfig;
use hksl_sac::Learner;

use crate::small::{ACTION_DIMS, BATCH, Draws, IMAGE, LATENT, architecture};

/// Checks that the directional derivative of a loss along its gradient `g` is `|g|`, within the tolerance of f32 and ReLUs.
fn check(what: &str, parameters: &Parameters, under: &[&str], loss: impl Fn() -> Tensor) {
    let gradients = loss().backward().unwrap();
    let value = || f64::from(loss().to_scalar::<f32>().unwrap());
    let mut checked = 0;
    for prefix in under {
        for (name, parameter) in parameters.under(prefix).iter() {
            let Some(gradient) = gradients.get(parameter) else { continue };
            let square = gradient.sqr().unwrap().sum_all().unwrap().to_scalar::<f32>().unwrap();
            let length = f64::from(square).sqrt();
            if length < 2e-2 {
                continue; // The difference would be below the loss's rounding error.
            }
            let start = parameter.as_detached_tensor().copy().unwrap();
            let distance = 1e-3;
            let at = |distance: f64| {
                let shift = (gradient * (distance / length)).unwrap();
                parameter.set(&(&start + shift).unwrap()).unwrap();
                value()
            };
            let slope = (at(distance) - at(-distance)) / (2.0 * distance);
            parameter.set(&start).unwrap();
            assert!(
                (slope - length).abs() <= 0.05 * length + 2e-3,
                "{what} {name}: slope {slope}, gradient {length}"
            );
            checked += 1;
        }
    }
    assert!(checked >= under.len(), "{what}: only {checked} parameters could be checked");
}

fn curl(double_encoder_step: bool) -> Curl {
    let config = CurlConfig { double_encoder_step };
    Curl::new(architecture(), &config, Kernels::detect(), 3, &Device::Cpu).unwrap()
}

#[test]
fn curls_contrastive_loss() {
    let (method, mut draws) = (curl(true), Draws::new());
    let (queries, keys) = (draws.images(BATCH), draws.images(BATCH));
    check("contrastive", &method.core().networks().parameters, &["encoder", "bilinear"], || {
        method.contrastive_loss(&queries, &keys).unwrap()
    });
}

/// Without the original's second optimiser the contrastive loss changes the encoder half as much.
#[test]
fn curls_second_encoder_step_is_an_option() {
    let moved = |double: bool| {
        let (mut method, mut draws) = (curl(double), Draws::new());
        let pairs = CurlBatch {
            batch: draws.transitions(),
            positives: draws.images(BATCH),
            target_noise: draws.normal(&[BATCH, ACTION_DIMS]),
            actor_noise: draws.normal(&[BATCH, ACTION_DIMS]),
        };
        let weight = |method: &Curl| {
            let parameters = &method.core().networks().parameters;
            parameters.get("encoder.convs.0.weight").unwrap().as_detached_tensor().copy().unwrap()
        };
        let before = weight(&method);
        method.step(&pairs, 1).unwrap();
        let off = (weight(&method) - before).unwrap().abs().unwrap().mean_all().unwrap();
        off.to_scalar::<f32>().unwrap()
    };
    // Adam's first step has the length of the learning rate: three steps with the second optimiser, two without.
    let (double, single) = (moved(true), moved(false));
    assert!(double > 1.2 * single, "{double} {single}");
}

#[test]
fn pi_sacs_predictive_task() {
    let config = PiSacConfig {
        learning_rate: 3e-4,
        compression: 0.5,
        smoothing: 0.6,
        head_units: 16,
        backward_tau: 0.05,
        pretraining_steps: 0,
    };
    let (beta, smoothing) = (config.compression, config.smoothing);
    let method = PiSac::new(architecture(), config, 3, Kernels::detect(), 3, &Device::Cpu).unwrap();
    let mut draws = Draws::new();
    let windows = PiSacBatch {
        batch: draws.transitions(),
        actions: draws.normal(&[BATCH, 3 * ACTION_DIMS]),
        rewards: draws.normal(&[BATCH, 4]),
        future: draws.images(BATCH),
        later: draws.images(BATCH),
        latent_noise: draws.normal(&[BATCH, LATENT]),
        target_noise: draws.normal(&[BATCH, ACTION_DIMS]),
        actor_noise: draws.normal(&[BATCH, ACTION_DIMS]),
    };
    let parts = ["encoder", "forward_head", "backward_head"];
    check("ceb", &method.core().networks().parameters, &parts, || {
        method.terms(&windows).unwrap().loss(beta, smoothing).unwrap()
    });
}

fn dbc(transition: Transition) -> (Dbc, DbcBatch) {
    let config = DbcConfig {
        transition,
        ensemble_size: 3,
        model_units: 16,
        bisimulation_weight: 0.5,
        model_l2: 1e-7,
    };
    let method = Dbc::new(architecture(), config, Kernels::detect(), 3, &Device::Cpu).unwrap();
    let mut draws = Draws::new();
    let permuted = DbcBatch {
        batch: draws.transitions(),
        permutation: Tensor::new(&[3u32, 1, 0, 2, 6, 7, 5, 4], &Device::Cpu).unwrap(),
        member: 0,
        transition_noise: draws.normal(&[BATCH, LATENT]),
        target_noise: draws.normal(&[BATCH, ACTION_DIMS]),
        actor_noise: draws.normal(&[BATCH, ACTION_DIMS]),
    };
    (method, permuted)
}

#[test]
fn dbcs_models() {
    for transition in [Transition::Deterministic, Transition::Probabilistic, Transition::Ensemble] {
        let (method, permuted) = dbc(transition);
        let parameters = &method.core().networks().parameters;
        // The models' losses only. The bisimulation loss detaches the models, so its gradient with respect to the encoder
        // matches finite differences only if the models' outputs stay fixed.
        let what = format!("{transition:?}");
        check(&what, parameters, &["transition", "reward"], || {
            let losses = method.losses(&permuted).unwrap();
            (losses.transition + losses.reward).unwrap()
        });
    }
}

#[test]
fn a_deterministic_model_has_no_deviation() {
    let (mut method, permuted) = dbc(Transition::Deterministic);
    let names: Vec<_> = method
        .core()
        .networks()
        .parameters
        .under("transition")
        .names()
        .map(str::to_owned)
        .collect();
    assert!(!names.iter().any(|name| name.contains("scale")), "{names:?}");
    let parameters = method.core().networks().parameters.tensors().into_iter();
    // A step changes the shared storage in place.
    let before: BTreeMap<String, Tensor> =
        parameters.map(|(name, tensor)| (name, tensor.copy().unwrap())).collect();
    method.step(&permuted, 0).unwrap();
    for name in names {
        let after = method.core().networks().parameters.get(&name).unwrap().as_detached_tensor();
        let off = (after - &before[&name]).unwrap().abs().unwrap().sum_all().unwrap();
        assert!(off.to_scalar::<f32>().unwrap() > 0.0, "{name} has not moved");
    }
}

/// Parameters whose gradient does not pass the sampled states: decoder and reward head.
#[test]
fn dreamers_world_model() {
    let sizes = Sizes {
        observation: IMAGE,
        action_dims: ACTION_DIMS,
        encoder: PixelEncoderConfig { filters: 8, latent_dims: LATENT },
        config: DreamerConfig {
            vision: Vision::Shared,
            vision_depth: 2,
            batch_sequences: 2,
            sequence_length: 2,
            train_every: 1,
            pretraining_steps: 0,
            deterministic_units: 6,
            hidden_units: 7,
            variables: 3,
            classes: 4,
            reward_layers: 2,
            reward_units: 8,
            behaviour_layers: 2,
            behaviour_units: 8,
            world_learning_rate: 3e-4,
            actor_learning_rate: 8e-5,
            critic_learning_rate: 8e-5,
            epsilon: 1e-5,
            gradient_clip: 100.0,
            weight_decay: 1e-6,
            kl_balance: 0.8,
            free_nats: 0.0,
            discount: 0.99,
            lambda: 0.95,
            horizon: 3,
            entropy_weight: 1e-4,
            slow_critic_every: 100,
        },
    };
    let dreamer = DreamerV2::new(sizes, Kernels::detect(), 3, &Device::Cpu).unwrap();
    let mut draws = Draws::new();
    let [c, h, w] = IMAGE;
    let sequences = Sequences {
        observations: draws.images(4).reshape((2, 2, c, h, w)).unwrap(),
        actions: draws.normal(&[2, 2, ACTION_DIMS]),
        rewards: draws.normal(&[2, 2]),
    };
    let uniform = Tensor::full(0.37f32, (2, 2, 3), &Device::Cpu).unwrap();
    let filtered = dreamer.world().filter(&sequences, &uniform).unwrap();
    check("world", &dreamer.networks().parameters, &["decoder", "reward"], || {
        let losses = dreamer.world().losses(&sequences, &filtered).unwrap();
        // Per pixel, for sufficient precision in f32.
        ((losses.image * (1.0 / 100.0)).unwrap() + losses.reward).unwrap()
    });
}
