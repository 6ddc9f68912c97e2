//! The 3×3 convolution with bias and ReLU, as patches times weights.
//!
//! Feature maps are kept channels-last, `(B, h, w, F)`: a patch is then three contiguous runs, and the
//! convolution one matrix product over all patches of the batch.

mod bias_relu;
mod patches;

use candle_core::Tensor;

use crate::Result;
use crate::nn::Start;
use crate::params::Builder;

pub(crate) use patches::output_side;

/// What a convolution reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Input {
    /// u8 images `(B, C, H, W)`, scaled by 1/255; no gradient towards them.
    Pixels,
    /// f32 maps `(B, H, W, C)`.
    Maps,
}

/// A 3×3 convolution without padding, bias and ReLU included.
///
/// Parameters: `weight` (F, C, 3, 3) and `bias` (F).
#[derive(Debug, Clone)]
pub(crate) struct Convolution {
    weight: Tensor,
    bias: Tensor,
    stride: usize,
    input: Input,
}

impl Convolution {
    /// The side of the square kernel.
    pub(crate) const KERNEL: usize = 3;

    /// A convolution of u8 images.
    pub(crate) fn of_pixels(
        builder: &mut Builder,
        channels: usize,
        filters: usize,
        stride: usize,
    ) -> Result<Self> {
        Self::new(builder, channels, filters, stride, Input::Pixels)
    }

    /// A convolution of another's output.
    pub(crate) fn of_maps(
        builder: &mut Builder,
        channels: usize,
        filters: usize,
        stride: usize,
    ) -> Result<Self> {
        Self::new(builder, channels, filters, stride, Input::Maps)
    }

    fn new(
        builder: &mut Builder,
        channels: usize,
        filters: usize,
        stride: usize,
        input: Input,
    ) -> Result<Self> {
        let fan_in = channels * Self::KERNEL * Self::KERNEL;
        let initialisation = builder.initialisation();
        let weight: Start = initialisation.weight(fan_in, std::f64::consts::SQRT_2);
        let shape = [filters, channels, Self::KERNEL, Self::KERNEL];
        Ok(Self {
            weight: builder.parameter("weight", &shape, weight)?,
            bias: builder.parameter("bias", &[filters], initialisation.bias(fan_in))?,
            stride,
            input,
        })
    }

    /// # Shapes
    /// - `x`: `(B, C, H, W)` u8 of pixels, or `(B, H, W, C)` f32 of maps
    /// - output: `(B, h, w, F)`, not negative
    pub(crate) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let filters = self.weight.dim(0)?;
        let (patches, weight, (batch, height, width)) = match self.input {
            Input::Pixels => {
                let (b, _, h, w) = x.dims4()?;
                // Pixel patches are channel-major, as the weight itself is.
                (patches::of_pixels(x, self.stride)?, self.weight.flatten_from(1)?.t()?, (b, h, w))
            }
            Input::Maps => {
                let (b, h, w, _) = x.dims4()?;
                let weight = self.weight.permute((2, 3, 1, 0))?.flatten_to(2)?;
                (patches::of_maps(x, self.stride)?, weight, (b, h, w))
            }
        };
        let output = bias_relu::apply(&patches.matmul(&weight)?, &self.bias)?;
        let (height, width) = (output_side(height, self.stride), output_side(width, self.stride));
        Ok(output.reshape((batch, height, width, filters))?)
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{DType, Device, Var};
    use rand::Rng;

    use super::*;
    use crate::nn::Initialisation;
    use crate::params::Parameters;
    use crate::rng::stream;

    fn layer(input: Input, channels: usize, stride: usize) -> (Parameters, Convolution) {
        let (mut parameters, mut rng) = (Parameters::default(), stream(1, "init"));
        let mut builder =
            Builder::create(&mut parameters, &mut rng, Initialisation::Uniform, &Device::Cpu);
        let layer = Convolution::new(&mut builder, channels, 5, stride, input).unwrap();
        (parameters, layer)
    }

    fn close(a: &Tensor, b: &Tensor) {
        assert_eq!(a.dims(), b.dims());
        let difference = (a - b).unwrap().abs().unwrap().flatten_all().unwrap();
        let worst = difference.max(0).unwrap().to_scalar::<f32>().unwrap();
        let scale = b.abs().unwrap().flatten_all().unwrap().max(0).unwrap();
        assert!(worst <= 1e-5 * scale.to_scalar::<f32>().unwrap().max(1e-3), "{worst}");
    }

    /// candle's own convolution is the oracle, forward and backward. (Its backward needs sides that the
    /// stride divides; the golden numbers cover the others.)
    #[test]
    fn agrees_with_candle() {
        for (input, channels, height, width, stride) in [
            (Input::Pixels, 3, 21, 23, 2),
            (Input::Pixels, 2, 7, 8, 1),
            (Input::Maps, 4, 9, 11, 1),
            (Input::Maps, 3, 11, 7, 2),
        ] {
            let (parameters, layer) = layer(input, channels, stride);
            let mut rng = stream(2, "x");
            let count = 2 * channels * height * width;
            let shape = (2, channels, height, width);
            let (x, planar) = match input {
                Input::Pixels => {
                    let pixels: Vec<u8> = (0..count).map(|_| rng.random()).collect();
                    let x = Tensor::from_vec(pixels, shape, &Device::Cpu).unwrap();
                    let planar = (x.to_dtype(DType::F32).unwrap() / 255.0).unwrap();
                    (x, planar)
                }
                Input::Maps => {
                    let maps: Vec<f32> = (0..count).map(|_| rng.random_range(-1.0..1.0)).collect();
                    let planar = Var::from_vec(maps, shape, &Device::Cpu).unwrap();
                    (planar.permute((0, 2, 3, 1)).unwrap(), planar.into_inner())
                }
            };
            let (weight, bias) =
                (parameters.get("weight").unwrap(), parameters.get("bias").unwrap());
            let expected = planar
                .conv2d(weight, 0, stride, 1, 1)
                .unwrap()
                .broadcast_add(&bias.reshape((1, 5, 1, 1)).unwrap())
                .unwrap()
                .relu()
                .unwrap();
            let got = layer.forward(&x).unwrap().permute((0, 3, 1, 2)).unwrap();
            close(&got, &expected);

            let probe = crate::rng::standard_normal(&mut rng, got.dims(), &Device::Cpu).unwrap();
            let got = (got * &probe).unwrap().sum_all().unwrap().backward().unwrap();
            let expected = (expected * &probe).unwrap().sum_all().unwrap().backward().unwrap();
            close(got.get(weight).unwrap(), expected.get(weight).unwrap());
            close(got.get(bias).unwrap(), expected.get(bias).unwrap());
            if input == Input::Maps {
                close(got.get(&planar).unwrap(), expected.get(&planar).unwrap());
            }
        }
    }
}
