//! PI-SAC's head networks, which predict the mean of a Gaussian.

use candle_core::{D, Tensor};
use hksl_core::Builder;
use hksl_core::nn::{Initializer, Linear};
use hksl_sac::Result;

/// Two hidden layers, a linear layer to twice the latent size, and batch normalisation with the statistics of the batch.
/// The first half of the output is the mean. The second half is unused: it is a scale in the original, which fixes the
/// scale at 1.
///
/// Parameters: `{0, 2, 4}.{weight, bias}`, `norm.{weight, bias}`.
#[derive(Debug)]
pub(super) struct Head {
    hidden: [Linear; 2],
    output: Linear,
    weight: Tensor,
    bias: Tensor,
    sizes: [usize; 3],
}

impl Head {
    /// ε of the batch normalisation, Keras's default.
    const EPSILON: f64 = 1e-3;

    /// Variance scaling of the last layer's initial weights: their variance times the number of inputs.
    const SCALING: f64 = 1e-4;

    pub(super) fn new(
        builder: &mut Builder,
        inputs: usize,
        units: usize,
        latent_dims: usize,
    ) -> Result<Self> {
        let outputs = 2 * latent_dims;
        let hidden = |builder: &mut Builder, name: &str, inputs: usize| {
            let glorot = Initializer::Uniform { bound: (6.0 / (inputs + units) as f64).sqrt() };
            let initializers = (glorot, Initializer::Constant(0.0));
            Linear::with_initializers(&mut builder.under(name), inputs, units, initializers)
        };
        let hidden = [hidden(builder, "0", inputs)?, hidden(builder, "2", units)?];
        let small = Initializer::TruncatedNormal { std: (Self::SCALING / units as f64).sqrt() };
        let initializers = (small, Initializer::Constant(0.0));
        let output =
            Linear::with_initializers(&mut builder.under("4"), units, outputs, initializers)?;
        let mut norm = builder.under("norm");
        let weight = norm.parameter("weight", &[outputs], Initializer::Constant(1.0))?;
        let bias = norm.parameter("bias", &[outputs], Initializer::Constant(0.0))?;
        Ok(Self { hidden, output, weight, bias, sizes: [inputs, units, outputs] })
    }

    /// Input dimensions.
    pub(super) fn inputs(&self) -> usize {
        self.sizes[0]
    }

    /// Maps inputs `(B, inputs)` to means `(B, Z)`.
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let mut x = x.clone();
        for layer in &self.hidden {
            x = layer.forward_relu(&x)?;
        }
        let x = self.output.forward(&x)?;
        let centred = x.broadcast_sub(&x.mean_keepdim(0)?)?;
        let variance = centred.sqr()?.mean_keepdim(0)?;
        let normed = centred.broadcast_div(&(variance + Self::EPSILON)?.sqrt()?)?;
        let scaled = normed.broadcast_mul(&self.weight)?.broadcast_add(&self.bias)?;
        Ok(scaled.narrow(D::Minus1, 0, self.sizes[2] / 2)?)
    }
}
