//! The projection of predictions.

use candle_core::Tensor;

use crate::Result;
use crate::nn::Mlp;
use crate::params::Builder;

/// The projection `w^l` (HKSL §4), applied to predictions but not to targets.
#[derive(Debug, Clone)]
pub struct Projection(Mlp);

impl Projection {
    /// Creates a network with one hidden layer of `latent_dims` units and ReLU.
    pub fn new(builder: &mut Builder, latent_dims: usize) -> Result<Self> {
        Ok(Self(Mlp::new(builder, &[latent_dims; 3])?))
    }

    /// Projects predictions.
    ///
    /// # Shapes
    /// - `latent`: `(B, Z)`
    /// - output: `(B, Z)`
    pub fn forward(&self, latent: &Tensor) -> Result<Tensor> {
        self.0.forward(latent)
    }
}
