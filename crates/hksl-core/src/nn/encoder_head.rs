//! The head of an encoder.

use candle_core::Tensor;

use crate::Result;
use crate::nn::{LayerNorm, Linear};
use crate::params::Builder;

/// A linear layer and layer normalisation, which map convolution features to a latent.
///
/// Parameters: `linear.{weight, bias}`, `norm.{weight, bias}`.
#[derive(Debug, Clone)]
pub struct EncoderHead {
    pub(super) linear: Linear,
    pub(super) norm: LayerNorm,
}

impl EncoderHead {
    /// Creates a head for `features` input features and `latent_dims` latent dimensions.
    pub fn new(builder: &mut Builder, features: usize, latent_dims: usize) -> Result<Self> {
        let linear = Linear::new(&mut builder.under("linear"), features, latent_dims)?;
        Ok(Self { linear, norm: LayerNorm::new(&mut builder.under("norm"), latent_dims)? })
    }

    /// Computes latents.
    ///
    /// # Shapes
    /// - `features`: `(B, features)`
    /// - output: `(B, Z)`
    pub fn forward(&self, features: &Tensor) -> Result<Tensor> {
        self.norm.forward(&self.linear.forward(features)?)
    }
}
