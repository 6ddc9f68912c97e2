//! What tells why a learning curve looks as it does: gradients by level and loss, latents that collapse, policies
//! that saturate.

use candle_core::backprop::GradStore;
use candle_core::{D, DType, Tensor};
use hksl_core::Encoder;

use super::{HkslLearner, LearningBatch, Noise};
use crate::Result;

/// An action's number counts as saturated beyond this.
const SATURATED: f64 = 0.95;

impl HkslLearner {
    /// Figures on this batch, by name; nothing learns. `docs/metrics.md` defines each.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn diagnose(&self, batch: &LearningBatch, noise: &Noise) -> Result<Vec<(String, f64)>> {
        let mut figures = Vec::new();
        for level in 0..self.hierarchy.config().levels() {
            let mut add = |name: &str, figure: f64| {
                figures.push((format!("{name}_{}", level + 1), figure));
            };
            if self.architecture.hksl.representation {
                let loss = self.hierarchy.level_loss(level, &batch.trajectories)?.loss;
                add("representation_gradient", self.encoder_gradient(level, &loss.backward()?)?);
            }
            let target = self.critic_target(level, batch, &noise.critics[level])?;
            let (loss, _) = self.critic_loss(level, batch, &target)?;
            add("critic_gradient", self.encoder_gradient(level, &loss.backward()?)?);
            let encoder = self.hierarchy.frozen_encoder(self.hierarchy.encoder_index(level));
            let (spread, rank) = spread(&encoder.forward(&batch.trajectories.at(0)?)?)?;
            add("latent_std", spread);
            add("latent_rank", rank);
        }
        let latents = self.hierarchy.encode(&batch.trajectories.at(0)?)?;
        let action = self.frozen_actor.sample(&latents, &noise.actor)?.action;
        let saturated = action.abs()?.gt(SATURATED)?.to_dtype(DType::F64)?.mean_all()?;
        figures.push(("saturated_actions".to_owned(), saturated.to_scalar()?));
        Ok(figures)
    }

    /// The mean of both critics of `level` at these observations and actions, `(B)`, without gradient.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn values(
        &self,
        level: usize,
        observations: &Tensor,
        actions: &Tensor,
    ) -> Result<Vec<f64>> {
        let encoder = self.hierarchy.frozen_encoder(self.hierarchy.encoder_index(level));
        let latents = encoder.forward(observations)?;
        let (q1, q2) = self.critics[level].frozen.forward(&latents, actions)?;
        Ok((((q1 + q2)? * 0.5)?).flatten_all()?.to_dtype(DType::F64)?.to_vec1()?)
    }

    /// The Euclidean norm of a gradient towards a level's encoder.
    fn encoder_gradient(&self, level: usize, gradients: &GradStore) -> Result<f64> {
        let name = self.hierarchy.encoder_name(self.hierarchy.encoder_index(level));
        let mut squares = 0.0;
        for (_, parameter) in self.parameters.under(&name).iter() {
            if let Some(gradient) = gradients.get(parameter) {
                squares += gradient.sqr()?.sum_all()?.to_dtype(DType::F64)?.to_scalar::<f64>()?;
            }
        }
        Ok(squares.sqrt())
    }
}

/// Of latents `(B, Z)`: the mean over dimensions of the standard deviation over the batch, and in how many directions
/// they spread: `(Σ λ)² / Σ λ²` over the eigenvalues of their covariance, from 1, a line, to `Z`, a ball; 0 for a
/// point.
fn spread(latents: &Tensor) -> Result<(f64, f64)> {
    let latents = latents.to_dtype(DType::F64)?;
    let count = latents.dim(0)? as f64;
    let centred = latents.broadcast_sub(&latents.mean_keepdim(0)?)?;
    let covariance = (centred.t()?.matmul(&centred)? / count)?;
    let deviations = (centred.sqr()?.sum(0)? / count)?.sqrt()?;
    let trace = centred.sqr()?.sum_all()?.to_scalar::<f64>()? / count;
    let squares = covariance.sqr()?.sum_all()?.to_scalar::<f64>()?;
    let rank = if squares > 0.0 { trace * trace / squares } else { 0.0 };
    Ok((deviations.mean(D::Minus1)?.to_scalar()?, rank))
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::*;

    #[test]
    fn counts_the_directions_of_a_spread() {
        let spread = |numbers: &[f32]| {
            let rows = (numbers.len() / 2, 2);
            spread(&Tensor::from_slice(numbers, rows, &Device::Cpu).unwrap()).unwrap()
        };
        // A point, a line, and two directions of equal width.
        assert_eq!(spread(&[3.0, 1.0, 3.0, 1.0]), (0.0, 0.0));
        let (std, rank) = spread(&[1.0, 2.0, -1.0, -2.0]);
        assert!((std - 1.5).abs() < 1e-12 && (rank - 1.0).abs() < 1e-12);
        let (std, rank) = spread(&[1.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, -1.0]);
        assert!((std - 0.5f64.sqrt()).abs() < 1e-12 && (rank - 2.0).abs() < 1e-12);
    }
}
