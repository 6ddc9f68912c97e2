//! The joint schedule: levels and critics learn from one sum of losses (docs/update-schedule.md).

use std::collections::BTreeMap;
use std::time::Instant;

use candle_core::Tensor;
use candle_core::backprop::GradStore;
use hksl_core::nn::PixelEncoder;
use hksl_core::optim::Adam;
use hksl_core::{Encoder, Hierarchy, Parameters};

use super::{HkslLearner, LearningBatch, Noise, Phase, UpdateReport};
use crate::Result;

/// One Adam for each encoder, for the rest of each level, and for each critic.
#[derive(Debug)]
pub(super) struct JointOptimisers(Vec<(String, Adam)>);

impl JointOptimisers {
    /// `rates`: the hierarchy's, for all but the encoders; then soft actor-critic's.
    pub(super) fn new(
        hierarchy: &Hierarchy<PixelEncoder>,
        parameters: &Parameters,
        rates: (f64, f64),
    ) -> Result<Self> {
        let (model_rate, rate) = rates;
        let config = hierarchy.config();
        let mut optimisers = Vec::new();
        for index in 0..config.encoders() {
            let own = parameters.under(&hierarchy.encoder_name(index));
            optimisers.push((format!("encoder.{index}"), Adam::new(own, rate)?));
        }
        for level in 0..config.levels() {
            let parts = ["forward_model", "communication", "projection"];
            let parts = parts.map(|part| parameters.under(&format!("levels.{level}.{part}")));
            let own = parts.iter().fold(Parameters::default(), |own, part| own.union(part));
            optimisers.push((format!("model.{level}"), Adam::new(own, model_rate)?));
            let own = parameters.under(&format!("critics.{level}"));
            optimisers.push((format!("critic.{level}"), Adam::new(own, rate)?));
        }
        Ok(Self(optimisers))
    }

    pub(super) fn step(&mut self, gradients: &GradStore) -> Result<()> {
        for (_, adam) in &mut self.0 {
            adam.step(gradients)?;
        }
        Ok(())
    }

    pub(super) fn named(&self) -> impl Iterator<Item = (String, &Adam)> {
        self.0.iter().map(|(name, adam)| (name.clone(), adam))
    }

    pub(super) fn named_mut(&mut self) -> impl Iterator<Item = (String, &mut Adam)> {
        self.0.iter_mut().map(|(name, adam)| (name.clone(), adam))
    }
}

impl HkslLearner {
    /// The gradients of the sum of all levels' and all critics' losses, with targets from the weights before
    /// the step; and the encodings of o_0 that it used, without gradient, for the actor's loss.
    pub(super) fn joint_gradients(
        &self,
        batch: &LearningBatch,
        noise: &Noise,
        report: &mut UpdateReport,
        clock: &mut Instant,
    ) -> Result<(GradStore, Tensor)> {
        let hierarchy = &self.hierarchy;
        let config = hierarchy.config();
        let first = batch.trajectories.at(0)?;
        let encodings = hierarchy.encodings(&first)?;
        let mut losses: Vec<Tensor> = Vec::new();
        let mut targets: Vec<Tensor> = Vec::new();
        if self.architecture.hksl.representation {
            let levels = hierarchy.joint_losses(&batch.trajectories, &encodings)?;
            for (level, outcome) in levels.into_iter().enumerate() {
                report.add_level("representation_loss", level, outcome.loss.detach());
                targets.push(outcome.targets.get(0)?);
                losses.push(outcome.loss);
            }
        }
        report.lap(Phase::Representation, clock);

        // Levels that skip equally many transitions look at the same next observation.
        let mut next_latents: BTreeMap<usize, Tensor> = BTreeMap::new();
        for (level, noise) in noise.critics.iter().enumerate() {
            let n = config.skips[level];
            let next = batch.trajectories.at(n)?;
            let latents = match next_latents.get(&n) {
                Some(latents) => latents.clone(),
                None => hierarchy.encode(&next)?,
            };
            next_latents.insert(n, latents.clone());
            let latent = match targets.get(level) {
                Some(latent) => latent.clone(),
                None => hierarchy.momentum_encoder(level).forward(&next)?,
            };
            let target = self.critic_target_at(level, batch, &latents, &latent, noise)?;
            let latent = &encodings[hierarchy.encoder_index(level)];
            let (loss, mean_q) = self.critic_loss_at(level, batch, latent, &target)?;
            report.add_level("critic_loss", level, loss.detach());
            report.add_level("q_mean", level, mean_q);
            losses.push(loss);
        }
        let gradients = Tensor::stack(&losses, 0)?.sum_all()?.backward()?;
        let encodings: Vec<Tensor> = encodings.iter().map(Tensor::detach).collect();
        Ok((gradients, Tensor::cat(&encodings, 1)?))
    }
}
