//! The encoder's stack of 3×3 convolutions with ReLU.

mod projected;

use std::sync::OnceLock;

use candle_core::{CpuStorage, CustomOp2, Device, Layout, Result as CandleResult};
use candle_core::{Shape, Tensor, bail};

use self::projected::Projected;
use crate::Result;
use crate::kernels::{Activation, Block, Convolutions, Engine, Im2col, KERNEL};
use crate::nn::Linear;
use crate::nn::im2col_gemm::ConvolutionGemm;
use crate::on_host::{bytes, numbers};
use crate::params::Builder;

/// A stack of 3×3 convolutions without padding, each with bias and ReLU. The first scales u8 images by 1/255 and has a
/// stride; the others have stride 1.
///
/// Parameters: `{0, 1, …}.weight` (F, C, 3, 3) and `{0, 1, …}.bias` (F).
#[derive(Debug, Clone)]
pub(crate) struct ConvolutionStack {
    shape: Convolutions,
    weights: Vec<Tensor>,
    biases: Vec<Tensor>,
    engine: Engine,
}

impl ConvolutionStack {
    /// Creates `layers` convolutions with `filters` filters each for images (C, H, W). The image must be large enough for
    /// all layers.
    pub(crate) fn new(
        builder: &mut Builder,
        [channels, height, width]: [usize; 3],
        filters: usize,
        stride: usize,
        layers: usize,
    ) -> Result<Self> {
        let engine = builder.engine().clone();
        let kernels = engine.kernels;
        let initialisation = builder.initialisation();
        let (mut weights, mut biases) = (Vec::new(), Vec::new());
        for layer in 0..layers {
            let inputs = if layer == 0 { channels } else { filters };
            let fan_in = inputs * KERNEL * KERNEL;
            let mut builder = builder.under(layer);
            let start = initialisation.weight(fan_in, std::f64::consts::SQRT_2);
            let shape = [filters, inputs, KERNEL, KERNEL];
            weights.push(builder.parameter("weight", &shape, start)?);
            biases.push(builder.parameter("bias", &[filters], initialisation.bias(fan_in))?);
        }
        let shape = Convolutions { kernels, channels, height, width, filters, stride, layers };
        Ok(Self { shape, weights, biases, engine })
    }

    /// Computes the last feature maps.
    ///
    /// # Shapes
    /// - `images`: `(B, C, H, W)` u8
    /// - output: `(B, h, w, F)`, not negative
    pub(crate) fn forward(&self, images: &Tensor) -> Result<Tensor> {
        if !images.device().is_cpu() {
            return self.forward_by_gemm(images);
        }
        let parameters = self.parameters()?;
        let kept = parameters.track_op().then(OnceLock::new);
        let stack = Stack { shape: self.shape, engine: self.engine.clone(), kept };
        Ok(images.apply_op2(&parameters, stack)?)
    }

    /// Applies the stack and the linear layer `linear` to its flattened output.
    ///
    /// # Shapes
    /// - `images`: `(B, C, H, W)` u8
    /// - output: `(B, out)`
    pub(crate) fn forward_linear(&self, images: &Tensor, linear: &Linear) -> Result<Tensor> {
        if !images.device().is_cpu() {
            return linear.forward(&self.forward_by_gemm(images)?.flatten_from(1)?);
        }
        let parameters = self.parameters()?;
        let tracked = parameters.track_op() || linear.weight().track_op();
        let kept = tracked.then(OnceLock::new);
        let projected = Projected { shape: self.shape, engine: self.engine.clone(), kept };
        let output = images.apply_op3(&parameters, linear.weight(), projected)?;
        Ok(output.broadcast_add(linear.bias())?)
    }

    /// All parameters as one vector, in the order that the kernels expect.
    fn parameters(&self) -> Result<Tensor> {
        let mut parts = Vec::with_capacity(2 * self.weights.len());
        for (weight, bias) in self.weights.iter().zip(&self.biases) {
            parts.extend([weight.flatten_all()?, bias.clone()]);
        }
        Ok(Tensor::cat(&parts, 0)?)
    }

    /// Computes the last feature maps with im2col and matrix products, for GPUs.
    fn forward_by_gemm(&self, images: &Tensor) -> Result<Tensor> {
        let Convolutions { channels, height, width, filters, stride, .. } = self.shape;
        let mut im2col = Im2col { input_size: (height, width), channels, kernel: KERNEL, stride };
        let mut maps = images.clone();
        for (weight, bias) in self.weights.iter().zip(&self.biases) {
            let matrix = weight.permute((0, 2, 3, 1))?.flatten_from(1)?;
            maps = maps.apply_op3(
                &matrix,
                bias,
                ConvolutionGemm {
                    im2col,
                    activation: Activation::Relu,
                    counter: self.engine.counter.clone(),
                },
            )?;
            im2col = Im2col {
                input_size: im2col.output_size(),
                channels: filters,
                kernel: KERNEL,
                stride: 1,
            };
        }
        Ok(maps)
    }
}

/// The stack as an operation on images and the vector of all parameters.
struct Stack {
    shape: Convolutions,
    engine: Engine,
    /// The feature maps between the layers, if a backward pass will need them.
    kept: Option<OnceLock<Block>>,
}

impl CustomOp2 for Stack {
    fn name(&self) -> &'static str {
        "convolution-stack"
    }

    fn cpu_fwd(
        &self,
        images: &CpuStorage,
        images_layout: &Layout,
        parameters: &CpuStorage,
        parameters_layout: &Layout,
    ) -> CandleResult<(CpuStorage, Shape)> {
        let images = bytes(images, images_layout)?;
        let parameters = numbers(parameters, parameters_layout)?;
        let keep = self.kept.is_some();
        let (output, maps) = self.shape.forward(images, parameters, &self.engine, keep);
        if let (Some(kept), Some(maps)) = (&self.kept, maps) {
            // candle runs the operation once. A second run would give the same maps.
            let _ = kept.set(maps);
        }
        let batch = images_layout.dims()[0];
        let (height, width) = self.shape.output_size();
        Ok((CpuStorage::F32(output), (batch, height, width, self.shape.filters).into()))
    }

    fn bwd(
        &self,
        images: &Tensor,
        parameters: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> CandleResult<(Option<Tensor>, Option<Tensor>)> {
        let Some(maps) = self.kept.as_ref().and_then(OnceLock::get) else {
            bail!("the convolutions were run without keeping what their gradient needs")
        };
        let gradient = gradient.contiguous()?;
        let (image_storage, image_layout) = images.storage_and_layout();
        let (parameter_storage, parameter_layout) = parameters.storage_and_layout();
        let (output_storage, output_layout) = output.storage_and_layout();
        let (gradient_storage, gradient_layout) = gradient.storage_and_layout();
        let sums = self.shape.gradient(
            bytes(crate::on_host::cpu(&image_storage)?, image_layout)?,
            numbers(crate::on_host::cpu(&parameter_storage)?, parameter_layout)?,
            &self.engine,
            maps,
            numbers(crate::on_host::cpu(&output_storage)?, output_layout)?,
            numbers(crate::on_host::cpu(&gradient_storage)?, gradient_layout)?,
        );
        Ok((None, Some(Tensor::from_vec(sums, parameters.shape(), &Device::Cpu)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::Initialisation;
    use crate::params::Parameters;
    use crate::rng::stream;
    use crate::testing::{assert_close, device, gradients};

    /// Compares the fused operation with stack and linear layer in sequence: output and all gradients.
    #[test]
    fn the_linear_map_may_be_part_of_the_stack() {
        let (mut parameters, mut rng) = (Parameters::default(), stream(3, "stack"));
        let start = Initialisation::Uniform;
        let mut builder = Builder::create(&mut parameters, &mut rng, start, &Device::Cpu);
        let stack = ConvolutionStack::new(&mut builder, [3, 21, 18], 6, 2, 3).unwrap();
        let linear = Linear::new(&mut builder.under("linear"), 6 * 6 * 4, 7).unwrap();
        let pixels: Vec<u8> = (0..4 * 3 * 21 * 18).map(|index| (index * 89 % 251) as u8).collect();
        let images = Tensor::from_vec(pixels, (4, 3, 21, 18), &Device::Cpu).unwrap();
        let features = stack.forward(&images).unwrap().flatten_from(1).unwrap();
        let apart = linear.forward(&features).unwrap();
        let together = stack.forward_linear(&images, &linear).unwrap();
        assert_close(&together, &apart);
        let gradients =
            |output: &Tensor| output.sqr().unwrap().sum_all().unwrap().backward().unwrap();
        let (apart, together) = (gradients(&apart), gradients(&together));
        for (_, parameter) in parameters.iter() {
            assert_close(together.get(parameter).unwrap(), apart.get(parameter).unwrap());
        }
    }

    /// Compares the GPU code path, on a GPU or on the CPU, with the CPU kernels: output and all gradients.
    #[test]
    fn products_and_kernels_agree() {
        for (stride, layers, filters) in [(2, 4, 6), (1, 2, 8), (3, 1, 5)] {
            let build = |device: &Device| {
                let (mut parameters, mut rng) = (Parameters::default(), stream(3, "stack"));
                let start = Initialisation::Uniform;
                let mut builder = Builder::create(&mut parameters, &mut rng, start, device);
                let image = [3, 21, 18];
                let stack = ConvolutionStack::new(&mut builder, image, filters, stride, layers);
                (parameters, stack.unwrap())
            };
            let pixels: Vec<u8> =
                (0..4 * 3 * 21 * 18).map(|index| (index * 89 % 251) as u8).collect();
            let images = Tensor::from_vec(pixels, (4, 3, 21, 18), &Device::Cpu).unwrap();
            let (parameters, stack) = build(&Device::Cpu);
            let kernels = stack.forward(&images).unwrap();
            let (others, stack) = build(&device());
            let products = stack.forward_by_gemm(&images.to_device(&device()).unwrap()).unwrap();
            assert_close(&products, &kernels);
            let (kernels, products) = (gradients(&kernels), gradients(&products));
            for ((_, parameter), (_, other)) in parameters.iter().zip(others.iter()) {
                assert_close(products.get(other).unwrap(), kernels.get(parameter).unwrap());
            }
        }
    }
}
