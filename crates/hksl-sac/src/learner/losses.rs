//! Targets and losses of critics, actor and temperature.

use candle_core::{D, Tensor};
use hksl_core::Encoder;

use super::{HkslLearner, LearningBatch};
use crate::Result;
use crate::actor::Sampled;
use crate::critic::n_step_return;

impl HkslLearner {
    /// What critic `level` learns to predict, `(B, 1)` without gradient: the level's n-step return, with
    /// the value of the target critic on the level's momentum encoding, less the entropy's cost.
    pub fn critic_target(
        &self,
        level: usize,
        batch: &LearningBatch,
        noise: &Tensor,
    ) -> Result<Tensor> {
        let next = batch.trajectories.at(self.hierarchy.config().skips[level])?;
        let latent = self.hierarchy.momentum_encoder(level).forward(&next)?;
        self.critic_target_at(level, batch, &self.hierarchy.encode(&next)?, &latent, noise)
    }

    /// As [`Self::critic_target`], from encodings of o_n that are there already: the actor's input and the
    /// level's momentum encoding.
    pub(super) fn critic_target_at(
        &self,
        level: usize,
        batch: &LearningBatch,
        latents: &Tensor,
        latent: &Tensor,
        noise: &Tensor,
    ) -> Result<Tensor> {
        let n = self.hierarchy.config().skips[level];
        let Sampled { action, log_prob } = self.frozen_actor.sample(latents, noise)?;
        let smaller = self.critics[level].target.smaller(latent, &action)?;
        let value = (smaller - self.temperature.cost(&log_prob)?)?;
        n_step_return(&batch.rewards, &batch.not_done, &value, n, self.architecture.sac.discount)
    }

    /// The loss of critic `level` against a target, and the mean of its two values: a gradient reaches the
    /// critic and the level's encoder.
    pub fn critic_loss(
        &self,
        level: usize,
        batch: &LearningBatch,
        target: &Tensor,
    ) -> Result<(Tensor, Tensor)> {
        let latent = self.hierarchy.encoder(level).forward(&batch.trajectories.at(0)?)?;
        self.critic_loss_at(level, batch, &latent, target)
    }

    pub(super) fn critic_loss_at(
        &self,
        level: usize,
        batch: &LearningBatch,
        latent: &Tensor,
        target: &Tensor,
    ) -> Result<(Tensor, Tensor)> {
        let action = batch.trajectories.actions.narrow(1, 0, 1)?.squeeze(1)?;
        self.critics[level].trained.loss(latent, &action, target)
    }

    /// The actor's loss `mean(α log π − Σ_l min(Q1^l, Q2^l))` and its log-densities `(B, 1)`: a gradient
    /// reaches the actor alone.
    pub fn actor_loss(&self, batch: &LearningBatch, noise: &Tensor) -> Result<(Tensor, Tensor)> {
        self.actor_loss_at(&self.hierarchy.encode(&batch.trajectories.at(0)?)?, noise)
    }

    /// As [`Self::actor_loss`], from encodings of o_0 that are there already.
    pub(super) fn actor_loss_at(
        &self,
        latents: &Tensor,
        noise: &Tensor,
    ) -> Result<(Tensor, Tensor)> {
        let Sampled { action, log_prob } = self.actor.sample(latents, noise)?;
        let dims = self.architecture.encoder.latent_dims;
        let mut loss = self.temperature.cost(&log_prob)?;
        for (level, critic) in self.critics.iter().enumerate() {
            let index = self.hierarchy.encoder_index(level);
            let latent = latents.narrow(D::Minus1, index * dims, dims)?;
            loss = (loss - critic.frozen.smaller(&latent, &action)?)?;
        }
        Ok((loss.mean_all()?, log_prob.detach()))
    }

    /// The temperature's loss on these log-densities.
    pub fn temperature_loss(&self, log_prob: &Tensor) -> Result<Tensor> {
        self.temperature.loss(log_prob)
    }
}
