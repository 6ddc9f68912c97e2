//! Soft actor-critic on one encoder, the common core of the model-free baselines.

mod diagnosis;
mod policy;

use candle_core::{Device, Tensor};
use hksl_core::kernels::Kernels;
use hksl_core::nn::{Initialisation, PixelEncoder, PixelEncoderConfig};
use hksl_core::optim::{Adam, MovingAverage};
use hksl_core::{Builder, Encoder, Parameters, parallel, rng};
use hksl_sac::config::SacConfig;
use hksl_sac::critic::{Critic, n_step_return};
use hksl_sac::{
    Acting, ImageEncoder, Networks, QFunction, Result, Sampled, Temperature, UpdateReport,
};
use rand_chacha::ChaCha8Rng;

use policy::Policy;

use crate::Transitions;
use crate::config::BaselineConfig;

/// Sizes and settings of a method's networks.
#[derive(Debug, Clone, PartialEq)]
pub struct Architecture {
    /// Shape of one observation, `(C, H, W)`.
    pub observation: [usize; 3],
    /// Action dimensions, `A`.
    pub action_dims: usize,
    /// Sizes of the encoder.
    pub encoder: PixelEncoderConfig,
    /// The actor-critic and how it learns.
    pub sac: SacConfig,
    /// Settings common to all baselines.
    pub baseline: BaselineConfig,
}

/// Input of the actor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActorInput {
    /// The convolution features of the critics' encoder, through a separate head that the actor loss trains (DrQ, CURL,
    /// DBC).
    OwnHead,
    /// The critics' latent (PI-SAC).
    Latent,
}

/// Encoder, twin critics, target networks, actor and temperature, with their optimisers.
///
/// Parameters: `encoder`, `critic`, `targets.encoder`, `targets.critic`, `actor.trunk`, `actor.head` for
/// [`ActorInput::OwnHead`], and `log_alpha`. The critic loss trains encoder and critics. The actor loss does not train
/// the encoder.
#[derive(Debug)]
pub struct ActorCritic {
    architecture: Architecture,
    pub(crate) networks: Networks,
    encoder: PixelEncoder,
    frozen_encoder: PixelEncoder,
    target_encoder: PixelEncoder,
    critic: Critic,
    frozen_critic: Critic,
    target_critic: Critic,
    policy: Policy,
    frozen_policy: Policy,
    temperature: Temperature,
    critic_adam: Adam,
    actor_adam: Adam,
    temperature_adam: Adam,
    averages: [MovingAverage; 2],
}

impl ActorCritic {
    /// Creates the networks and initialises their weights from `rng`. A method passes the same generator to [`Self::add`].
    ///
    /// # Errors
    /// Sizes out of range.
    pub fn new(
        architecture: Architecture,
        input: ActorInput,
        kernels: Kernels,
        rng: &mut ChaCha8Rng,
        device: &Device,
    ) -> Result<Self> {
        let Architecture { observation, action_dims, encoder: sizes, ref sac, ref baseline } =
            architecture;
        sac.validate()?;
        baseline.validate()?;
        let mut parameters = Parameters::with_kernels(kernels);
        let mut create = Builder::create(&mut parameters, rng, baseline.initialisation, device);
        let make_encoder = |builder: &mut Builder, name: &str| {
            PixelEncoder::new(&mut builder.under(name), observation, sizes)
        };
        let make_critic = |builder: &mut Builder, name: &str| {
            Critic::new(&mut builder.under(name), sizes.latent_dims, action_dims, sac.hidden_units)
        };
        let make_policy = |builder: &mut Builder| {
            let builder = &mut builder.under("actor");
            Policy::new(builder, input, (observation, sizes), action_dims, sac)
        };
        let encoder = make_encoder(&mut create, "encoder")?;
        let critic = make_critic(&mut create, "critic")?;
        let policy = make_policy(&mut create)?;
        let temperature =
            Temperature::new(&mut parameters, sac.initial_temperature, action_dims, device)?;
        for name in ["encoder", "critic"] {
            parameters.copy_under(name, &format!("targets.{name}"))?;
        }
        let mut view = Builder::view(&parameters, device);
        let frozen_encoder = make_encoder(&mut view, "encoder")?;
        let target_encoder = make_encoder(&mut view, "targets.encoder")?;
        let frozen_critic = make_critic(&mut view, "critic")?;
        let target_critic = make_critic(&mut view, "targets.critic")?;
        let frozen_policy = make_policy(&mut view)?;
        let rate = sac.learning_rate;
        let of_critic = parameters.under("encoder").union(&parameters.under("critic"));
        let average = |name: &str, tau: f64| {
            MovingAverage::new(&parameters, name, &format!("targets.{name}"), tau)
        };
        let name = |name: &str, prefix: &str| (name.to_owned(), vec![prefix.to_owned()]);
        let view: Box<dyn ImageEncoder> = Box::new(frozen_encoder.clone());
        let q = QFunction {
            suffix: String::new(),
            encoder: 0,
            discount: sac.discount,
            critic: frozen_critic.clone(),
        };
        Ok(Self {
            critic_adam: Adam::new(of_critic, rate)?,
            actor_adam: Adam::new(parameters.under("actor"), rate)?,
            temperature_adam: Adam::new(parameters.under("log_alpha"), rate)?,
            averages: [average("critic", sac.critic_tau)?, average("encoder", sac.encoder_tau)?],
            networks: Networks {
                observation,
                parameters,
                trained: vec![
                    name("encoder", "encoder"),
                    name("twin critics", "critic"),
                    name("actor", "actor"),
                ],
                encoders: vec![("encoder".to_owned(), view)],
                critics: vec![q],
            },
            encoder,
            frozen_encoder,
            target_encoder,
            critic,
            frozen_critic,
            target_critic,
            policy,
            frozen_policy,
            temperature,
            architecture,
        })
    }

    /// The sizes and settings of the networks.
    pub fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// All networks, including those added with [`Self::add`].
    pub fn networks(&self) -> &Networks {
        &self.networks
    }

    /// Adds a network of a method: `make` creates it under `prefix`, with weights initialised from `rng`. Checkpoints save
    /// only networks that are added here.
    ///
    /// # Errors
    /// Whatever `make` reports.
    pub fn add<T>(
        &mut self,
        (name, prefix): (&str, &str),
        initialisation: Initialisation,
        rng: &mut ChaCha8Rng,
        device: &Device,
        make: impl FnOnce(&mut Builder) -> Result<T>,
    ) -> Result<T> {
        self.networks.trained.push((name.to_owned(), vec![prefix.to_owned()]));
        let parameters = &mut self.networks.parameters;
        make(&mut Builder::create(parameters, rng, initialisation, device).under(prefix))
    }

    /// The optimisers with their names: critics with encoder, actor, temperature.
    pub fn optimizers(&mut self) -> Vec<(String, &mut Adam)> {
        vec![
            ("critic".to_owned(), &mut self.critic_adam),
            ("actor".to_owned(), &mut self.actor_adam),
            ("temperature".to_owned(), &mut self.temperature_adam),
        ]
    }

    /// The encoder with gradient.
    pub fn encoder(&self) -> &PixelEncoder {
        &self.encoder
    }

    /// The encoder without gradient.
    pub fn frozen_encoder(&self) -> &PixelEncoder {
        &self.frozen_encoder
    }

    /// The target encoder.
    pub fn target_encoder(&self) -> &PixelEncoder {
        &self.target_encoder
    }

    /// Chooses an action `(1, A)` for one observation `(1, C, H, W)`: the deterministic action for [`Acting::Mean`], a sample
    /// from the policy otherwise.
    ///
    /// # Errors
    /// An observation whose shape does not fit the encoder.
    pub fn choose_action(
        &self,
        observation: &Tensor,
        acting: Acting,
        random: &mut ChaCha8Rng,
    ) -> Result<Tensor> {
        if acting == Acting::Mean {
            let latents = self.frozen_policy.read(&self.frozen_encoder, observation)?;
            return self.frozen_policy.actor.mean(&latents);
        }
        let shape = [1, self.architecture.action_dims];
        let noise = rng::standard_normal(random, &shape, observation.device())?;
        Ok(self.sample_action(observation, &noise)?.action)
    }

    /// Samples actions `(B, A)` for observations `(B, C, H, W)` with noise `(B, A)`, without gradient.
    fn sample_action(&self, observations: &Tensor, noise: &Tensor) -> Result<Sampled> {
        let latents = self.frozen_policy.read(&self.frozen_encoder, observations)?;
        self.frozen_policy.actor.sample(&latents, noise)
    }

    /// The critic target `r + γ m (min(Q̄1, Q̄2)(ē(o′), a′) − α log π(a′|o′))`, where `a′` is sampled from the policy. `(B, 1)`,
    /// without gradient.
    ///
    /// # Shapes
    /// - `next`: `(B, C, H, W)`, an augmented view of the batch's next observations
    /// - `noise`: `(B, A)`
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn critic_target(
        &self,
        batch: &Transitions,
        next: &Tensor,
        noise: &Tensor,
    ) -> Result<Tensor> {
        let act = || self.sample_action(next, noise);
        let encode = || self.target_encoder.forward(next);
        let (sampled, latents) = parallel::both(next.device(), act, encode);
        let Sampled { action, log_prob } = sampled?;
        let min_q = self.target_critic.min_q(&latents?, &action)?;
        let value = (min_q - self.temperature.cost(&log_prob)?)?;
        n_step_return(&batch.rewards, &batch.not_done, &value, 1, self.architecture.sac.discount)
    }

    /// The critic loss summed over augmented views `(B, C, H, W)` of the observations, and the mean Q-value. The gradient
    /// reaches critics and encoder.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn critic_loss(
        &self,
        views: &[Tensor],
        actions: &Tensor,
        target: &Tensor,
    ) -> Result<(Tensor, Tensor)> {
        let view_loss =
            |view: &Tensor| self.critic.loss(&self.encoder.forward(view)?, actions, target);
        let (losses, means): (Vec<_>, Vec<_>) =
            parallel::each(actions.device(), views, view_loss)?.into_iter().unzip();
        Ok((Tensor::stack(&losses, 0)?.sum_all()?, Tensor::stack(&means, 0)?.mean_all()?))
    }

    /// The actor loss `mean(α log π − min(Q1, Q2))` and the log-densities `(B, 1)`. The gradient reaches the actor alone.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn actor_loss(&self, observations: &Tensor, noise: &Tensor) -> Result<(Tensor, Tensor)> {
        let features = self.frozen_encoder.features(observations)?;
        let latents = self.frozen_encoder.head().forward(&features)?;
        let read = self.policy.read_features(&features, &latents)?;
        let Sampled { action, log_prob } = self.policy.actor.sample(&read, noise)?;
        let cost = self.temperature.cost(&log_prob)?;
        let loss = (cost - self.frozen_critic.min_q(&latents, &action)?)?.mean_all()?;
        Ok((loss, log_prob.detach()))
    }

    /// The entropy temperature α.
    pub fn temperature(&self) -> &Temperature {
        &self.temperature
    }

    /// Updates critics and encoder with the loss against `target`.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn step_critic(
        &mut self,
        views: &[Tensor],
        actions: &Tensor,
        target: &Tensor,
        report: &mut UpdateReport,
    ) -> Result<()> {
        let (loss, mean) = self.critic_loss(views, actions, target)?;
        self.critic_adam.step(&loss.backward()?)?;
        report.add("critic_loss", loss.detach());
        report.add("q_mean", mean);
        Ok(())
    }

    /// Updates actor and temperature if `agent_step` is a multiple of their period.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn step_actor(
        &mut self,
        observations: &Tensor,
        noise: &Tensor,
        agent_step: u64,
        report: &mut UpdateReport,
    ) -> Result<()> {
        if !agent_step.is_multiple_of(self.architecture.baseline.actor_update_every) {
            return Ok(());
        }
        let (loss, log_prob) = self.actor_loss(observations, noise)?;
        self.actor_adam.step(&loss.backward()?)?;
        let temperature_loss = self.temperature.loss(&log_prob)?;
        self.temperature_adam.step(&temperature_loss.backward()?)?;
        report.add("actor_loss", loss.detach());
        report.add("entropy", log_prob.mean_all()?.neg()?);
        report.add("temperature_loss", temperature_loss.detach());
        report.add("temperature", self.temperature.alpha()?);
        Ok(())
    }

    /// Updates the target networks by Polyak averaging if `agent_step` is a multiple of their period.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn update_targets(&self, agent_step: u64) -> Result<()> {
        if agent_step.is_multiple_of(self.architecture.sac.target_update_every) {
            for average in &self.averages {
                average.update()?;
            }
        }
        Ok(())
    }
}

/// The RNG stream for the initial weights of a method.
pub(crate) fn init_stream(seed: u64) -> ChaCha8Rng {
    rng::stream(seed, "init")
}
