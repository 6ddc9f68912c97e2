//! Diagnostic metrics: gradient norms by level and loss, spread and rank of the latents, saturated actions.

use hksl_core::Encoder;
use hksl_core::optim::gradient_norm;

use super::{Hksl, Noise};
use crate::Result;
use crate::diagnosis::{saturated, spread};
use crate::draw::LearningBatch;

impl Hksl {
    /// Diagnostic metrics on a batch, by name. No weight changes. `docs/metrics.md` defines each metric.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub(super) fn diagnose_batch(
        &self,
        batch: &LearningBatch,
        noise: &Noise,
    ) -> Result<Vec<(String, f64)>> {
        let mut figures = Vec::new();
        for level in 0..self.hierarchy.config().levels() {
            let encoder = self.hierarchy.encoder_name(self.hierarchy.encoder_index(level));
            let encoder_parameters = self.networks.parameters.under(&encoder);
            let mut add = |name: &str, figure: f64| {
                figures.push((format!("{name}_{}", level + 1), figure));
            };
            if self.architecture.hksl.representation {
                let loss = self.hierarchy.level_loss(level, &batch.trajectories)?.loss;
                add(
                    "representation_gradient",
                    gradient_norm(&encoder_parameters, &loss.backward()?)?,
                );
            }
            let target = self.critic_target(level, batch, &noise.critics[level])?;
            let latent = self.hierarchy.encoder(level).forward(&batch.trajectories.at(0)?)?;
            let (loss, _) = self.critic_loss(level, batch, &latent, &target)?;
            add("critic_gradient", gradient_norm(&encoder_parameters, &loss.backward()?)?);
            let encoder = self.hierarchy.frozen_encoder(self.hierarchy.encoder_index(level));
            let (spread, rank) = spread(&encoder.forward(&batch.trajectories.at(0)?)?)?;
            add("latent_std", spread);
            add("latent_rank", rank);
        }
        let latents = self.hierarchy.encode(&batch.trajectories.at(0)?)?;
        let action = self.frozen_actor.sample(&latents, &noise.actor)?.action;
        figures.push(("saturated_actions".to_owned(), saturated(&action)?));
        Ok(figures)
    }
}
