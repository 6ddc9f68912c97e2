//! Layer normalisation.

mod one_pass;

use candle_core::{D, Tensor};

use self::one_pass::OnePass;
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
        if x.device().is_cuda() {
            return self.forward_in_one_pass(x);
        }
        let centred = x.broadcast_sub(&x.mean_keepdim(D::Minus1)?)?;
        let variance = centred.sqr()?.mean_keepdim(D::Minus1)?;
        let normed = centred.broadcast_div(&(variance + self.epsilon)?.sqrt()?)?;
        Ok(normed.broadcast_mul(&self.weight)?.broadcast_add(&self.bias)?)
    }

    /// The same as one operation, for GPUs.
    fn forward_in_one_pass(&self, x: &Tensor) -> Result<Tensor> {
        let operation = OnePass { epsilon: self.epsilon as f32 };
        Ok(x.contiguous()?.apply_op3(&self.weight, &self.bias, operation)?)
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;
    use crate::nn::Initialisation;
    use crate::params::Parameters;
    use crate::rng::{standard_normal, stream};
    use crate::testing::assert_close;

    /// What runs on a GPU, run on the CPU, against candle's operations: output and all gradients.
    #[test]
    fn one_pass_and_candle_agree() {
        let (mut parameters, mut rng) = (Parameters::default(), stream(3, "norm"));
        let start = Initialisation::Uniform;
        let mut builder = Builder::create(&mut parameters, &mut rng, start, &Device::Cpu);
        let norm = LayerNorm::with_epsilon(&mut builder, 41, 0.1).unwrap();
        let mut draw = |dims: &[usize]| standard_normal(&mut rng, dims, &Device::Cpu).unwrap();
        for name in ["weight", "bias"] {
            parameters.get(name).unwrap().set(&draw(&[41])).unwrap();
        }
        let (x, weight) = (Var::from_tensor(&draw(&[7, 41])).unwrap(), draw(&[7, 41]));
        let (candle, one_pass) = (norm.forward(&x).unwrap(), norm.forward_in_one_pass(&x).unwrap());
        assert_close(&one_pass, &candle);
        let gradients =
            |output: &Tensor| (output * &weight).unwrap().sum_all().unwrap().backward().unwrap();
        let (candle, one_pass) = (gradients(&candle), gradients(&one_pass));
        for variable in [&x, parameters.get("weight").unwrap(), parameters.get("bias").unwrap()] {
            assert_close(one_pass.get(variable).unwrap(), candle.get(variable).unwrap());
        }
    }
}
