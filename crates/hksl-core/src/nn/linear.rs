//! The linear layer.

use candle_core::Tensor;

use crate::Result;
use crate::kernels::Engine;
use crate::nn::Activation;
use crate::nn::Initializer;
use crate::nn::affine::affine;
use crate::params::Builder;

/// A linear layer with bias: `y = x Wᵀ + b`.
///
/// Parameters: `weight` (out, in), `bias` (out).
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_core::nn::{Initialisation, Linear};
/// use hksl_core::{Builder, Parameters, rng};
///
/// let (mut parameters, mut rng) = (Parameters::default(), rng::stream(1, "init"));
/// let mut builder =
///     Builder::create(&mut parameters, &mut rng, Initialisation::Uniform, &Device::Cpu);
/// let linear = Linear::new(&mut builder, 2, 1)?;
/// parameters.get("weight").unwrap().set(&Tensor::new(&[[2f32, -1.]], &Device::Cpu)?)?;
/// parameters.get("bias").unwrap().set(&Tensor::new(&[0.5f32], &Device::Cpu)?)?;
///
/// let y = linear.forward(&Tensor::new(&[[3f32, 4.]], &Device::Cpu)?)?;
/// assert_eq!(y.to_vec2::<f32>()?, [[2.5]]);
/// # Ok::<(), hksl_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Linear {
    weight: Tensor,
    bias: Tensor,
    engine: Engine,
}

impl Linear {
    /// Creates a layer with `inputs` input and `outputs` output dimensions.
    pub fn new(builder: &mut Builder, inputs: usize, outputs: usize) -> Result<Self> {
        let initialisation = builder.initialisation();
        let initializers = (initialisation.weight(inputs, 1.0), initialisation.bias(inputs));
        Self::with_initializers(builder, inputs, outputs, initializers)
    }

    /// Creates a layer with given initialisers of weight and bias.
    pub fn with_initializers(
        builder: &mut Builder,
        inputs: usize,
        outputs: usize,
        (weight, bias): (Initializer, Initializer),
    ) -> Result<Self> {
        let weight = builder.parameter("weight", &[outputs, inputs], weight)?;
        let bias = builder.parameter("bias", &[outputs], bias)?;
        Ok(Self { weight, bias, engine: builder.engine().clone() })
    }

    pub(super) fn weight(&self) -> &Tensor {
        &self.weight
    }

    pub(super) fn bias(&self) -> &Tensor {
        &self.bias
    }

    /// Applies the layer.
    ///
    /// # Shapes
    /// - `x`: `(B, in)`
    /// - output: `(B, out)`
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        affine(&self.engine, x, &self.weight, &self.bias, Activation::None)
    }

    /// Applies the layer and ReLU.
    ///
    /// # Shapes
    /// - `x`: `(B, in)`
    /// - output: `(B, out)`
    pub fn forward_relu(&self, x: &Tensor) -> Result<Tensor> {
        self.forward_then(x, Activation::Relu)
    }

    /// Applies the layer and an activation.
    ///
    /// # Shapes
    /// - `x`: `(B, in)`
    /// - output: `(B, out)`
    pub fn forward_then(&self, x: &Tensor, activation: Activation) -> Result<Tensor> {
        affine(&self.engine, x, &self.weight, &self.bias, activation)
    }
}
