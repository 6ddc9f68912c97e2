//! What follows an encoder's convolutions.

use candle_core::Tensor;

use crate::Result;
use crate::nn::{LayerNorm, Linear};
use crate::params::Builder;

/// A linear map and layer normalisation: from the features of a picture to its latent.
///
/// Parameters: `linear.{weight, bias}`, `norm.{weight, bias}`.
#[derive(Debug, Clone)]
pub struct EncoderHead {
    pub(super) linear: Linear,
    pub(super) norm: LayerNorm,
}

impl EncoderHead {
    /// A head on `features` numbers with latents of `latent_dims`.
    pub fn new(builder: &mut Builder, features: usize, latent_dims: usize) -> Result<Self> {
        let linear = Linear::new(&mut builder.under("linear"), features, latent_dims)?;
        Ok(Self { linear, norm: LayerNorm::new(&mut builder.under("norm"), latent_dims)? })
    }

    /// # Shapes
    /// - `features`: `(B, features)`
    /// - output: `(B, Z)`
    pub fn forward(&self, features: &Tensor) -> Result<Tensor> {
        self.norm.forward(&self.linear.forward(features)?)
    }
}
