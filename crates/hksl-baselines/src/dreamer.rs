//! DreamerV2 for continuous actions: a world model, and an actor and a critic that learn from imagined trajectories
//! (Hafner et al., arXiv 2010.02193).

pub mod behaviour;
pub mod categorical;
mod learner;
pub mod returns;
pub mod rssm;
pub mod truncated_normal;
pub mod vision;
pub mod world;

use std::time::Instant;

use candle_core::{Device, Tensor};
use hksl_core::kernels::Kernels;
use hksl_core::nn::{Initialisation, PixelEncoderConfig};
use hksl_core::optim::{Adam, AdamConfig};
use hksl_core::{Builder, Parameters, parallel};
use hksl_sac::{Draw, ImageEncoder, Networks, Phase, Result, UpdateReport};

use behaviour::{DreamerActor, DreamerCritic, imagine};
use world::WorldModel;

use crate::actor_critic::init_stream;
use crate::config::DreamerConfig;

/// Sizes and settings of the networks.
#[derive(Debug, Clone, PartialEq)]
pub struct Sizes {
    /// Shape of one observation, `(C, H, W)`.
    pub observation: [usize; 3],
    /// Action dimensions, `A`.
    pub action_dims: usize,
    /// Sizes of the shared encoder.
    pub encoder: PixelEncoderConfig,
    /// All other sizes and settings.
    pub config: DreamerConfig,
}

impl Sizes {
    /// Feature dimensions.
    fn feature(&self) -> usize {
        let DreamerConfig { variables, classes, deterministic_units, .. } = self.config;
        variables * classes + deterministic_units
    }
}

/// A batch of sequences. Time is the first dimension.
#[derive(Debug, Clone)]
pub struct Sequences {
    /// `(T, B, C, H, W)` u8.
    pub observations: Tensor,
    /// The action before each observation, `(T, B, A)`. The first is ignored.
    pub actions: Tensor,
    /// The reward before each observation, `(T, B)`.
    pub rewards: Tensor,
}

/// Uniform noise in [0, 1) for one learning step.
#[derive(Debug, Clone)]
pub struct Uniform {
    /// Noise for sampling states from their posteriors, `(T, B, V)`.
    pub posterior: Tensor,
    /// Noise for sampling imagined actions, `H` tensors of shape `(N, A)`.
    pub actions: Vec<Tensor>,
    /// Noise for sampling imagined states, `H` tensors of shape `(N, V)`.
    pub priors: Vec<Tensor>,
}

/// DreamerV2's networks, optimisers and learning step.
///
/// Parameters: those of the [`WorldModel`], `actor`, `critic`, `targets.critic`.
#[derive(Debug)]
pub struct DreamerV2 {
    sizes: Sizes,
    networks: Networks,
    world: WorldModel,
    frozen_world: WorldModel,
    actor: DreamerActor,
    frozen_actor: DreamerActor,
    critic: DreamerCritic,
    target_critic: DreamerCritic,
    world_adam: Adam,
    actor_adam: Adam,
    critic_adam: Adam,
    /// Learning steps taken, including pretraining steps.
    steps: u64,
    pretrained: u64,
}

/// Prefixes of the world model's parameters.
const WORLD: [&str; 4] = ["encoder", "rssm", "decoder", "reward"];
const TARGET_CRITIC: &str = "targets.critic";

impl DreamerV2 {
    /// Creates the networks and initialises their weights with the RNG stream `init` of `seed`.
    ///
    /// # Errors
    /// Sizes out of range.
    pub fn new(sizes: Sizes, kernels: Kernels, seed: u64, device: &Device) -> Result<Self> {
        sizes.config.validate()?;
        let rng = &mut init_stream(seed);
        let mut parameters = Parameters::with_kernels(kernels);
        let mut create = Builder::create(&mut parameters, rng, Initialisation::Uniform, device);
        let world = WorldModel::new(&mut create, &sizes)?;
        let actor = DreamerActor::new(&mut create.under("actor"), &sizes)?;
        let critic = DreamerCritic::new(&mut create.under("critic"), &sizes)?;
        // The target critic has its own initial weights until the first copy after the first step, as in the original.
        DreamerCritic::new(&mut create.under(TARGET_CRITIC), &sizes)?;
        let mut view = Builder::view(&parameters, device);
        let frozen_world = WorldModel::new(&mut view, &sizes)?;
        let frozen_actor = DreamerActor::new(&mut view.under("actor"), &sizes)?;
        let target_critic = DreamerCritic::new(&mut view.under(TARGET_CRITIC), &sizes)?;
        let of_world = WORLD.map(|name| parameters.under(name)).into_iter();
        let of_world = of_world.reduce(|all, part| all.union(&part)).unwrap_or_default();
        let DreamerConfig { epsilon, weight_decay: decay, .. } = sizes.config;
        let adam = |parameters: Parameters, learning_rate: f64| {
            Adam::with(parameters, AdamConfig { learning_rate, epsilon, l2: 0.0, decay })
        };
        let DreamerConfig {
            world_learning_rate, actor_learning_rate, critic_learning_rate, ..
        } = sizes.config;
        Ok(Self {
            world_adam: adam(of_world, world_learning_rate)?,
            actor_adam: adam(parameters.under("actor"), actor_learning_rate)?,
            critic_adam: adam(parameters.under("critic"), critic_learning_rate)?,
            networks: networks(&sizes, parameters, frozen_world.encoder.clone()),
            sizes,
            world,
            frozen_world,
            actor,
            frozen_actor,
            critic,
            target_critic,
            steps: 0,
            pretrained: 0,
        })
    }

    /// The world model with gradient.
    pub fn world(&self) -> &WorldModel {
        &self.world
    }

    /// Imagines trajectories from `starts` and computes the losses of actor and critic with the current weights.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn behaviour_losses(
        &self,
        starts: rssm::State,
        uniform: &Uniform,
    ) -> Result<(behaviour::BehaviourLosses, behaviour::Imagined)> {
        let world = &self.frozen_world;
        let imagined = imagine(world, &self.actor, starts, &uniform.actions, &uniform.priors)?;
        let config = &self.sizes.config;
        let losses =
            behaviour::losses(world, &self.critic, &self.target_critic, &imagined, config)?;
        Ok((losses, imagined))
    }

    /// Takes one learning step: updates the world model, then actor and critic on trajectories imagined from the states that
    /// the world model inferred before its update, then the target critic if it is due.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn step(&mut self, sequences: &Sequences, uniform: &Uniform) -> Result<UpdateReport> {
        let (mut report, mut clock) = (UpdateReport::default(), Instant::now());
        let clip = self.sizes.config.gradient_clip;
        let device = sequences.rewards.device().clone();
        let norm = |report: &mut UpdateReport, name: &str, norm: f64| -> Result<()> {
            report.add(name, Tensor::new(norm, &device)?);
            Ok(())
        };
        let filtered = self.world.filter(sequences, &uniform.posterior)?;
        let losses = self.world.losses(sequences, &filtered)?;
        let length = self.world_adam.step_clipped(&losses.sum()?.backward()?, clip)?;
        norm(&mut report, "world_gradient_norm", length)?;
        report.add("image_loss", losses.image.detach());
        report.add("reward_loss", losses.reward.detach());
        report.add("kl_loss", losses.kl_divergence.detach());
        report.lap(Phase::Representation, &mut clock);
        let starts = filtered.starts()?;
        drop((filtered, losses));

        let (losses, imagined) = self.behaviour_losses(starts, uniform)?;
        drop(imagined);
        let of_actor = losses.actor.backward()?;
        report.lap(Phase::Actor, &mut clock);
        let of_critic = losses.critic.backward()?;
        report.lap(Phase::Critics, &mut clock);
        let length = self.actor_adam.step_clipped(&of_actor, clip)?;
        norm(&mut report, "actor_gradient_norm", length)?;
        report.add("actor_loss", losses.actor.detach());
        report.add("entropy", losses.entropy);
        report.add("imagined_return", losses.returns);
        report.lap(Phase::Actor, &mut clock);
        let length = self.critic_adam.step_clipped(&of_critic, clip)?;
        norm(&mut report, "critic_gradient_norm", length)?;
        report.add("critic_loss", losses.critic.detach());
        report.add("value_mean", losses.values);
        report.lap(Phase::Critics, &mut clock);
        if self.steps.is_multiple_of(self.sizes.config.slow_critic_every) {
            self.copy_critic()?;
        }
        self.steps += 1;
        report.lap(Phase::TargetNetworks, &mut clock);
        Ok(report)
    }

    fn copy_critic(&self) -> Result<()> {
        let slow = self.networks.parameters.under(TARGET_CRITIC);
        for (name, target) in slow.iter() {
            let source = name.trim_start_matches("targets.");
            let source = self.networks.parameters.get(source);
            let missing = || hksl_core::Error::MissingParameter(name.to_owned());
            let source = source.ok_or_else(missing)?.as_detached_tensor();
            target.set(&source.copy()?)?;
        }
        Ok(())
    }

    fn draw(&self, draw: &mut Draw) -> Result<Option<(Sequences, Uniform)>> {
        let DreamerConfig { batch_sequences: count, sequence_length, variables, horizon, .. } =
            self.sizes.config;
        let Some(starts) = draw.starts(count, sequence_length - 1) else { return Ok(None) };
        let sequences = draw.sequences(&starts, sequence_length)?;
        let states = count * sequence_length;
        let posterior = draw.uniform(&[sequence_length, count, variables])?;
        let (mut actions, mut priors) = (Vec::new(), Vec::new());
        for _ in 0..horizon {
            actions.push(draw.uniform(&[states, self.sizes.action_dims])?);
            priors.push(draw.uniform(&[states, variables])?);
        }
        let sequences = Sequences {
            observations: sequences.observations,
            actions: sequences.arriving_actions,
            rewards: sequences.arriving_rewards,
        };
        Ok(Some((sequences, Uniform { posterior, actions, priors })))
    }

    fn learn(&mut self, draw: &mut Draw) -> Result<Option<UpdateReport>> {
        let Some((sequences, uniform)) = self.draw(draw)? else { return Ok(None) };
        parallel::inside(draw.device(), || self.step(&sequences, &uniform)).map(Some)
    }

    /// The policy's action for a feature, `(N, A)`: a sample with noise `uniform`, or the location without noise.
    fn policy(&self, feature: &Tensor, uniform: Option<&Tensor>) -> Result<Tensor> {
        let (location, deviation) = self.frozen_actor.distribution(feature)?;
        match uniform {
            Some(uniform) => truncated_normal::sample(&location, &deviation, uniform),
            None => Ok(location),
        }
    }
}

/// Lists the networks. `critics` is empty because DreamerV2's critic evaluates states of the world model, not
/// observations and actions.
fn networks(sizes: &Sizes, parameters: Parameters, encoder: vision::ConvEncoder) -> Networks {
    let trained = [
        ("encoder", "encoder"),
        ("state-space model", "rssm"),
        ("decoder", "decoder"),
        ("reward head", "reward"),
        ("actor", "actor"),
        ("critic", "critic"),
    ];
    let trained = trained.map(|(name, prefix)| (name.to_owned(), vec![prefix.to_owned()]));
    let encoder: Box<dyn ImageEncoder> = Box::new(encoder);
    Networks {
        observation: sizes.observation,
        parameters,
        trained: trained.into(),
        encoders: vec![("encoder".to_owned(), encoder)],
        critics: Vec::new(),
    }
}
