//! Layer normalisation.

use candle_core::{D, Tensor};

use crate::Result;
use crate::nn::Start;
use crate::params::Builder;

/// `(x − mean) / √(variance + ε) · weight + bias` over the last dimension.
#[derive(Debug, Clone)]
pub struct LayerNorm {
    weight: Tensor,
    bias: Tensor,
    epsilon: f64,
}

impl LayerNorm {
    /// PyTorch's ε.
    const EPSILON: f64 = 1e-5;

    /// Normalises vectors of `size` numbers with ε = 1e-5; parameters `weight` (1) and `bias` (0).
    pub fn new(builder: &mut Builder, size: usize) -> Result<Self> {
        Self::with_epsilon(builder, size, Self::EPSILON)
    }

    /// The same with another ε.
    pub fn with_epsilon(builder: &mut Builder, size: usize, epsilon: f64) -> Result<Self> {
        let weight = builder.parameter("weight", &[size], Start::Constant(1.0))?;
        let bias = builder.parameter("bias", &[size], Start::Constant(0.0))?;
        Ok(Self { weight, bias, epsilon })
    }

    /// # Shapes
    /// - `x`: `(B, size)`
    /// - output: `(B, size)`
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let centred = x.broadcast_sub(&x.mean_keepdim(D::Minus1)?)?;
        let variance = centred.sqr()?.mean_keepdim(D::Minus1)?;
        let normed = centred.broadcast_div(&(variance + self.epsilon)?.sqrt()?)?;
        Ok(normed.broadcast_mul(&self.weight)?.broadcast_add(&self.bias)?)
    }
}
