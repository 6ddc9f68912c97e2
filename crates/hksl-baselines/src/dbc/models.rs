//! DBC's transition models and reward model.

use candle_core::{D, Tensor};
use hksl_core::Builder;
use hksl_core::nn::{LayerNorm, Linear};
use hksl_sac::Result;

use crate::config::{DbcConfig, Transition};

/// Minimum and maximum of the standard deviation of a predicted latent.
const DEVIATIONS: (f64, f64) = (1e-4, 10.0);

/// A hidden layer with layer normalisation and ReLU.
///
/// Parameters: `hidden.{weight, bias}`, `norm.{weight, bias}`.
#[derive(Debug)]
struct Hidden {
    linear: Linear,
    norm: LayerNorm,
}

impl Hidden {
    fn new(builder: &mut Builder, inputs: usize, units: usize) -> Result<Self> {
        let linear = Linear::new(&mut builder.under("hidden"), inputs, units)?;
        Ok(Self { linear, norm: LayerNorm::new(&mut builder.under("norm"), units)? })
    }

    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        Ok(self.norm.forward(&self.linear.forward(x)?)?.relu()?)
    }
}

/// Predicts a Gaussian of the next latent from a latent and an action.
///
/// Parameters: those of [`Hidden`], `mean.{weight, bias}` and, except in deterministic models, `scale.{weight, bias}`.
#[derive(Debug)]
struct TransitionModel {
    hidden: Hidden,
    mean: Linear,
    scale: Option<Linear>,
}

impl TransitionModel {
    fn new(
        builder: &mut Builder,
        latent_dims: usize,
        action_dims: usize,
        config: &DbcConfig,
    ) -> Result<Self> {
        let units = config.model_units;
        let hidden = Hidden::new(builder, latent_dims + action_dims, units)?;
        let mean = Linear::new(&mut builder.under("mean"), units, latent_dims)?;
        let scale = match config.transition {
            Transition::Deterministic => None,
            Transition::Probabilistic | Transition::Ensemble => {
                Some(Linear::new(&mut builder.under("scale"), units, latent_dims)?)
            }
        };
        Ok(Self { hidden, mean, scale })
    }

    /// Mean and standard deviation, `(B, Z)` each. The deviation of a deterministic model is 1.
    fn forward(&self, x: &Tensor) -> Result<(Tensor, Tensor)> {
        let hidden = self.hidden.forward(x)?;
        let mean = self.mean.forward(&hidden)?;
        let deviation = match &self.scale {
            None => mean.ones_like()?,
            Some(scale) => {
                let (low, high) = DEVIATIONS;
                // σ(s) = (1 + tanh(s/2)) / 2, which does not overflow.
                let share = (scale.forward(&hidden)? * 0.5)?.tanh()?.affine(0.5, 0.5)?;
                share.affine(high - low, low)?
            }
        };
        Ok((mean, deviation))
    }
}

/// One transition model, or an ensemble.
#[derive(Debug)]
pub(super) struct TransitionModels(Vec<TransitionModel>);

impl TransitionModels {
    pub(super) fn new(
        builder: &mut Builder,
        latent_dims: usize,
        action_dims: usize,
        config: &DbcConfig,
    ) -> Result<Self> {
        let model =
            |builder: &mut Builder| TransitionModel::new(builder, latent_dims, action_dims, config);
        let models = match config.transition {
            Transition::Ensemble => (0..config.ensemble_size)
                .map(|index| model(&mut builder.under(index)))
                .collect::<Result<_>>()?,
            Transition::Deterministic | Transition::Probabilistic => vec![model(builder)?],
        };
        Ok(Self(models))
    }

    /// Number of models.
    pub(super) fn count(&self) -> usize {
        self.0.len()
    }

    /// Means and standard deviations, `(E, B, Z)` each.
    pub(super) fn forward(&self, latents: &Tensor, actions: &Tensor) -> Result<(Tensor, Tensor)> {
        let joined = Tensor::cat(&[latents, actions], D::Minus1)?;
        let outputs = self.0.iter().map(|model| model.forward(&joined));
        let (means, deviations): (Vec<_>, Vec<_>) =
            outputs.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        Ok((Tensor::stack(&means, 0)?, Tensor::stack(&deviations, 0)?))
    }
}

/// Predicts a transition's reward from the next latent.
///
/// Parameters: those of [`Hidden`] and `output.{weight, bias}`.
#[derive(Debug)]
pub(super) struct RewardModel {
    hidden: Hidden,
    output: Linear,
}

impl RewardModel {
    pub(super) fn new(builder: &mut Builder, latent_dims: usize, units: usize) -> Result<Self> {
        let hidden = Hidden::new(builder, latent_dims, units)?;
        Ok(Self { hidden, output: Linear::new(&mut builder.under("output"), units, 1)? })
    }

    /// Maps latents `(B, Z)` to rewards `(B, 1)`.
    pub(super) fn forward(&self, latents: &Tensor) -> Result<Tensor> {
        Ok(self.output.forward(&self.hidden.forward(latents)?)?)
    }
}
