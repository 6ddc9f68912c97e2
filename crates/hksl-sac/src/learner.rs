//! All networks of the HKSL agent and one learning step over a batch.

mod diagnosis;
mod joint;
mod losses;
mod memory;
mod operations;
mod report;
mod state;

use std::time::Instant;

use candle_core::{Device, Tensor};
use hksl_core::kernels::Kernels;
use hksl_core::nn::{PixelEncoder, PixelEncoderConfig};
use hksl_core::optim::{Adam, MovingAverage};
use hksl_core::{
    Builder, Encoder, Hierarchy, HierarchyConfig, HierarchyLearner, Parameters, Trajectories,
    parallel, rng,
};

use joint::JointOptimisers;
pub use operations::Operations;
pub use report::{Phase, UpdateReport};

use crate::actor::Actor;
use crate::config::{HkslConfig, SacConfig, UpdateSchedule};
use crate::critic::Critic;
use crate::temperature::Temperature;
use crate::{Error, Result};

/// What the networks are built for.
#[derive(Debug, Clone, PartialEq)]
pub struct Architecture {
    /// One observation, `(C, H, W)`.
    pub observation: [usize; 3],
    /// Numbers in an action.
    pub action_dims: usize,
    /// Sizes of the encoders.
    pub encoder: PixelEncoderConfig,
    /// The hierarchy and how it learns.
    pub hksl: HkslConfig,
    /// The actor-critic and how it learns.
    pub sac: SacConfig,
}

impl Architecture {
    /// The hierarchy's part.
    pub fn hierarchy(&self) -> HierarchyConfig {
        HierarchyConfig {
            skips: self.hksl.skips.clone(),
            trajectory_length: self.hksl.trajectory_length,
            action_dims: self.action_dims,
            latent_dims: self.encoder.latent_dims,
            communication_hidden: self.hksl.communication_hidden,
            communication: self.hksl.communication,
            projection: self.hksl.projection,
            shared_encoder: self.hksl.shared_encoder,
        }
    }
}

/// What one learning step learns from.
#[derive(Debug, Clone)]
pub struct LearningBatch {
    /// Observations and actions.
    pub trajectories: Trajectories,
    /// `(B, k)`.
    pub rewards: Tensor,
    /// `(B, k)`, 0 where the decision process ended.
    pub not_done: Tensor,
}

/// Standard normal noise of one step, each `(B, A)`.
#[derive(Debug, Clone)]
pub struct Noise {
    /// For the next action in each level's critic target.
    pub critics: Vec<Tensor>,
    /// For the action in the actor's loss.
    pub actor: Tensor,
}

/// Which of the periodic parts a step has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schedule {
    /// Actor and temperature learn.
    pub actor: bool,
    /// Target critics and momentum encoders follow.
    pub targets: bool,
}

/// The networks, their optimisers and the learning step.
///
/// Beside the hierarchy's, the parameters are `critics.{l}`, `targets.{l}`, `actor` and `log_alpha`. Here and in arguments
/// levels are counted from 0, the finest, and a level that is not there panics; in what people read (`critic_loss_1`)
/// from 1.
#[derive(Debug)]
pub struct HkslLearner {
    architecture: Architecture,
    parameters: Parameters,
    hierarchy: Hierarchy<PixelEncoder>,
    critics: Vec<LevelCritic>,
    actor: Actor,
    frozen_actor: Actor,
    temperature: Temperature,
    optimisers: Optimisers,
    actor_adam: Adam,
    temperature_adam: Adam,
    averages: MovingAverage,
}

/// What moves encoders, forward models and critics.
#[derive(Debug)]
enum Optimisers {
    Sequential { representation: HierarchyLearner, critics: Vec<Adam> },
    Joint(JointOptimisers),
}

/// A level's critic, its twin without gradient, and its target.
#[derive(Debug)]
struct LevelCritic {
    trained: Critic,
    frozen: Critic,
    target: Critic,
}

impl HkslLearner {
    /// New networks, their weights started from the stream `init` of `seed`.
    ///
    /// # Errors
    /// A size or another setting out of range, by its key.
    pub fn new(architecture: Architecture, seed: u64, device: &Device) -> Result<Self> {
        Self::with_kernels(architecture, seed, device, Kernels::detect())
    }

    /// As [`Self::new`], computing on the CPU with these kernels.
    ///
    /// # Errors
    /// A size or another setting out of range, by its key.
    pub fn with_kernels(
        architecture: Architecture,
        seed: u64,
        device: &Device,
        kernels: Kernels,
    ) -> Result<Self> {
        let Architecture { observation, action_dims, encoder, ref hksl, ref sac } = architecture;
        hksl.validate()?;
        sac.validate()?;
        let mut parameters = Parameters::with_kernels(kernels);
        let mut rng = rng::stream(seed, "init");
        let config = architecture.hierarchy();
        let initialisation = hksl.initialisation;
        let hierarchy = Hierarchy::new(
            config.clone(),
            &mut parameters,
            &mut rng,
            initialisation,
            device,
            |builder| PixelEncoder::new(builder, observation, encoder),
        )?;
        let make = |builder: &mut Builder| {
            Critic::new(builder, encoder.latent_dims, action_dims, sac.hidden_units)
        };
        let mut critics = Vec::new();
        for level in 0..config.levels() {
            let (name, target) = (format!("critics.{level}"), format!("targets.{level}"));
            let mut builder = Builder::create(&mut parameters, &mut rng, initialisation, device);
            let trained = make(&mut builder.under(&name))?;
            parameters.copy_under(&name, &target)?;
            let mut view = Builder::view(&parameters, device);
            let frozen = make(&mut view.under(&name))?;
            critics.push(LevelCritic { trained, frozen, target: make(&mut view.under(&target))? });
        }
        let latents = config.encoders() * encoder.latent_dims;
        let make = |builder: &mut Builder| {
            Actor::new(&mut builder.under("actor"), latents, action_dims, sac)
        };
        let actor = make(&mut Builder::create(&mut parameters, &mut rng, initialisation, device))?;
        let frozen_actor = make(&mut Builder::view(&parameters, device))?;
        let temperature =
            Temperature::new(&mut parameters, sac.initial_temperature, action_dims, device)?;

        let optimisers = match hksl.update_schedule {
            UpdateSchedule::Sequential => {
                let critics = (0..config.levels()).map(|level| {
                    let encoder = hierarchy.encoder_name(hierarchy.encoder_index(level));
                    let own = parameters.under(&format!("critics.{level}"));
                    Adam::new(own.union(&parameters.under(&encoder)), sac.learning_rate)
                });
                Optimisers::Sequential {
                    representation: HierarchyLearner::new(&hierarchy, hksl.learning_rate)?,
                    critics: critics.collect::<hksl_core::Result<_>>()?,
                }
            }
            UpdateSchedule::Joint => {
                let (model_rate, rate) = (hksl.learning_rate, sac.learning_rate);
                Optimisers::Joint(JointOptimisers::new(&hierarchy, &parameters, model_rate, rate)?)
            }
        };
        let actor_adam = Adam::new(parameters.under("actor"), sac.learning_rate)?;
        let temperature_adam = Adam::new(parameters.under("log_alpha"), sac.learning_rate)?;
        let averages = (0..config.levels()).map(|level| {
            let (source, target) = (format!("critics.{level}"), format!("targets.{level}"));
            MovingAverage::new(&parameters, &source, &target, sac.critic_tau)
        });
        let averages = averages.chain([hierarchy.momentum(sac.encoder_tau)]);
        let averages = MovingAverage::together(averages.collect::<hksl_core::Result<Vec<_>>>()?);
        Ok(Self {
            parameters,
            hierarchy,
            critics,
            actor,
            frozen_actor,
            temperature,
            optimisers,
            actor_adam,
            temperature_adam,
            averages,
            architecture,
        })
    }

    /// What the networks were built for.
    pub fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// Every parameter of every network.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The encoders and forward models.
    pub fn hierarchy(&self) -> &Hierarchy<PixelEncoder> {
        &self.hierarchy
    }

    /// The policy, without gradient.
    pub fn policy(&self) -> &Actor {
        &self.frozen_actor
    }

    /// One learning step: representation and critics in the order of the update schedule, then actor,
    /// temperature and the slow networks where `schedule` has them.
    ///
    /// # Errors
    /// Tensors that do not fit the architecture, or noise for another number of critics. What came before the misfit has
    /// learnt already.
    pub fn step(
        &mut self,
        batch: &LearningBatch,
        noise: &Noise,
        schedule: Schedule,
    ) -> Result<UpdateReport> {
        self.check_noise(noise)?;
        let device = batch.rewards.device();
        parallel::inside(device, || self.step_all(batch, noise, schedule))
    }

    fn check_noise(&self, noise: &Noise) -> Result<()> {
        let (got, expected) = (noise.critics.len(), self.critics.len());
        if got != expected {
            return Err(Error::Size { what: "noise of the critics' targets", got, expected });
        }
        Ok(())
    }

    fn step_all(
        &mut self,
        batch: &LearningBatch,
        noise: &Noise,
        schedule: Schedule,
    ) -> Result<UpdateReport> {
        let mut report = UpdateReport::default();
        let mut clock = Instant::now();
        let mut encodings = None;
        if matches!(self.optimisers, Optimisers::Joint(_)) {
            let (gradients, first) = self.joint_gradients(batch, noise, &mut report, &mut clock)?;
            if let Optimisers::Joint(optimisers) = &mut self.optimisers {
                optimisers.step(&gradients)?;
            }
            encodings = Some(first);
            report.lap(Phase::Critics, &mut clock);
        } else {
            self.step_levels_and_critics(batch, noise, &mut report, &mut clock)?;
        }
        if schedule.actor {
            let (loss, log_prob) = match encodings {
                Some(latents) => self.actor_loss_at(&latents, &noise.actor)?,
                None => self.actor_loss(batch, &noise.actor)?,
            };
            self.actor_adam.step(&loss.backward()?)?;
            let temperature_loss = self.temperature_loss(&log_prob)?;
            self.temperature_adam.step(&temperature_loss.backward()?)?;
            report.add("actor_loss", loss.detach());
            report.add("entropy", log_prob.mean_all()?.neg()?);
            report.add("temperature_loss", temperature_loss.detach());
            report.add("temperature", self.temperature.alpha()?);
        }
        report.lap(Phase::Actor, &mut clock);

        if schedule.targets {
            self.averages.update()?;
        }
        report.lap(Phase::TargetNetworks, &mut clock);
        Ok(report)
    }

    /// Every level's representation, finest first, then every critic, finest first.
    fn step_levels_and_critics(
        &mut self,
        batch: &LearningBatch,
        noise: &Noise,
        report: &mut UpdateReport,
        clock: &mut Instant,
    ) -> Result<()> {
        // The momentum encodings of o_n: the critics' targets need what the levels' losses have computed.
        let mut targets: Vec<Tensor> = Vec::new();
        if let Optimisers::Sequential { representation, .. } = &mut self.optimisers
            && self.architecture.hksl.representation
        {
            let losses = representation.step(&self.hierarchy, &batch.trajectories)?;
            for (level, outcome) in losses.into_iter().enumerate() {
                report.add_level("representation_loss", level, outcome.loss);
                targets.push(outcome.targets.get(0)?);
            }
        }
        report.lap(Phase::Representation, clock);

        for (level, noise) in noise.critics.iter().enumerate() {
            let hierarchy = &self.hierarchy;
            let (first, next) = (
                batch.trajectories.at(0)?,
                batch.trajectories.at(hierarchy.config().skips[level])?,
            );
            let target = || match targets.get(level) {
                Some(latent) => {
                    self.critic_target_at(level, batch, &hierarchy.encode(&next)?, latent, noise)
                }
                None => self.critic_target(level, batch, noise),
            };
            let encode = || hierarchy.encoder(level).forward(&first);
            let (target, latent) = parallel::both(first.device(), target, encode);
            let (loss, mean_q) = self.critic_loss_at(level, batch, &latent?, &target?)?;
            let gradients = loss.backward()?;
            if let Optimisers::Sequential { critics, .. } = &mut self.optimisers {
                critics[level].step(&gradients)?;
            }
            report.add_level("critic_loss", level, loss.detach());
            report.add_level("q_mean", level, mean_q);
        }
        report.lap(Phase::Critics, clock);
        Ok(())
    }
}
