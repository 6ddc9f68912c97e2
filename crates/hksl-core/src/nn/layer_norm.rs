//! Layer normalisation.

use candle_core::{D, Tensor};

use crate::Result;
use crate::nn::Start;
use crate::params::Builder;

/// `(x − mean) / √(variance + 1e-5) · weight + bias` over the last dimension.
#[derive(Debug, Clone)]
pub struct LayerNorm {
    weight: Tensor,
    bias: Tensor,
}

impl LayerNorm {
    const EPSILON: f64 = 1e-5;

    /// Normalises vectors of `size` numbers; parameters `weight` (1) and `bias` (0).
    pub fn new(builder: &mut Builder, size: usize) -> Result<Self> {
        let weight = builder.parameter("weight", &[size], Start::Constant(1.0))?;
        let bias = builder.parameter("bias", &[size], Start::Constant(0.0))?;
        Ok(Self { weight, bias })
    }

    /// # Shapes
    /// - `x`: `(B, size)`
    /// - output: `(B, size)`
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let centred = x.broadcast_sub(&x.mean_keepdim(D::Minus1)?)?;
        let variance = centred.sqr()?.mean_keepdim(D::Minus1)?;
        let normed = centred.broadcast_div(&(variance + Self::EPSILON)?.sqrt()?)?;
        Ok(normed.broadcast_mul(&self.weight)?.broadcast_add(&self.bias)?)
    }
}
