//! The map between predictions and what they are compared with.

use candle_core::Tensor;

use crate::Result;
use crate::nn::Mlp;
use crate::params::Builder;

/// The projection `w^l` (HKSL §4): predictions pass it, targets do not.
#[derive(Debug, Clone)]
pub struct Projection(Mlp);

impl Projection {
    /// `Z → Z → Z` with a ReLU between.
    pub fn new(builder: &mut Builder, latent_dims: usize) -> Result<Self> {
        Ok(Self(Mlp::new(builder, &[latent_dims; 3])?))
    }

    /// # Shapes
    /// - `latent`: `(B, Z)`
    /// - output: `(B, Z)`
    pub fn forward(&self, latent: &Tensor) -> Result<Tensor> {
        self.0.forward(latent)
    }
}
