//! Diagnostic metrics.

use candle_core::Tensor;
use hksl_core::Encoder;
use hksl_core::optim::gradient_norm;
use hksl_sac::diagnosis::{saturated, spread};
use hksl_sac::{Draw, Result};

use super::{ActorCritic, Architecture};
use crate::Transitions;

impl ActorCritic {
    /// Computes diagnostic metrics by name on a batch from `draw`: gradient norms at the encoder, spread and rank of the
    /// latents, saturated actions. `auxiliary` draws another batch and computes the method's further losses that train
    /// the encoder.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn diagnose(
        &self,
        draw: &mut Draw,
        auxiliary: impl FnOnce(&mut Draw) -> Result<Vec<(&'static str, Tensor)>>,
    ) -> Result<Vec<(String, f64)>> {
        let Architecture { sac, action_dims, .. } = &self.architecture;
        let Some(starts) = draw.starts(sac.batch_size, 1) else { return Ok(Vec::new()) };
        let batch = Transitions::first_of(&draw.batch(&starts, 1)?)?;
        let noise = draw.normal(&[sac.batch_size, *action_dims])?;
        let target = self.critic_target(&batch, &batch.next_observations, &noise)?;
        let views = std::slice::from_ref(&batch.observations);
        let encoder = self.networks.parameters.under("encoder");
        let gradient =
            |loss: &Tensor| -> Result<f64> { Ok(gradient_norm(&encoder, &loss.backward()?)?) };
        let mut figures = Vec::new();
        let (loss, _) = self.critic_loss(views, &batch.actions, &target)?;
        figures.push(("critic_gradient".to_owned(), gradient(&loss)?));
        for (name, loss) in auxiliary(draw)? {
            figures.push((format!("{name}_gradient"), gradient(&loss)?));
        }
        let (std, rank) = spread(&self.frozen_encoder.forward(&batch.observations)?)?;
        figures.extend([("latent_std".to_owned(), std), ("latent_rank".to_owned(), rank)]);
        let actions = self.sample_action(&batch.observations, &noise)?.action;
        figures.push(("saturated_actions".to_owned(), saturated(&actions)?));
        Ok(figures)
    }
}
