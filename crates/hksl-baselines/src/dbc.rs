//! DBC: deep bisimulation for control.

mod models;

use std::time::Instant;

use candle_core::{Device, Tensor};
use hksl_core::kernels::Kernels;
use hksl_core::nn::Initialisation;
use hksl_core::optim::{Adam, AdamConfig};
use hksl_core::{Encoder, parallel};
use hksl_sac::{Acting, Draw, Learner, Networks, Phase, RecurrentState, Result, UpdateReport};
use rand_chacha::ChaCha8Rng;

use models::{RewardModel, TransitionModels};

use crate::actor_critic::{ActorCritic, ActorInput, Architecture, init_stream};
use crate::bisimulation::{bisimulation_loss, transition_loss};
use crate::config::{DbcConfig, Transition};
use crate::transitions::Transitions;

/// DBC (Zhang et al., arXiv 2006.10742): SAC with a transition model, a reward model and the bisimulation loss, trained
/// between critic and actor updates.
///
/// Parameters: `transition` (for an ensemble `transition.{0…}`), `reward`.
#[derive(Debug)]
pub struct Dbc {
    core: ActorCritic,
    config: DbcConfig,
    transition: TransitionModels,
    reward: RewardModel,
    encoder_adam: Adam,
    model_adam: Adam,
}

/// A batch of one learning step.
#[derive(Debug, Clone)]
pub struct DbcBatch {
    /// Transitions.
    pub batch: Transitions,
    /// Index of the item that each item is compared with, `(B)` u32.
    pub permutation: Tensor,
    /// Index of the transition model that predicts the latent for the reward model.
    pub member: usize,
    /// Noise of that latent, `(B, Z)`.
    pub transition_noise: Tensor,
    /// Noise of the next action, `(B, A)`.
    pub target_noise: Tensor,
    /// Noise of the action in the actor loss, `(B, A)`.
    pub actor_noise: Tensor,
}

/// The losses of models and encoder. All are scalars.
#[derive(Debug)]
pub struct ModelLosses {
    /// Negative log-likelihood of the next latents.
    pub transition: Tensor,
    /// Mean squared error of the reward predicted from the predicted latent.
    pub reward: Tensor,
    /// Bisimulation loss.
    pub bisimulation: Tensor,
}

impl ModelLosses {
    /// The sum of the losses, with a weight for the bisimulation loss.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn sum(&self, bisimulation_weight: f64) -> Result<Tensor> {
        Ok(((&self.transition + &self.reward)? + (&self.bisimulation * bisimulation_weight)?)?)
    }
}

impl Dbc {
    /// Creates the networks and initialises their weights with the RNG stream `init` of `seed`.
    ///
    /// # Errors
    /// Sizes out of range.
    pub fn new(
        architecture: Architecture,
        config: DbcConfig,
        kernels: Kernels,
        seed: u64,
        device: &Device,
    ) -> Result<Self> {
        let (rng, rate) = (&mut init_stream(seed), architecture.sac.learning_rate);
        let (dims, action_dims) = (architecture.encoder.latent_dims, architecture.action_dims);
        let mut core = ActorCritic::new(architecture, ActorInput::OwnHead, kernels, rng, device)?;
        // The authors use PyTorch's default initialisation for the models.
        let start = Initialisation::Uniform;
        let transition = core.add(("transition model", "transition"), start, rng, device, |b| {
            TransitionModels::new(b, dims, action_dims, &config)
        })?;
        let reward = core.add(("reward model", "reward"), start, rng, device, |b| {
            RewardModel::new(b, dims, config.model_units)
        })?;
        let parameters = &core.networks.parameters;
        let models = parameters.under("transition").union(&parameters.under("reward"));
        let of_models = AdamConfig { l2: config.model_l2, ..AdamConfig::at(rate) };
        Ok(Self {
            encoder_adam: Adam::new(parameters.under("encoder"), rate)?,
            model_adam: Adam::with(models, of_models)?,
            core,
            config,
            transition,
            reward,
        })
    }

    /// The actor-critic.
    pub fn core(&self) -> &ActorCritic {
        &self.core
    }

    /// The losses of models and encoder. The gradient reaches both models and, through the current latents, the encoder.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn losses(&self, permuted: &DbcBatch) -> Result<ModelLosses> {
        let DbcBatch { batch, permutation, member, transition_noise, .. } = permuted;
        let next = || self.core.frozen_encoder().forward(&batch.next_observations);
        let latents = || self.core.encoder().forward(&batch.observations);
        let (latents, next) = parallel::both(batch.observations.device(), latents, next);
        let (latents, next) = (latents?, next?);
        let (mean, deviation) = self.transition.forward(&latents, &batch.actions)?;
        let discount = self.core.architecture().sac.discount;
        let predicted = match self.config.transition {
            Transition::Deterministic => mean.get(*member)?,
            _ => (mean.get(*member)? + (deviation.get(*member)? * transition_noise)?)?,
        };
        let rewards = &batch.rewards;
        let models = (&mean, &deviation);
        Ok(ModelLosses {
            transition: transition_loss(&mean, &deviation, &next)?,
            reward: (self.reward.forward(&predicted)? - rewards)?.sqr()?.mean_all()?,
            bisimulation: bisimulation_loss(&latents, rewards, models, permutation, discount)?,
        })
    }

    /// Takes one learning step: updates critics, models and encoder, actor and temperature, then targets.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn step(&mut self, permuted: &DbcBatch, agent_step: u64) -> Result<UpdateReport> {
        let (mut report, mut clock) = (UpdateReport::default(), Instant::now());
        let DbcBatch { batch, target_noise, actor_noise, .. } = permuted;
        let target = self.core.critic_target(batch, &batch.next_observations, target_noise)?;
        let views = std::slice::from_ref(&batch.observations);
        self.core.step_critic(views, &batch.actions, &target, &mut report)?;
        report.lap(Phase::Critics, &mut clock);
        let losses = self.losses(permuted)?;
        let gradients = losses.sum(self.config.bisimulation_weight)?.backward()?;
        self.encoder_adam.step(&gradients)?;
        self.model_adam.step(&gradients)?;
        report.add("transition_loss", losses.transition.detach());
        report.add("reward_loss", losses.reward.detach());
        report.add("bisimulation_loss", losses.bisimulation.detach());
        report.lap(Phase::Representation, &mut clock);
        self.core.step_actor(&batch.observations, actor_noise, agent_step, &mut report)?;
        report.lap(Phase::Actor, &mut clock);
        self.core.update_targets(agent_step)?;
        report.lap(Phase::TargetNetworks, &mut clock);
        Ok(report)
    }

    fn draw(&self, draw: &mut Draw) -> Result<Option<DbcBatch>> {
        let Architecture { sac, action_dims, encoder, .. } = self.core.architecture();
        let (count, shape) = (sac.batch_size, [sac.batch_size, *action_dims]);
        let Some(starts) = draw.starts(count, 1) else { return Ok(None) };
        let batch = Transitions::first_of(&draw.batch(&starts, 1)?)?;
        let permutation = Tensor::new(draw.permutation(count), draw.device())?;
        let member = draw.index(self.transition.count());
        let transition_noise = draw.normal(&[count, encoder.latent_dims])?;
        let (target_noise, actor_noise) = (draw.normal(&shape)?, draw.normal(&shape)?);
        Ok(Some(DbcBatch {
            batch,
            permutation,
            member,
            transition_noise,
            target_noise,
            actor_noise,
        }))
    }
}

impl Learner for Dbc {
    fn update(&mut self, draw: &mut Draw, agent_step: u64) -> Result<Option<UpdateReport>> {
        let Some(permuted) = self.draw(draw)? else { return Ok(None) };
        parallel::inside(draw.device(), || self.step(&permuted, agent_step)).map(Some)
    }

    fn act(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
        _: &mut RecurrentState,
    ) -> Result<Tensor> {
        self.core.choose_action(observation, acting, random)
    }

    fn networks(&self) -> &Networks {
        &self.core.networks
    }

    fn optimizers(&mut self) -> Vec<(String, &mut Adam)> {
        let mut all = self.core.optimizers();
        all.push(("model_encoder".to_owned(), &mut self.encoder_adam));
        all.push(("models".to_owned(), &mut self.model_adam));
        all
    }

    fn diagnose(&self, draw: &mut Draw) -> Result<Vec<(String, f64)>> {
        self.core.diagnose(draw, |draw| self.auxiliary_losses(draw))
    }
}

impl Dbc {
    fn auxiliary_losses(&self, draw: &mut Draw) -> Result<Vec<(&'static str, Tensor)>> {
        let Some(permuted) = self.draw(draw)? else { return Ok(Vec::new()) };
        let ModelLosses { transition, reward, bisimulation } = self.losses(&permuted)?;
        Ok(vec![("transition", transition), ("reward", reward), ("bisimulation", bisimulation)])
    }
}
