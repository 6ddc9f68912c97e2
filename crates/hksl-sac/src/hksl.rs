//! HKSL with soft actor-critic: algorithm 1 and section 4 of the paper.
//!
//! Levels are numbered from 0 in code and from 1 in output; the first level is the finest. `z` is an encoding, `n = n^l` the
//! skip of level `l`, `o_0 … o_k` the observations of a trajectory.

mod diagnosis;
mod learner;
mod networks;

use std::collections::BTreeMap;
use std::time::Instant;

use candle_core::{D, Tensor};
use hksl_core::hierarchy::LevelLoss;
use hksl_core::{Encoder, Trajectories, parallel};

pub use networks::{Architecture, Hksl};

use crate::actor::Sampled;
use crate::config::UpdateSchedule;
use crate::critic::n_step_return;
use crate::draw::{Draw, LearningBatch};
use crate::update_report::{Phase, UpdateReport};
use crate::{Error, Result};

/// The standard normal noise of one learning step. Each tensor is `(B, A)`.
#[derive(Debug, Clone)]
pub struct Noise {
    /// Noise for the next action in each level's critic target.
    pub critics: Vec<Tensor>,
    /// Noise for the action in the actor loss.
    pub actor: Tensor,
}

/// The periodic updates due in a learning step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schedule {
    /// Whether to update actor and temperature.
    pub actor: bool,
    /// Whether to update target critics and momentum encoders.
    pub targets: bool,
}

impl Hksl {
    /// Draws `B` trajectories of `k` transitions and the noise of a step. Returns None if the replay has no trajectory to
    /// sample.
    fn sample(&self, draw: &mut Draw) -> Result<Option<(LearningBatch, Noise)>> {
        let Architecture { hksl, sac, action_dims, .. } = &self.architecture;
        let (count, length) = (sac.batch_size, hksl.trajectory_length);
        let Some(starts) = draw.starts(count, length) else { return Ok(None) };
        let batch = draw.batch(&starts, length)?;
        let shape = [count, *action_dims];
        let critics = hksl.skips.iter().map(|_| draw.normal(&shape)).collect::<Result<_>>()?;
        Ok(Some((batch, Noise { critics, actor: draw.normal(&shape)? })))
    }

    /// Takes one learning step: updates representation and critics in the order of the update schedule, then actor,
    /// temperature and targets if `schedule` has them due.
    ///
    /// # Errors
    /// Tensors whose shapes do not fit the architecture, or noise for another number of critics. Updates made before the
    /// error remain.
    pub fn step(
        &mut self,
        batch: &LearningBatch,
        noise: &Noise,
        schedule: Schedule,
    ) -> Result<UpdateReport> {
        let (got, expected) = (noise.critics.len(), self.critics.len());
        if got != expected {
            return Err(Error::Size { what: "noise of the critics' targets", got, expected });
        }
        parallel::inside(batch.rewards.device(), || {
            let (mut report, mut clock) = (UpdateReport::default(), Instant::now());
            let latents = match self.architecture.hksl.update_schedule {
                UpdateSchedule::Sequential => {
                    let targets = self.learn_levels(&batch.trajectories, &mut report)?;
                    report.lap(Phase::Representation, &mut clock);
                    self.learn_critics(batch, noise, &targets, &mut report)?;
                    report.lap(Phase::Critics, &mut clock);
                    None
                }
                UpdateSchedule::Joint => {
                    Some(self.learn_jointly(batch, noise, &mut report, &mut clock)?)
                }
            };
            if schedule.actor {
                let encode = || self.hierarchy.encode(&batch.trajectories.at(0)?);
                let latents = latents.map_or_else(encode, Ok)?;
                self.learn_actor(&latents, &noise.actor, &mut report)?;
            }
            report.lap(Phase::Actor, &mut clock);
            if schedule.targets {
                self.averages.update()?;
            }
            report.lap(Phase::TargetNetworks, &mut clock);
            Ok(report)
        })
    }

    /// Updates the representation, finest level first (eq. 1). Each level's loss uses the weights after the updates of the
    /// finer levels. The loss trains its level and all coarser levels, whose contexts it uses. Returns each level's
    /// momentum encoding of `o_n` for the critic targets, or an empty list without representation learning.
    fn learn_levels(
        &mut self,
        trajectories: &Trajectories,
        report: &mut UpdateReport,
    ) -> Result<Vec<Tensor>> {
        let levels = if self.architecture.hksl.representation { self.critics.len() } else { 0 };
        let mut next_latents = Vec::new();
        for level in 0..levels {
            let LevelLoss { loss, targets, .. } = self.hierarchy.level_loss(level, trajectories)?;
            self.optimizers.representation.step_level(level, &loss.backward()?)?;
            report.add_level("representation_loss", level, loss.detach());
            next_latents.push(targets.get(0)?);
        }
        Ok(next_latents)
    }

    /// Updates the critics, finest level first. Each target uses the encoders after the updates of the finer levels.
    fn learn_critics(
        &mut self,
        batch: &LearningBatch,
        noise: &Noise,
        next_latents: &[Tensor],
        report: &mut UpdateReport,
    ) -> Result<()> {
        let first = batch.trajectories.at(0)?;
        for (level, noise) in noise.critics.iter().enumerate() {
            let target = || match next_latents.get(level) {
                Some(latent) => {
                    let next = batch.trajectories.at(self.skip(level))?;
                    let latents = self.hierarchy.encode(&next)?;
                    self.critic_target_at(level, batch, &latents, latent, noise)
                }
                None => self.critic_target(level, batch, noise),
            };
            let encode = || self.hierarchy.encoder(level).forward(&first);
            let (target, latent) = parallel::both(first.device(), target, encode);
            let (loss, mean_q) = self.critic_loss(level, batch, &latent?, &target?)?;
            let gradients = loss.backward()?;
            self.optimizers.critics[level].1.step(&gradients)?;
            report.add_level("critic_loss", level, loss.detach());
            report.add_level("q_mean", level, mean_q);
        }
        Ok(())
    }

    /// The `joint` schedule (docs/update-schedule.md): updates all levels and critics from one forward pass. Targets use the
    /// weights before the step. Each encoder has two Adam optimisers: one steps along the gradient of the representation
    /// losses, the other along the gradient of the critic losses. Returns the encodings of `o_0`, detached, for the actor.
    fn learn_jointly(
        &mut self,
        batch: &LearningBatch,
        noise: &Noise,
        report: &mut UpdateReport,
        clock: &mut Instant,
    ) -> Result<Tensor> {
        let hierarchy = &self.hierarchy;
        let first = batch.trajectories.at(0)?;
        let encodings = hierarchy.encodings(&first)?;
        let (mut model_losses, mut critic_losses) = (Vec::new(), Vec::new());
        let mut next_latents: Vec<Tensor> = Vec::new();
        if self.architecture.hksl.representation {
            let levels = hierarchy.joint_losses(&batch.trajectories, &encodings)?;
            for (level, LevelLoss { loss, targets, .. }) in levels.into_iter().enumerate() {
                report.add_level("representation_loss", level, loss.detach());
                next_latents.push(targets.get(0)?);
                model_losses.push(loss);
            }
        }
        report.lap(Phase::Representation, clock);

        // Levels with equal skips share the encodings of their next observation.
        let mut encoded: BTreeMap<usize, Tensor> = BTreeMap::new();
        for (level, noise) in noise.critics.iter().enumerate() {
            let n = self.skip(level);
            let next = batch.trajectories.at(n)?;
            let latents = match encoded.get(&n) {
                Some(latents) => latents.clone(),
                None => hierarchy.encode(&next)?,
            };
            encoded.insert(n, latents.clone());
            let latent = match next_latents.get(level) {
                Some(latent) => latent.clone(),
                None => hierarchy.momentum_encoder(level).forward(&next)?,
            };
            let target = self.critic_target_at(level, batch, &latents, &latent, noise)?;
            let latent = &encodings[hierarchy.encoder_index(level)];
            let (loss, mean_q) = self.critic_loss(level, batch, latent, &target)?;
            report.add_level("critic_loss", level, loss.detach());
            report.add_level("q_mean", level, mean_q);
            critic_losses.push(loss);
        }
        let sum_gradients =
            |losses: &[Tensor]| Ok(Tensor::stack(losses, 0)?.sum_all()?.backward()?) as Result<_>;
        let (models, critics) = parallel::both(
            first.device(),
            || (!model_losses.is_empty()).then(|| sum_gradients(&model_losses)).transpose(),
            || sum_gradients(&critic_losses),
        );
        let critics = critics?;
        if let Some(gradients) = models? {
            self.optimizers.representation.step_once(&gradients)?;
        }
        self.optimizers.critics.iter_mut().try_for_each(|(_, adam)| adam.step(&critics))?;
        report.lap(Phase::Critics, clock);
        Ok(Tensor::cat(&encodings, 1)?.detach())
    }

    /// Updates the actor, then the temperature. Both losses use the log-densities from before the actor's step.
    fn learn_actor(
        &mut self,
        latents: &Tensor,
        noise: &Tensor,
        report: &mut UpdateReport,
    ) -> Result<()> {
        let (loss, log_prob) = self.actor_loss(latents, noise)?;
        self.optimizers.actor.step(&loss.backward()?)?;
        let temperature_loss = self.temperature.loss(&log_prob)?;
        self.optimizers.temperature.step(&temperature_loss.backward()?)?;
        report.add("actor_loss", loss.detach());
        report.add("entropy", log_prob.mean_all()?.neg()?);
        report.add("temperature_loss", temperature_loss.detach());
        report.add("temperature", self.temperature.alpha()?);
        Ok(())
    }
}

impl Hksl {
    /// The critic target `y = Σ_{j<n} γ^j m_j r_j + γ^n m_n (min(Q̄1, Q̄2)(e_m(o_n), a') − α log π(a'|·))`, where `a'` is
    /// sampled from the policy. `(B, 1)`, without gradient.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn critic_target(
        &self,
        level: usize,
        batch: &LearningBatch,
        noise: &Tensor,
    ) -> Result<Tensor> {
        let next = batch.trajectories.at(self.skip(level))?;
        let latent = self.hierarchy.momentum_encoder(level).forward(&next)?;
        self.critic_target_at(level, batch, &self.hierarchy.encode(&next)?, &latent, noise)
    }

    /// The target of [`Self::critic_target`], computed from given encodings of `o_n`: the actor's input `latents` and the
    /// level's momentum encoding `latent`.
    fn critic_target_at(
        &self,
        level: usize,
        batch: &LearningBatch,
        latents: &Tensor,
        latent: &Tensor,
        noise: &Tensor,
    ) -> Result<Tensor> {
        let Sampled { action, log_prob } = self.frozen_actor.sample(latents, noise)?;
        let min_q = self.critics[level].target.min_q(latent, &action)?;
        let value = (min_q - self.temperature.cost(&log_prob)?)?;
        let (n, discount) = (self.skip(level), self.architecture.sac.discount);
        n_step_return(&batch.rewards, &batch.not_done, &value, n, discount)
    }

    /// The critic loss `mse(Q1(z, a_0), y) + mse(Q2(z, a_0), y)`, where `z` is the level's encoding of `o_0`, and the mean
    /// Q-value. The gradient reaches the critic and, through `z`, the encoder.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn critic_loss(
        &self,
        level: usize,
        batch: &LearningBatch,
        latent: &Tensor,
        target: &Tensor,
    ) -> Result<(Tensor, Tensor)> {
        let action = batch.trajectories.actions.narrow(1, 0, 1)?.squeeze(1)?;
        self.critics[level].trained.loss(latent, &action, target)
    }

    /// The actor loss `mean(α log π(a|z) − Σ_l min(Q1^l, Q2^l)(z^l, a))` and the log-densities `(B, 1)`. The gradient reaches
    /// the actor alone. `latents` are the encodings of `o_0` without gradient, `(B, h·Z)`.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn actor_loss(&self, latents: &Tensor, noise: &Tensor) -> Result<(Tensor, Tensor)> {
        let Sampled { action, log_prob } = self.actor.sample(latents, noise)?;
        let dims = self.architecture.encoder.latent_dims;
        let mut loss = self.temperature.cost(&log_prob)?;
        for (level, critic) in self.critics.iter().enumerate() {
            let index = self.hierarchy.encoder_index(level);
            let latent = latents.narrow(D::Minus1, index * dims, dims)?;
            loss = (loss - critic.frozen.min_q(&latent, &action)?)?;
        }
        Ok((loss.mean_all()?, log_prob.detach()))
    }

    /// The skip `n^l` of a level.
    fn skip(&self, level: usize) -> usize {
        self.architecture.hksl.skips[level]
    }
}
