//! Convolution and transposed convolution layers.

use candle_core::{
    CpuStorage, CustomOp3, Device, Layout, Result as CandleResult, Shape, Tensor, bail,
};

use crate::kernels::{Engine, Im2col, MapConvolution, channel_sums};
use crate::nn::im2col_gemm::{ConvolutionGemm, TransposedConvolutionGemm};
use crate::nn::{Activation, Initializer};
use crate::on_host::{cpu, numbers};
use crate::params::Builder;
use crate::{Error, Result};

/// The shape of a convolution without padding.
///
/// `input` and `output` are those of the convolution. A transposed convolution of the same shape maps outputs to inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConvolutionShape {
    /// Rows and columns of the input.
    pub input_size: (usize, usize),
    /// Channels of the input, `C`.
    pub channels: usize,
    /// Channels of the output, `F`.
    pub filters: usize,
    /// Kernel size, `k`: rows and columns of the square kernel.
    pub side: usize,
    /// Stride in both directions.
    pub stride: usize,
}

impl ConvolutionShape {
    /// Rows and columns of the output. 0 if the input is smaller than the kernel, which layers reject.
    ///
    /// ```
    /// use hksl_core::nn::ConvolutionShape;
    ///
    /// let shape = ConvolutionShape { input_size: (64, 84), channels: 3, filters: 32, side: 4, stride: 2 };
    /// assert_eq!(shape.output_size(), (31, 41));
    /// ```
    pub fn output_size(&self) -> (usize, usize) {
        self.on(&Engine::default()).output_size()
    }

    fn check(&self) -> Result<()> {
        let Self { input_size: (rows, columns), side, stride, .. } = *self;
        if stride == 0 || rows.min(columns) < side {
            let got = vec![rows, columns];
            let expected =
                format!("at least {side}×{side} for kernels of that size, in steps above 0");
            return Err(Error::Shape { what: "a convolution's larger map", got, expected });
        }
        Ok(())
    }

    fn on(&self, engine: &Engine) -> MapConvolution {
        let Self { input_size, channels, filters, side, stride } = *self;
        MapConvolution { kernels: engine.kernels, input_size, channels, filters, side, stride }
    }
}

/// Kind of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    Convolution,
    Transposed,
}

/// A layer of either kind. The weight is `(F, C, k, k)` in both.
#[derive(Debug, Clone)]
struct Layer {
    shape: ConvolutionShape,
    direction: Direction,
    activation: Activation,
    weight: Tensor,
    bias: Tensor,
    engine: Engine,
}

impl Layer {
    fn new(
        builder: &mut Builder,
        shape: ConvolutionShape,
        direction: Direction,
        activation: Activation,
        initializers: (Initializer, Initializer),
    ) -> Result<Self> {
        shape.check()?;
        let ConvolutionShape { channels, filters, side, .. } = shape;
        let outputs = if direction == Direction::Convolution { filters } else { channels };
        let weight =
            builder.parameter("weight", &[filters, channels, side, side], initializers.0)?;
        let bias = builder.parameter("bias", &[outputs], initializers.1)?;
        let engine = builder.engine().clone();
        Ok(Self { shape, direction, activation, weight, bias, engine })
    }

    fn forward(&self, maps: &Tensor) -> Result<Tensor> {
        if !maps.device().is_cpu() {
            return self.forward_by_gemm(maps);
        }
        let operation = Operation {
            shape: self.shape.on(&self.engine),
            direction: self.direction,
            activation: self.activation,
            engine: self.engine.clone(),
        };
        Ok(maps.contiguous()?.apply_op3(&self.weight, &self.bias, operation)?)
    }

    /// Applies the layer with im2col or col2im and a matrix product, for GPUs.
    fn forward_by_gemm(&self, maps: &Tensor) -> Result<Tensor> {
        let (Self { direction, activation, bias, .. }, maps) = (self, maps.contiguous()?);
        let ConvolutionShape { input_size, channels, side, stride, .. } = self.shape;
        let im2col = Im2col { input_size, channels, kernel: side, stride };
        let matrix = self.weight.permute((0, 2, 3, 1))?.flatten_from(1)?;
        let (activation, counter) = (*activation, self.engine.counter.clone());
        Ok(match direction {
            Direction::Convolution => {
                maps.apply_op3(&matrix, bias, ConvolutionGemm { im2col, activation, counter })?
            }
            Direction::Transposed => maps.apply_op3(
                &matrix,
                bias,
                TransposedConvolutionGemm { im2col, activation, counter },
            )?,
        })
    }
}

/// A convolution without padding, with activation.
///
/// Parameters: `weight` (F, C, k, k), `bias` (F).
#[derive(Debug, Clone)]
pub struct Convolution(Layer);

impl Convolution {
    /// Creates a convolution with initialisers of weight and bias.
    ///
    /// # Errors
    /// A kernel that does not fit, a size or stride of 0, a name that exists already.
    pub fn new(
        builder: &mut Builder,
        shape: ConvolutionShape,
        activation: Activation,
        initializers: (Initializer, Initializer),
    ) -> Result<Self> {
        Layer::new(builder, shape, Direction::Convolution, activation, initializers).map(Self)
    }

    /// Applies the convolution.
    ///
    /// # Shapes
    /// - `maps`: `(B, H, W, C)`
    /// - output: `(B, h, w, F)`
    pub fn forward(&self, maps: &Tensor) -> Result<Tensor> {
        self.0.forward(maps)
    }
}

/// A transposed convolution with activation. Output elements that no kernel reaches have the value of the bias, as with
/// PyTorch's output padding.
///
/// Parameters: `weight` (F, C, k, k), in PyTorch's notation (in, out, k, k), and `bias` (C).
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_core::nn::{Activation, ConvolutionShape, Initializer, TransposedConvolution};
/// use hksl_core::{Builder, Parameters, rng};
///
/// let (mut parameters, mut rng) = (Parameters::default(), rng::stream(1, "init"));
/// let start = hksl_core::nn::Initialisation::Uniform;
/// let mut builder = Builder::create(&mut parameters, &mut rng, start, &Device::Cpu);
/// let shape = ConvolutionShape { input_size: (2, 4), channels: 1, filters: 1, side: 2, stride: 2 };
/// let initializers = (Initializer::Constant(2.0), Initializer::Constant(1.0));
/// let layer = TransposedConvolution::new(&mut builder, shape, Activation::None, initializers)?;
/// let maps = Tensor::new(&[[[[3f32], [5.0]]]], &Device::Cpu)?;
/// let grown = layer.forward(&maps)?.flatten_all()?.to_vec1::<f32>()?;
/// assert_eq!(grown, [7., 7., 11., 11., 7., 7., 11., 11.]);
/// # Ok::<(), hksl_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct TransposedConvolution(Layer);

impl TransposedConvolution {
    /// Creates a transposed convolution with initialisers of weight and bias.
    ///
    /// # Errors
    /// A kernel that does not fit, a size or stride of 0, a name that exists already.
    pub fn new(
        builder: &mut Builder,
        shape: ConvolutionShape,
        activation: Activation,
        initializers: (Initializer, Initializer),
    ) -> Result<Self> {
        Layer::new(builder, shape, Direction::Transposed, activation, initializers).map(Self)
    }

    /// Applies the transposed convolution.
    ///
    /// # Shapes
    /// - `maps`: `(B, h, w, F)`
    /// - output: `(B, H, W, C)`
    pub fn forward(&self, maps: &Tensor) -> Result<Tensor> {
        self.0.forward(maps)
    }
}

struct Operation {
    shape: MapConvolution,
    direction: Direction,
    activation: Activation,
    engine: Engine,
}

impl Operation {
    /// Rows, columns and channels of the layer's input and output for one image.
    fn ends(&self) -> [(usize, usize, usize); 2] {
        let (MapConvolution { input_size, channels, filters, .. }, output_size) =
            (self.shape, self.shape.output_size());
        let (input, output) =
            ((input_size.0, input_size.1, channels), (output_size.0, output_size.1, filters));
        match self.direction {
            Direction::Convolution => [input, output],
            Direction::Transposed => [output, input],
        }
    }
}

impl CustomOp3 for Operation {
    fn name(&self) -> &'static str {
        "map-convolution"
    }

    fn cpu_fwd(
        &self,
        maps: &CpuStorage,
        maps_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> CandleResult<(CpuStorage, Shape)> {
        let (batch, rows, columns, channels) = maps_layout.shape().dims4()?;
        let [input, output] = self.ends();
        if (rows, columns, channels) != input {
            bail!("a convolution of maps {input:?} was given maps {:?}", (rows, columns, channels));
        }
        let (maps, weight) = (numbers(maps, maps_layout)?, numbers(weight, weight_layout)?);
        let (bias, engine) = (Some(numbers(bias, bias_layout)?), &self.engine);
        let mut result = match self.direction {
            Direction::Convolution => self.shape.convolve(engine, maps, weight, bias),
            Direction::Transposed => self.shape.convolve_transposed(engine, maps, weight, bias),
        };
        self.activation.apply(&mut result);
        Ok((CpuStorage::F32(result), (batch, output.0, output.1, output.2).into()))
    }

    fn bwd(
        &self,
        maps: &Tensor,
        weight: &Tensor,
        bias: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> CandleResult<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let gradient = gradient.contiguous()?;
        let (maps_storage, maps_layout) = maps.storage_and_layout();
        let (weight_storage, weight_layout) = weight.storage_and_layout();
        let (output_storage, output_layout) = output.storage_and_layout();
        let (gradient_storage, gradient_layout) = gradient.storage_and_layout();
        let gradient = numbers(cpu(&gradient_storage)?, gradient_layout)?;
        let before =
            self.activation.backward(numbers(cpu(&output_storage)?, output_layout)?, gradient);
        let gradient = before.as_deref().unwrap_or(gradient);
        let inputs = numbers(cpu(&maps_storage)?, maps_layout)?;
        let weights = numbers(cpu(&weight_storage)?, weight_layout)?;
        let engine = &self.engine;
        let grad_maps = maps.track_op().then(|| match self.direction {
            Direction::Convolution => {
                self.shape.convolve_transposed(engine, gradient, weights, None)
            }
            Direction::Transposed => self.shape.convolve(engine, gradient, weights, None),
        });
        let trained = weight.track_op();
        let grad_weight = trained.then(|| match self.direction {
            Direction::Convolution => self.shape.weight_gradient(engine, inputs, gradient),
            Direction::Transposed => self.shape.weight_gradient(engine, gradient, inputs),
        });
        let grad_bias = trained.then(|| channel_sums(gradient, self.ends()[1].2));
        let tensor = |numbers, like: &Tensor| Tensor::from_vec(numbers, like.shape(), &Device::Cpu);
        Ok((
            grad_maps.map(|numbers| tensor(numbers, maps)).transpose()?,
            grad_weight.map(|numbers| tensor(numbers, weight)).transpose()?,
            grad_bias.map(|numbers| tensor(numbers, bias)).transpose()?,
        ))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Var;

    use super::*;
    use crate::nn::Initialisation;
    use crate::params::Parameters;
    use crate::rng::{standard_normal, stream};
    use crate::testing::{assert_close, device, gradients};

    /// Compares the GPU code path, on a GPU or on the CPU, with the CPU kernels: output and all gradients, for both kinds of
    /// layers, every activation, elements that no kernel reaches, and channels by one and by four.
    #[test]
    fn products_and_kernels_agree() {
        for (direction, activation, input_size, channels, filters) in [
            (Direction::Convolution, Activation::Elu, (11, 8), 3, 5),
            (Direction::Convolution, Activation::None, (9, 10), 4, 5),
            (Direction::Transposed, Activation::Relu, (12, 9), 3, 5),
            (Direction::Transposed, Activation::Elu, (10, 12), 8, 4),
        ] {
            let shape = ConvolutionShape { input_size, channels, filters, side: 3, stride: 2 };
            let build = |device: &Device| {
                let (mut parameters, mut rng) = (Parameters::default(), stream(3, "maps"));
                let start = Initialisation::Uniform;
                let mut builder = Builder::create(&mut parameters, &mut rng, start, device);
                let initializers = (start.weight(27, 1.0), start.bias(27));
                let layer = Layer::new(&mut builder, shape, direction, activation, initializers);
                (parameters, layer.unwrap())
            };
            let ((rows, columns), (height, width)) = (shape.output_size(), input_size);
            let dims = match direction {
                Direction::Convolution => [4, height, width, channels],
                Direction::Transposed => [4, rows, columns, filters],
            };
            let maps = standard_normal(&mut stream(5, "maps"), &dims, &Device::Cpu).unwrap();
            let of = |device: &Device| Var::from_tensor(&maps.to_device(device).unwrap()).unwrap();
            let (maps, others) = (of(&Device::Cpu), of(&device()));
            let (parameters, layer) = build(&Device::Cpu);
            let kernels = layer.forward(&maps).unwrap();
            let (other_parameters, layer) = build(&device());
            let products = layer.forward_by_gemm(&others).unwrap();
            assert_close(&products, &kernels);
            let (kernels, products) = (gradients(&kernels), gradients(&products));
            assert_close(products.get(&others).unwrap(), kernels.get(&maps).unwrap());
            for ((_, parameter), (_, other)) in parameters.iter().zip(other_parameters.iter()) {
                assert_close(products.get(other).unwrap(), kernels.get(parameter).unwrap());
            }
            // Maps of other shapes, with the same or another number of elements.
            let [a, b, c, d] = dims;
            for wrong in [[a, d, b, c], [2 * a, b / 2, c, d], [a, b, c, d + 1]] {
                let wrong = Tensor::zeros(&wrong[..], candle_core::DType::F32, &device()).unwrap();
                assert!(layer.forward_by_gemm(&wrong).is_err(), "{:?}", wrong.dims());
            }
        }
    }
}
