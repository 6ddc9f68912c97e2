//! Layer normalisation.

mod one_pass;

use candle_core::{D, Tensor};

use self::one_pass::OnePass;
use crate::nn::Initializer;
use crate::params::Builder;
use crate::{Error, Result};

/// Layer normalisation over the last dimension: `(x − mean) / √(variance + ε) · weight + bias`.
///
/// Parameters: `weight` and `bias`, initialised to 1 and 0.
#[derive(Debug, Clone)]
pub struct LayerNorm {
    weight: Tensor,
    bias: Tensor,
    epsilon: f64,
}

impl LayerNorm {
    /// PyTorch's ε.
    const EPSILON: f64 = 1e-5;

    /// Creates a layer for vectors with `size` elements, with PyTorch's ε = 1e-5.
    pub fn new(builder: &mut Builder, size: usize) -> Result<Self> {
        Self::with_epsilon(builder, size, Self::EPSILON)
    }

    /// Creates a layer with another ε.
    pub fn with_epsilon(builder: &mut Builder, size: usize, epsilon: f64) -> Result<Self> {
        let weight = builder.parameter("weight", &[size], Initializer::Constant(1.0))?;
        let bias = builder.parameter("bias", &[size], Initializer::Constant(0.0))?;
        Ok(Self { weight, bias, epsilon })
    }

    /// Normalises each row.
    ///
    /// # Shapes
    /// - `x`: `(B, size)`
    /// - output: `(B, size)`
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        if !x.device().is_cpu() {
            return self.forward_in_one_pass(x);
        }
        let centred = x.broadcast_sub(&x.mean_keepdim(D::Minus1)?)?;
        let variance = centred.sqr()?.mean_keepdim(D::Minus1)?;
        let normed = centred.broadcast_div(&(variance + self.epsilon)?.sqrt()?)?;
        Ok(normed.broadcast_mul(&self.weight)?.broadcast_add(&self.bias)?)
    }

    /// Normalises each row in one operation, for GPUs.
    fn forward_in_one_pass(&self, x: &Tensor) -> Result<Tensor> {
        let (size, expected) = (x.dim(D::Minus1)?, self.weight.dim(0)?);
        if size != expected {
            let (got, expected) = (x.dims().to_vec(), format!("(B, {expected})"));
            return Err(Error::Shape { what: "rows to be normalised", got, expected });
        }
        let operation = OnePass { epsilon: self.epsilon as f32 };
        Ok(x.contiguous()?.apply_op3(&self.weight, &self.bias, operation)?)
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{DType, Device, Var};

    use super::*;
    use crate::nn::Initialisation;
    use crate::params::Parameters;
    use crate::rng::{standard_normal, stream};
    use crate::testing::{assert_close, device, gradients};

    /// Compares the GPU code path, on a GPU or on the CPU, with candle's operations: output and all gradients.
    #[test]
    fn one_pass_and_candle_agree() {
        let numbers = |name: &str, dims: &[usize], device: &Device| {
            let drawn = standard_normal(&mut stream(3, name), dims, &Device::Cpu).unwrap();
            drawn.to_device(device).unwrap()
        };
        let build = |device: &Device| {
            let (mut parameters, mut rng) = (Parameters::default(), stream(3, "norm"));
            let start = Initialisation::Uniform;
            let mut builder = Builder::create(&mut parameters, &mut rng, start, device);
            let norm = LayerNorm::with_epsilon(&mut builder, 41, 0.1).unwrap();
            for name in ["weight", "bias"] {
                parameters.get(name).unwrap().set(&numbers(name, &[41], device)).unwrap();
            }
            let x = Var::from_tensor(&numbers("x", &[7, 41], device)).unwrap();
            (parameters, norm, x)
        };
        let (parameters, norm, x) = build(&Device::Cpu);
        let candle = norm.forward(&x).unwrap();
        let (others, norm, y) = build(&device());
        let one_pass = norm.forward_in_one_pass(&y).unwrap();
        assert_close(&one_pass, &candle);
        let (candle, one_pass) = (gradients(&candle), gradients(&one_pass));
        assert_close(one_pass.get(&y).unwrap(), candle.get(&x).unwrap());
        for ((_, parameter), (_, other)) in parameters.iter().zip(others.iter()) {
            assert_close(one_pass.get(other).unwrap(), candle.get(parameter).unwrap());
        }
        let halves = Tensor::zeros((7, 82), DType::F32, &device()).unwrap();
        assert!(norm.forward_in_one_pass(&halves).is_err());
    }
}
