//! The paper's pixel encoder.

use candle_core::{DType, Tensor};
use serde::{Deserialize, Serialize};

use crate::error::at_least_one;
use crate::hierarchy::Encoder;
use crate::kernels::{KERNEL, output_side};
use crate::nn::EncoderHead;
use crate::nn::convolution_stack::ConvolutionStack;
use crate::params::Builder;
use crate::{Error, Result};

/// Sizes of a [`PixelEncoder`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelEncoderConfig {
    /// Filters of each of the four convolutions (paper: 32).
    pub filters: usize,
    /// Latent dimensions, `Z` (paper: 50).
    pub latent_dims: usize,
}

/// Four 3×3 convolutions (strides 2, 1, 1, 1, no padding, ReLU), a linear layer and layer normalisation (HKSL appendix,
/// after SAC-AE).
///
/// Parameters: `convs.{0…3}.{weight, bias}`, `linear.{weight, bias}`, `norm.{weight, bias}`. The linear layer reads the
/// last feature maps flattened in the order rows, columns, filters.
#[derive(Debug, Clone)]
pub struct PixelEncoder {
    convolutions: ConvolutionStack,
    head: EncoderHead,
    image: [usize; 3],
}

impl PixelEncoder {
    const CONVOLUTIONS: usize = 4;
    const STRIDES: [usize; Self::CONVOLUTIONS] = [2, 1, 1, 1];

    /// Creates an encoder for images of shape `(C, H, W)`.
    ///
    /// # Errors
    /// [`Error::ImageTooSmall`]; [`Error::Setting`] for a size of 0.
    pub fn new(
        builder: &mut Builder,
        image: [usize; 3],
        config: PixelEncoderConfig,
    ) -> Result<Self> {
        let PixelEncoderConfig { filters, latent_dims } = config;
        at_least_one("encoder.filters", filters as u64)?;
        at_least_one("encoder.latent_dims", latent_dims as u64)?;
        let [_, height, width] = image;
        let (map_height, map_width) = Self::map_size(height, width)?;
        let convolutions = ConvolutionStack::new(
            &mut builder.under("convs"),
            image,
            filters,
            Self::STRIDES[0],
            Self::CONVOLUTIONS,
        )?;
        let head = EncoderHead::new(builder, filters * map_height * map_width, latent_dims)?;
        Ok(Self { convolutions, head, image })
    }

    /// Number of features that [`Self::features`] returns for an image of this shape.
    ///
    /// # Errors
    /// [`Error::ImageTooSmall`].
    pub fn feature_count(image: [usize; 3], config: PixelEncoderConfig) -> Result<usize> {
        let (rows, columns) = Self::map_size(image[1], image[2])?;
        Ok(config.filters * rows * columns)
    }

    /// Rows and columns of the last feature map for an image of this size.
    ///
    /// ```
    /// use hksl_core::nn::PixelEncoder;
    ///
    /// assert_eq!(PixelEncoder::map_size(84, 84)?, (35, 35));
    /// assert_eq!(PixelEncoder::map_size(35, 15)?, (11, 1));
    /// assert!(PixelEncoder::map_size(35, 14).is_err());
    /// # Ok::<(), hksl_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::ImageTooSmall`] if no pixel would be left.
    pub fn map_size(height: usize, width: usize) -> Result<(usize, usize)> {
        let side = |side: usize| {
            Self::STRIDES
                .into_iter()
                .try_fold(side, |side, stride| (side >= KERNEL).then(|| output_side(side, stride)))
        };
        side(height).zip(side(width)).ok_or(Error::ImageTooSmall {
            height,
            width,
            convolutions: Self::CONVOLUTIONS,
            minimum: Self::minimum_side(),
        })
    }

    /// The receptive field of an element of the last feature map: side of the square and distance between the squares of
    /// neighbouring elements, in pixels.
    ///
    /// ```
    /// assert_eq!(hksl_core::nn::PixelEncoder::map_field(), (15, 2));
    /// ```
    pub fn map_field() -> (usize, usize) {
        (Self::minimum_side(), Self::STRIDES.into_iter().product())
    }

    /// The smallest side of an image that leaves one pixel at the end.
    fn minimum_side() -> usize {
        let before = |side: usize, stride: usize| (side - 1) * stride + KERNEL;
        Self::STRIDES.into_iter().rev().fold(1, before)
    }

    /// Output of the last convolution, after ReLU.
    ///
    /// # Shapes
    /// - `images`: `(B, C, H, W)` u8
    /// - output: `(B, F, h, w)`
    pub fn feature_maps(&self, images: &Tensor) -> Result<Tensor> {
        let maps = self.convolutions.forward(&self.checked(images)?)?;
        Ok(maps.permute((0, 3, 1, 2))?.contiguous()?)
    }

    /// Output of the last convolution, as the linear map reads it: what another head may stand on.
    ///
    /// # Shapes
    /// - `images`: `(B, C, H, W)` u8
    /// - output: `(B, h·w·F)`
    pub fn features(&self, images: &Tensor) -> Result<Tensor> {
        Ok(self.convolutions.forward(&self.checked(images)?)?.flatten_from(1)?)
    }

    /// What follows the convolutions.
    pub fn head(&self) -> &EncoderHead {
        &self.head
    }

    /// The images, if they are such as this encoder reads.
    fn checked(&self, images: &Tensor) -> Result<Tensor> {
        let dims = images.dims();
        if dims.len() != 4 || dims[1..] != self.image || images.dtype() != DType::U8 {
            let [c, h, w] = self.image;
            return Err(Error::Shape {
                what: "observation",
                got: dims.to_vec(),
                expected: format!("(B, {c}, {h}, {w}) of u8, and it is {:?}", images.dtype()),
            });
        }
        Ok(images.contiguous()?)
    }
}

impl Encoder for PixelEncoder {
    /// Encodes observations.
    ///
    /// # Shapes
    /// - `observations`: `(B, C, H, W)` u8
    /// - output: `(B, Z)`
    fn forward(&self, observations: &Tensor) -> Result<Tensor> {
        let images = self.checked(observations)?;
        let EncoderHead { linear, norm } = &self.head;
        norm.forward(&self.convolutions.forward_linear(&images, linear)?)
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::*;
    use crate::nn::Initialisation;
    use crate::params::Parameters;
    use crate::rng::stream;

    const PAPER: PixelEncoderConfig = PixelEncoderConfig { filters: 32, latent_dims: 50 };

    #[test]
    fn has_the_papers_parameter_count() {
        let (mut parameters, mut rng) = (Parameters::default(), stream(1, "init"));
        let mut builder =
            Builder::create(&mut parameters, &mut rng, Initialisation::Uniform, &Device::Cpu);
        PixelEncoder::new(&mut builder, [9, 84, 84], PAPER).unwrap();
        assert_eq!(parameters.elements(), 1_990_518);
    }

    #[test]
    fn reports_the_minimal_image_size() {
        let message = PixelEncoder::map_size(14, 84).unwrap_err().to_string();
        assert!(message.contains("14×84") && message.contains("15×15"), "{message}");
        assert_eq!(PixelEncoder::map_size(15, 15).unwrap(), (1, 1));
    }

    #[test]
    fn rejects_another_shape_or_type() {
        let (mut parameters, mut rng) = (Parameters::default(), stream(1, "init"));
        let mut builder =
            Builder::create(&mut parameters, &mut rng, Initialisation::Orthogonal, &Device::Cpu);
        let config = PixelEncoderConfig { filters: 2, latent_dims: 3 };
        let encoder = PixelEncoder::new(&mut builder, [3, 16, 16], config).unwrap();
        let images = Tensor::zeros((2, 3, 16, 16), DType::U8, &Device::Cpu).unwrap();
        assert_eq!(encoder.forward(&images).unwrap().dims(), [2, 3]);
        assert_eq!(encoder.feature_maps(&images).unwrap().dims(), [2, 2, 1, 1]);
        let features = encoder.features(&images).unwrap();
        let count = PixelEncoder::feature_count([3, 16, 16], config).unwrap();
        assert_eq!(features.dims(), [2, count]);
        let apart = encoder.head().forward(&features).unwrap().to_vec2::<f32>().unwrap();
        assert_eq!(apart, encoder.forward(&images).unwrap().to_vec2::<f32>().unwrap());
        assert!(encoder.forward(&images.to_dtype(DType::F32).unwrap()).is_err());
        assert!(encoder.forward(&images.narrow(2, 0, 15).unwrap()).is_err());
    }
}
