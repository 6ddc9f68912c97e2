//! HKSL: Algorithm 1 of the paper and section 4, with soft actor-critic.
//!
//! Levels are numbered from 0, the finest, in code and from 1 in output. `z` are encodings, `n = n^l` the transitions that
//! level `l` skips, `o_0 … o_k` a trajectory's observations.

mod diagnosis;
mod learner;
mod memory;
mod networks;
mod operations;

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

/// Standard normal noise of one step, each `(B, A)`.
#[derive(Debug, Clone)]
pub struct Noise {
    /// For the next action in each level's critic target.
    pub critics: Vec<Tensor>,
    /// For the action in the actor's loss.
    pub actor: Tensor,
}

/// The periodic parts of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schedule {
    /// Whether actor and temperature learn.
    pub actor: bool,
    /// Whether target critics and momentum encoders are updated.
    pub targets: bool,
}

impl Hksl {
    /// `B` trajectories of `k` transitions and the noise of a step. None while nothing can be sampled.
    fn sample(&self, draw: &mut Draw) -> Result<Option<(LearningBatch, Noise)>> {
        let Architecture { hksl, sac, action_dims, .. } = &self.architecture;
        let (count, length) = (sac.batch_size, hksl.trajectory_length);
        let Some(starts) = draw.starts(count, length) else { return Ok(None) };
        let batch = draw.batch(&starts, length)?;
        let shape = [count, *action_dims];
        let critics = hksl.skips.iter().map(|_| draw.normal(&shape)).collect::<Result<_>>()?;
        Ok(Some((batch, Noise { critics, actor: draw.normal(&shape)? })))
    }

    /// One learning step: representation and critics in the order of the update schedule, then actor, temperature and
    /// targets where `schedule` has them.
    ///
    /// # Errors
    /// Tensors that do not fit the architecture, or noise for another number of critics. Parts before the misfit have
    /// learnt already.
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

    /// The representation, finest level first (eq. 1): each level's loss is computed with the weights as the levels
    /// before it left them, and trains that level and every level above it, through which its contexts came. Returns each
    /// level's momentum encoding of `o_n`, which the critics' targets need; nothing without representation learning.
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

    /// The critics, finest level first. A target sees the encoders as the levels before it left them.
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

    /// The `joint` schedule (docs/update-schedule.md): all levels and critics from one forward pass, with targets from the
    /// weights before the step. An encoder steps once along the models' gradient and once along the critics', with an
    /// Adam for each. Returns the encodings of `o_0`, detached, for the actor.
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

        // Levels that skip equally many transitions look at the same next observation.
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
        let of_sum =
            |losses: &[Tensor]| Ok(Tensor::stack(losses, 0)?.sum_all()?.backward()?) as Result<_>;
        let (models, critics) = parallel::both(
            first.device(),
            || (!model_losses.is_empty()).then(|| of_sum(&model_losses)).transpose(),
            || of_sum(&critic_losses),
        );
        let critics = critics?;
        if let Some(gradients) = models? {
            self.optimizers.representation.step_once(&gradients)?;
        }
        self.optimizers.critics.iter_mut().try_for_each(|(_, adam)| adam.step(&critics))?;
        report.lap(Phase::Critics, clock);
        Ok(Tensor::cat(&encodings, 1)?.detach())
    }

    /// The actor, then the temperature on the log-densities from before the actor's step.
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
    /// `y = Σ_{j<n} γ^j m_j r_j + γ^n m_n (min(Q̄1, Q̄2)(e_m(o_n), a') − α log π(a'|·))` with `a'` from the policy, `(B, 1)`
    /// without gradient.
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

    /// [`Self::critic_target`] from encodings of `o_n`: the actor's input and the level's momentum encoding.
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

    /// `mse(Q1(z, a_0), y) + mse(Q2(z, a_0), y)` with `z` the level's encoding of `o_0`, and the mean value. A gradient
    /// reaches the critic and, through `z`, the encoder.
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

    /// `mean(α log π(a|z) − Σ_l min(Q1^l, Q2^l)(z^l, a))` and the log-densities `(B, 1)`. A gradient reaches the actor
    /// alone; `latents` are encodings of `o_0` without gradient, `(B, h·Z)`.
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

    /// `n^l`.
    fn skip(&self, level: usize) -> usize {
        self.architecture.hksl.skips[level]
    }
}
