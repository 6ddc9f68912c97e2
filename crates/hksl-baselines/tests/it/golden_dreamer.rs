//! Compares DreamerV2 with reference values from PyTorch (`tests/golden/README.md`).

use candle_core::{Device, Tensor};
use hksl_baselines::DreamerV2;
use hksl_baselines::config::{DreamerConfig, Vision};
use hksl_baselines::dreamer::categorical::balanced_kl_divergence;
use hksl_baselines::dreamer::{Sequences, Sizes, Uniform};
use hksl_core::kernels::Kernels;
use hksl_core::nn::{PixelEncoder, PixelEncoderConfig};
use hksl_sac::Learner;
use serde::Deserialize;

use crate::fixture::{EncoderSizes, device, largest};

/// Relative to the largest element. PyTorch in f32 has a relative error of 4e-6 in the original's convolutions.
const TOLERANCE: f64 = 1e-5;
const GRADIENTS: f64 = 2e-5;

#[derive(Deserialize)]
struct Golden {
    preset: String,
    obs: [usize; 3],
    action: usize,
    #[serde(default)]
    filters: usize,
    #[serde(default)]
    latent: usize,
    #[serde(default)]
    depth: usize,
    #[serde(default)]
    hidden: usize,
    deter: usize,
    rssm_hidden: usize,
    variables: usize,
    classes: usize,
    mlp_hidden: usize,
    batch: usize,
    length: usize,
    horizon: usize,
    discount: f64,
    lambda: f64,
    entropy_scale: f64,
    kl_balance: f64,
    free_nats: f64,
    free_nats_large: f64,
    world_lr: f64,
    actor_lr: f64,
    critic_lr: f64,
    adam_eps: f64,
    clip: f64,
    decay: f64,
}

impl EncoderSizes for Golden {
    fn encoder(&self) -> Option<([usize; 3], usize, usize)> {
        (self.preset == "paper").then_some((self.obs, self.filters, self.latent))
    }
}

type Case = crate::fixture::Case<Golden>;

fn sizes(golden: &Golden) -> Sizes {
    let original = golden.preset == "original";
    Sizes {
        observation: golden.obs,
        action_dims: golden.action,
        encoder: PixelEncoderConfig { filters: golden.filters, latent_dims: golden.latent },
        config: DreamerConfig {
            vision: if original { Vision::Original } else { Vision::Shared },
            vision_depth: golden.depth,
            batch_sequences: golden.batch,
            sequence_length: golden.length,
            train_every: 1,
            pretraining_steps: 0,
            deterministic_units: golden.deter,
            hidden_units: golden.rssm_hidden,
            variables: golden.variables,
            classes: golden.classes,
            reward_layers: 4,
            reward_units: golden.mlp_hidden,
            behaviour_layers: if original { 4 } else { 2 },
            behaviour_units: if original { golden.mlp_hidden } else { golden.hidden },
            world_learning_rate: golden.world_lr,
            actor_learning_rate: golden.actor_lr,
            critic_learning_rate: golden.critic_lr,
            epsilon: golden.adam_eps,
            gradient_clip: golden.clip,
            weight_decay: golden.decay,
            kl_balance: golden.kl_balance,
            free_nats: golden.free_nats,
            discount: golden.discount,
            lambda: golden.lambda,
            horizon: golden.horizon,
            entropy_weight: golden.entropy_scale,
            slow_critic_every: 100,
        },
    }
}

/// Reorders the decoder's first feature map from channels first in the file to channels last.
fn by_pixel(golden: &Golden, name: &str, tensor: &Tensor) -> Tensor {
    if golden.preset == "original" || !name.contains("decoder.start.") {
        return tensor.clone();
    }
    let (rows, columns) = PixelEncoder::map_size(golden.obs[1], golden.obs[2]).unwrap();
    let (first, rest) = (tensor.dim(0).unwrap(), tensor.elem_count() / tensor.dim(0).unwrap());
    let maps = tensor.reshape((golden.filters, rows * columns, rest)).unwrap();
    let maps = maps.transpose(0, 1).unwrap().contiguous().unwrap();
    let shape: Vec<usize> =
        std::iter::once(first).chain(tensor.dims()[1..].iter().copied()).collect();
    maps.reshape(shape).unwrap()
}

/// Transposes `(B, T, …)` to `(T, B, …)`.
fn times_first(tensor: &Tensor) -> Tensor {
    tensor.transpose(0, 1).unwrap().contiguous().unwrap()
}

/// Transposes `(B·T, …)` to `(T·B, …)`.
fn states_times_first(golden: &Golden, tensor: &Tensor) -> Tensor {
    let shape = [&[golden.batch, golden.length], &tensor.dims()[1..]].concat();
    times_first(&tensor.reshape(shape).unwrap()).flatten_to(1).unwrap()
}

/// Transposes `(T·B, …)` to the file's `(B, T, …)`.
fn batch_first(golden: &Golden, tensor: &Tensor) -> Tensor {
    let shape = [&[golden.length, golden.batch], &tensor.dims()[1..]].concat();
    times_first(&tensor.reshape(shape).unwrap())
}

#[test]
fn golden_dreamer() {
    for (name, kernels) in ["dreamer-paper", "dreamer-original"]
        .into_iter()
        .flat_map(|name| Kernels::available().into_iter().map(move |kernels| (name, kernels)))
    {
        let mut case = Case::read(name);
        case.map(by_pixel);
        let golden = &case.sizes;
        let mut dreamer = DreamerV2::new(sizes(golden), kernels, 0, &device()).unwrap();
        let parameters = &dreamer.networks().parameters;
        let weights = parameters.names().map(|name| (name.to_owned(), case.tensor(name).clone()));
        parameters.load(&weights.collect()).unwrap();
        let sequences = Sequences {
            observations: times_first(case.tensor("input.obs")),
            actions: times_first(case.tensor("input.actions")),
            rewards: times_first(case.tensor("input.rewards")),
        };
        let by_step = |name: &str| -> Vec<Tensor> {
            let all = states_times_first(golden, case.tensor(name));
            (0..golden.horizon)
                .map(|step| all.narrow(1, step, 1).unwrap().squeeze(1).unwrap())
                .collect()
        };
        let uniform = Uniform {
            posterior: times_first(case.tensor("input.uniform.posterior")),
            actions: by_step("input.uniform.action"),
            priors: by_step("input.uniform.prior"),
        };

        let world = dreamer.world();
        let filtered = world.filter(&sequences, &uniform.posterior).unwrap();
        let check =
            |name: &str, got: &Tensor| case.check(name, &batch_first(golden, got), TOLERANCE);
        check("value.posterior_logits", &filtered.posterior);
        check("value.prior_logits", &filtered.prior);
        let starts = filtered.starts().unwrap();
        check("value.stoch", &starts.stochastic);
        check("value.deter", &starts.deterministic);
        let features = starts.feature().unwrap();
        let images = world.images(&features).unwrap().permute((0, 3, 1, 2)).unwrap();
        check("value.reconstruction", &images.contiguous().unwrap());
        check("value.reward", &world.rewards(&features).unwrap());
        let losses = world.losses(&sequences, &filtered).unwrap();
        case.check("value.image_loss", &losses.image, TOLERANCE);
        case.check("value.reward_loss", &losses.reward, TOLERANCE);
        case.check("value.kl_loss", &losses.kl_divergence, TOLERANCE);
        let free = golden.free_nats_large;
        let (posterior, prior) = (&filtered.posterior, &filtered.prior);
        let free = balanced_kl_divergence(posterior, prior, golden.kl_balance, free).unwrap();
        case.check("value.kl_loss_free", &free, TOLERANCE);
        case.check("value.world_loss", &losses.sum().unwrap(), TOLERANCE);
        case.check_gradients("world", &losses.sum().unwrap(), parameters, GRADIENTS);

        let (losses, imagined) = dreamer.behaviour_losses(starts, &uniform).unwrap();
        let actions = Tensor::stack(&imagined.actions, 1).unwrap();
        let (count, steps, dims) = actions.dims3().unwrap();
        let expected = states_times_first(golden, case.tensor("value.imagined_actions"));
        assert_eq!(expected.dims(), [count, steps, dims]);
        assert!(largest(&(actions - expected).unwrap()) < 1e-5, "{name} imagined actions");
        case.check("value.actor_loss", &losses.actor, TOLERANCE);
        case.check("value.critic_loss", &losses.critic, TOLERANCE);
        case.check("value.entropy", &losses.entropy, TOLERANCE);
        case.check_gradients("actor", &losses.actor, parameters, GRADIENTS);
        case.check_gradients("critic", &losses.critic, parameters, GRADIENTS);

        let report = dreamer.step(&sequences, &uniform).unwrap().values().unwrap();
        let reported = |name: &str| {
            let found = report.iter().find(|(known, _)| known == name).unwrap().1;
            Tensor::new(found as f32, &Device::Cpu).unwrap()
        };
        for (file, own) in [
            ("step.norm.world", "world_gradient_norm"),
            ("step.norm.actor", "actor_gradient_norm"),
            ("step.norm.critic", "critic_gradient_norm"),
            ("step.actor_loss", "actor_loss"),
            ("step.critic_loss", "critic_loss"),
        ] {
            case.check(file, &reported(own), GRADIENTS);
        }
        case.check_after(&dreamer.networks().parameters, TOLERANCE);
    }
}
