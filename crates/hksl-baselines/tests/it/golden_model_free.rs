//! Compares the model-free methods with reference values from PyTorch (`tests/golden/README.md`).

use candle_core::Tensor;
use hksl_baselines::config::{
    BaselineConfig, CurlConfig, DbcConfig, DrqConfig, PiSacConfig, Transition,
};
use hksl_baselines::{
    ActorCritic, Architecture, Curl, CurlBatch, Dbc, DbcBatch, Drq, DrqBatch, PiSac, PiSacBatch,
    Transitions,
};
use hksl_core::kernels::Kernels;
use hksl_core::nn::{Initialisation, PixelEncoderConfig};
use hksl_sac::Learner;
use hksl_sac::config::SacConfig;
use serde::Deserialize;

use crate::fixture::{EncoderSizes, device};

const TOLERANCE: f64 = 1e-5;

#[derive(Deserialize)]
struct Sizes {
    obs: [usize; 3],
    action: usize,
    batch: usize,
    views: usize,
    filters: usize,
    latent: usize,
    hidden: usize,
    head_hidden: usize,
    model_hidden: usize,
    members: usize,
    discount: f64,
    q_tau: f64,
    encoder_tau: f64,
    backward_tau: f64,
    log_std_min: f64,
    log_std_max: f64,
    sac_rate: f64,
    ceb_rate: f64,
    ceb_beta: f64,
    ceb_smoothing: f64,
    bisimulation_weight: f64,
    decoder_decay: f64,
}

impl EncoderSizes for Sizes {
    fn encoder(&self) -> Option<([usize; 3], usize, usize)> {
        Some((self.obs, self.filters, self.latent))
    }
}

type Case = crate::fixture::Case<Sizes>;

fn architecture(sizes: &Sizes) -> Architecture {
    Architecture {
        observation: sizes.obs,
        action_dims: sizes.action,
        encoder: PixelEncoderConfig { filters: sizes.filters, latent_dims: sizes.latent },
        sac: SacConfig {
            batch_size: sizes.batch,
            learning_rate: sizes.sac_rate,
            discount: sizes.discount,
            initial_temperature: 0.1,
            hidden_units: sizes.hidden,
            log_std_minimum: sizes.log_std_min,
            log_std_maximum: sizes.log_std_max,
            target_update_every: 2,
            critic_tau: sizes.q_tau,
            encoder_tau: sizes.encoder_tau,
        },
        baseline: BaselineConfig {
            actor_update_every: 2,
            initialisation: Initialisation::Orthogonal,
        },
    }
}

fn transitions(case: &Case) -> Transitions {
    Transitions {
        observations: case.tensor("input.obs").get(0).unwrap(),
        actions: case.tensor("input.actions").clone(),
        rewards: case.tensor("input.rewards").clone(),
        not_done: case.tensor("input.not_done").clone(),
        next_observations: case.tensor("input.next_obs").get(0).unwrap(),
    }
}

fn target_noise(case: &Case) -> Tensor {
    case.tensor("input.noise.target").get(0).unwrap()
}

fn actor_noise(case: &Case) -> Tensor {
    case.tensor("input.noise.actor").clone()
}

/// Checks targets and losses of the actor-critic with the weights before the step.
fn check_core(case: &Case, core: &ActorCritic, views: &[Tensor], target: &Tensor) {
    let parameters = &core.networks().parameters;
    case.check("value.critic_target", target, TOLERANCE);
    let (loss, _) = core.critic_loss(views, case.tensor("input.actions"), target).unwrap();
    case.check("value.critic_loss", &loss, TOLERANCE);
    case.check_gradients("critic", &loss, parameters, TOLERANCE);
    let (loss, log_prob) = core.actor_loss(&views[0], &actor_noise(case)).unwrap();
    case.check("value.log_prob", &log_prob, TOLERANCE);
    case.check("value.actor_loss", &loss, TOLERANCE);
    case.check_gradients("actor", &loss, parameters, TOLERANCE);
    let loss = core.temperature().loss(&log_prob).unwrap();
    case.check("value.temperature_loss", &loss, TOLERANCE);
    case.check_gradients("temperature", &loss, parameters, TOLERANCE);
}

fn load(case: &Case, method: &impl Learner) {
    method.networks().parameters.load(&case.under("before")).unwrap();
}

#[test]
fn golden_sac_and_drq() {
    for (name, kernels) in ["sac", "drq"]
        .into_iter()
        .flat_map(|name| Kernels::available().into_iter().map(move |k| (name, k)))
    {
        let case = Case::read(name);
        let count = case.sizes.views;
        let config = DrqConfig { target_views: count, critic_views: count };
        let mut method =
            Drq::new(architecture(&case.sizes), config, kernels, 0, &device()).unwrap();
        load(&case, &method);
        let each = |name: &str| {
            (0..count).map(|view| case.tensor(name).get(view).unwrap()).collect::<Vec<_>>()
        };
        let views = DrqBatch {
            batch: transitions(&case),
            observations: each("input.obs"),
            next_observations: each("input.next_obs")
                .into_iter()
                .zip(each("input.noise.target"))
                .collect(),
            actor_noise: actor_noise(&case),
        };
        check_core(&case, method.core(), &views.observations, &method.target(&views).unwrap());
        method.step(&views, 0).unwrap();
        case.check_after(&method.core().networks().parameters, TOLERANCE);
    }
}

#[test]
fn golden_curl() {
    for kernels in Kernels::available() {
        let case = Case::read("curl");
        let config = CurlConfig { double_encoder_step: true };
        let mut method =
            Curl::new(architecture(&case.sizes), &config, kernels, 0, &device()).unwrap();
        load(&case, &method);
        let pairs = CurlBatch {
            batch: transitions(&case),
            positives: case.tensor("input.positive").clone(),
            target_noise: target_noise(&case),
            actor_noise: actor_noise(&case),
        };
        let (core, batch) = (method.core(), &pairs.batch);
        let target =
            core.critic_target(batch, &batch.next_observations, &pairs.target_noise).unwrap();
        check_core(&case, core, std::slice::from_ref(&batch.observations), &target);
        let loss = method.contrastive_loss(&batch.observations, &pairs.positives).unwrap();
        case.check("value.contrastive_loss", &loss, TOLERANCE);
        case.check_gradients("contrastive", &loss, &core.networks().parameters, TOLERANCE);
        method.step(&pairs, 0).unwrap();
        case.check_after(&method.core().networks().parameters, TOLERANCE);
    }
}

#[test]
fn golden_pi_sac() {
    for kernels in Kernels::available() {
        let case = Case::read("pi-sac");
        let sizes = &case.sizes;
        let config = PiSacConfig {
            learning_rate: sizes.ceb_rate,
            compression: sizes.ceb_beta,
            smoothing: sizes.ceb_smoothing,
            head_units: sizes.head_hidden,
            backward_tau: sizes.backward_tau,
            pretraining_steps: 0,
        };
        let mut method = PiSac::new(architecture(sizes), config, 3, kernels, 0, &device()).unwrap();
        load(&case, &method);
        let windows = PiSacBatch {
            batch: transitions(&case),
            actions: case.tensor("input.window_actions").flatten_from(1).unwrap(),
            rewards: case.tensor("input.window_rewards").clone(),
            future: case.tensor("input.y0").clone(),
            later: case.tensor("input.y1").clone(),
            latent_noise: case.tensor("input.noise.ceb").clone(),
            target_noise: target_noise(&case),
            actor_noise: actor_noise(&case),
        };
        let (core, batch) = (method.core(), &windows.batch);
        let target =
            core.critic_target(batch, &batch.next_observations, &windows.target_noise).unwrap();
        check_core(&case, core, std::slice::from_ref(&batch.observations), &target);
        let terms = method.terms(&windows).unwrap();
        case.check("value.i_xz", &terms.residual, TOLERANCE);
        case.check("value.i_yz", &terms.predictive, TOLERANCE);
        case.check("value.i_xz1", &terms.smoothing, TOLERANCE);
        let loss = terms.loss(sizes.ceb_beta, sizes.ceb_smoothing).unwrap();
        case.check("value.ceb_loss", &loss, TOLERANCE);
        case.check_gradients("ceb", &loss, &core.networks().parameters, TOLERANCE);
        method.step(&windows, 0).unwrap();
        case.check_after(&method.core().networks().parameters, TOLERANCE);
    }
}

#[test]
fn golden_dbc() {
    for (name, transition, kernels) in
        [("dbc", Transition::Probabilistic), ("dbc-ensemble", Transition::Ensemble)]
            .into_iter()
            .flat_map(|(name, model)| {
                Kernels::available().into_iter().map(move |k| (name, model, k))
            })
    {
        let case = Case::read(name);
        let sizes = &case.sizes;
        let config = DbcConfig {
            transition,
            ensemble_size: sizes.members,
            model_units: sizes.model_hidden,
            bisimulation_weight: sizes.bisimulation_weight,
            model_l2: sizes.decoder_decay,
        };
        let mut method = Dbc::new(architecture(sizes), config, kernels, 0, &device()).unwrap();
        load(&case, &method);
        let member = match transition {
            Transition::Ensemble => {
                case.tensor("input.member").get(0).unwrap().to_scalar::<u32>().unwrap()
            }
            _ => 0,
        };
        let permuted = DbcBatch {
            batch: transitions(&case),
            permutation: case.tensor("input.permutation").clone(),
            member: member as usize,
            transition_noise: case.tensor("input.noise.transition").clone(),
            target_noise: target_noise(&case),
            actor_noise: actor_noise(&case),
        };
        let (core, batch) = (method.core(), &permuted.batch);
        let target =
            core.critic_target(batch, &batch.next_observations, &permuted.target_noise).unwrap();
        check_core(&case, core, std::slice::from_ref(&batch.observations), &target);
        let losses = method.losses(&permuted).unwrap();
        case.check("value.transition_loss", &losses.transition, TOLERANCE);
        case.check("value.reward_loss", &losses.reward, TOLERANCE);
        case.check("value.bisimulation_loss", &losses.bisimulation, TOLERANCE);
        let loss = losses.sum(sizes.bisimulation_weight).unwrap();
        case.check("value.model_loss", &loss, TOLERANCE);
        case.check_gradients("model", &loss, &core.networks().parameters, TOLERANCE);
        method.step(&permuted, 0).unwrap();
        case.check_after(&method.core().networks().parameters, TOLERANCE);
    }
}
