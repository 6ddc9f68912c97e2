//! The joint schedule: levels and critics learn side by side from one forward pass (docs/update-schedule.md).

use std::collections::BTreeMap;
use std::time::Instant;

use candle_core::Tensor;
use candle_core::backprop::GradStore;
use hksl_core::nn::PixelEncoder;
use hksl_core::optim::Adam;
use hksl_core::{Encoder, Hierarchy, HierarchyLearner, Parameters, parallel};

use super::{HkslLearner, LearningBatch, Noise, Phase, UpdateReport};
use crate::Result;

/// The hierarchy's optimisers, one for each critic, and a second one for each encoder: an encoder follows its model and
/// its critic each by moments and a learning rate of their own.
#[derive(Debug)]
pub(super) struct JointOptimisers {
    representation: HierarchyLearner,
    critics: Vec<(String, Adam)>,
}

/// Gradients of the models' losses, if there are models, and of the critics'.
pub(super) struct JointGradients {
    representation: Option<GradStore>,
    critics: GradStore,
}

impl JointOptimisers {
    /// `model_rate` is that of the hierarchy's optimisers, `rate` that of critics and of the encoders under them.
    pub(super) fn new(
        hierarchy: &Hierarchy<PixelEncoder>,
        parameters: &Parameters,
        model_rate: f64,
        rate: f64,
    ) -> Result<Self> {
        let config = hierarchy.config();
        let mut critics = Vec::new();
        for index in 0..config.encoders() {
            let own = parameters.under(&hierarchy.encoder_name(index));
            critics.push((format!("encoder.{index}"), Adam::new(own, rate)?));
        }
        for level in 0..config.levels() {
            let own = parameters.under(&format!("critics.{level}"));
            critics.push((format!("critic.{level}"), Adam::new(own, rate)?));
        }
        let representation = HierarchyLearner::new(hierarchy, model_rate)?;
        Ok(Self { representation, critics })
    }

    pub(super) fn step(&mut self, gradients: &JointGradients) -> Result<()> {
        if let Some(gradients) = &gradients.representation {
            self.representation.step_once(gradients)?;
        }
        for (_, adam) in &mut self.critics {
            adam.step(&gradients.critics)?;
        }
        Ok(())
    }

    pub(super) fn named(&self) -> impl Iterator<Item = (String, &Adam)> {
        let representation = self.representation.optimisers();
        let representation =
            representation.map(|(name, adam)| (format!("representation.{name}"), adam));
        representation.chain(self.critics.iter().map(|(name, adam)| (name.clone(), adam)))
    }

    pub(super) fn named_mut(&mut self) -> impl Iterator<Item = (String, &mut Adam)> {
        let representation = self.representation.optimisers_mut();
        let representation =
            representation.map(|(name, adam)| (format!("representation.{name}"), adam));
        representation.chain(self.critics.iter_mut().map(|(name, adam)| (name.clone(), adam)))
    }
}

impl HkslLearner {
    /// The gradients of the sum of all levels' losses and of the sum of all critics', with targets from the weights
    /// before the step; and the encodings of o_0 that both used, without gradient, for the actor's loss.
    pub(super) fn joint_gradients(
        &self,
        batch: &LearningBatch,
        noise: &Noise,
        report: &mut UpdateReport,
        clock: &mut Instant,
    ) -> Result<(JointGradients, Tensor)> {
        let hierarchy = &self.hierarchy;
        let config = hierarchy.config();
        let first = batch.trajectories.at(0)?;
        let encodings = hierarchy.encodings(&first)?;
        let (mut models, mut critics): (Vec<Tensor>, Vec<Tensor>) = Default::default();
        let mut targets: Vec<Tensor> = Vec::new();
        if self.architecture.hksl.representation {
            let levels = hierarchy.joint_losses(&batch.trajectories, &encodings)?;
            for (level, outcome) in levels.into_iter().enumerate() {
                report.add_level("representation_loss", level, outcome.loss.detach());
                targets.push(outcome.targets.get(0)?);
                models.push(outcome.loss);
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
            critics.push(loss);
        }
        let of_sum =
            |losses: &[Tensor]| Ok(Tensor::stack(losses, 0)?.sum_all()?.backward()?) as Result<_>;
        let (representation, critics) = parallel::both(
            first.device(),
            || (!models.is_empty()).then(|| of_sum(&models)).transpose(),
            || of_sum(&critics),
        );
        let gradients = JointGradients { representation: representation?, critics: critics? };
        let encodings: Vec<Tensor> = encodings.iter().map(Tensor::detach).collect();
        Ok((gradients, Tensor::cat(&encodings, 1)?))
    }
}
