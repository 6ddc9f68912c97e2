//! Encoders from images to embeddings and decoders from features to images.

use candle_core::{DType, Tensor};
use hksl_core::nn::{
    Activation, Convolution, ConvolutionShape, Initialisation, Initializer, Linear, PixelEncoder,
    PixelEncoderConfig, TransposedConvolution,
};
use hksl_core::{Builder, Encoder};
use hksl_sac::{ImageEncoder, ReceptiveField, Result};

use crate::config::{DreamerConfig, Vision};

/// Kernel sizes of the original's convolutions, all of stride 2.
const ENCODER_SIDE: usize = 4;
const DECODER_SIDES: [usize; 4] = [5, 5, 6, 6];
/// Image size of the original architecture, in pixels.
pub const ORIGINAL_SIDE: usize = 64;

/// An encoder of images.
#[derive(Debug, Clone)]
pub enum ConvEncoder {
    /// The encoder of the other methods. Parameters: those of [`PixelEncoder`].
    Shared(PixelEncoder),
    /// Four convolutions with ELU. Parameters: `layers.{0…3}`.
    Original(Vec<Convolution>),
}

impl ConvEncoder {
    /// Creates an encoder of images `(C, H, W)`.
    ///
    /// # Errors
    /// An image that is too small.
    pub fn new(
        builder: &mut Builder,
        image: [usize; 3],
        sizes: PixelEncoderConfig,
        config: &DreamerConfig,
    ) -> Result<Self> {
        if config.vision == Vision::Shared {
            return Ok(Self::Shared(PixelEncoder::new(builder, image, sizes)?));
        }
        let shapes = Self::original_shapes(image, config.vision_depth);
        let layer = |(index, shape): (usize, ConvolutionShape)| {
            let fan_in = shape.channels * ENCODER_SIDE * ENCODER_SIDE;
            let initializers = initializers(fan_in);
            let builder = &mut builder.under(format!("layers.{index}"));
            Convolution::new(builder, shape, Activation::Elu, initializers)
        };
        let layers = shapes.into_iter().enumerate().map(layer);
        Ok(Self::Original(layers.collect::<hksl_core::Result<_>>()?))
    }

    fn original_shapes(
        [channels, height, width]: [usize; 3],
        depth: usize,
    ) -> Vec<ConvolutionShape> {
        let (mut input_size, mut channels) = ((height, width), channels);
        let mut shapes = Vec::new();
        for filters in [depth, 2 * depth, 4 * depth, 8 * depth] {
            let shape =
                ConvolutionShape { input_size, channels, filters, side: ENCODER_SIDE, stride: 2 };
            (input_size, channels) = (shape.output_size(), filters);
            shapes.push(shape);
        }
        shapes
    }

    /// Embedding dimensions, `E`.
    pub fn embedding(
        image: [usize; 3],
        sizes: PixelEncoderConfig,
        config: &DreamerConfig,
    ) -> usize {
        match config.vision {
            Vision::Shared => sizes.latent_dims,
            Vision::Original => {
                let last = Self::original_shapes(image, config.vision_depth).pop();
                last.map_or(0, |shape| {
                    shape.output_size().0 * shape.output_size().1 * shape.filters
                })
            }
        }
    }

    fn maps(&self, images: &Tensor) -> hksl_core::Result<Tensor> {
        let Self::Original(layers) = self else { return Ok(images.clone()) };
        let pixels = images.permute((0, 2, 3, 1))?.contiguous()?.to_dtype(DType::F32)?;
        let mut maps = pixels.affine(1.0 / 255.0, -0.5)?;
        for layer in layers {
            maps = layer.forward(&maps)?;
        }
        Ok(maps)
    }
}

impl Encoder for ConvEncoder {
    /// Encodes images.
    ///
    /// # Shapes
    /// - `images`: `(N, C, H, W)` u8
    /// - output: `(N, E)`
    fn forward(&self, images: &Tensor) -> hksl_core::Result<Tensor> {
        match self {
            Self::Shared(encoder) => encoder.forward(images),
            // Flattened channels first, as in PyTorch.
            Self::Original(_) => {
                Ok(self.maps(images)?.permute((0, 3, 1, 2))?.contiguous()?.flatten_from(1)?)
            }
        }
    }
}

impl ImageEncoder for ConvEncoder {
    fn attention(&self, images: &Tensor) -> Result<(Tensor, ReceptiveField)> {
        let layers = match self {
            Self::Shared(encoder) => return encoder.attention(images),
            Self::Original(layers) => layers,
        };
        let maps = self.maps(images)?.permute((0, 3, 1, 2))?.contiguous()?;
        // Receptive field: a layer of stride 2 and kernel size k maps a field of f to 2 f + k − 2.
        let side = layers.iter().fold(1, |side, _| 2 * side + ENCODER_SIDE - 2);
        Ok((maps, ReceptiveField { side, spacing: 1 << layers.len() }))
    }
}

/// A decoder of features, which predicts the mean of every pixel.
///
/// Parameters: `start`, `layers.{0…3}`.
#[derive(Debug)]
pub struct ConvDecoder {
    start: Linear,
    start_activation: Activation,
    /// Rows, columns and channels of the first feature map.
    first: (usize, usize, usize),
    layers: Vec<TransposedConvolution>,
}

impl ConvDecoder {
    /// Creates a decoder of features with `inputs` dimensions to images `(C, H, W)`.
    ///
    /// # Errors
    /// An image that is too small.
    pub fn new(
        builder: &mut Builder,
        inputs: usize,
        image: [usize; 3],
        sizes: PixelEncoderConfig,
        config: &DreamerConfig,
    ) -> Result<Self> {
        let (shapes, between) = Self::shapes(image, sizes, config)?;
        let (rows, columns) = shapes[0].output_size();
        let first = (rows, columns, shapes[0].filters);
        let start = Linear::new(&mut builder.under("start"), inputs, rows * columns * first.2)?;
        let count = shapes.len();
        let layer = |(index, shape): (usize, ConvolutionShape)| {
            let last = index + 1 == count;
            let activation = if last { Activation::None } else { between };
            // PyTorch computes the fan-in of a transposed convolution from its output channels.
            let initializers = initializers(shape.channels * shape.side * shape.side);
            let builder = &mut builder.under(format!("layers.{index}"));
            TransposedConvolution::new(builder, shape, activation, initializers)
        };
        let layers = shapes.into_iter().enumerate().map(layer);
        Ok(Self {
            start,
            start_activation: match config.vision {
                Vision::Shared => Activation::Relu,
                Vision::Original => Activation::None,
            },
            first,
            layers: layers.collect::<hksl_core::Result<_>>()?,
        })
    }

    /// The shapes of the layers in order, and the activation between them.
    fn shapes(
        image: [usize; 3],
        sizes: PixelEncoderConfig,
        config: &DreamerConfig,
    ) -> hksl_core::Result<(Vec<ConvolutionShape>, Activation)> {
        let [channels, height, width] = image;
        let mut shapes = Vec::new();
        if config.vision == Vision::Shared {
            let (mut rows, mut columns) = PixelEncoder::map_size(height, width)?;
            let filters = sizes.filters;
            for _ in 0..3 {
                (rows, columns) = (rows + 2, columns + 2);
                let input_size = (rows, columns);
                shapes.push(ConvolutionShape {
                    input_size,
                    channels: filters,
                    filters,
                    side: 3,
                    stride: 1,
                });
            }
            let input_size = (height, width);
            shapes.push(ConvolutionShape { input_size, channels, filters, side: 3, stride: 2 });
            return Ok((shapes, Activation::Relu));
        }
        let depth = config.vision_depth;
        let (mut rows, mut filters) = (1, 32 * depth);
        for (side, channels) in
            DECODER_SIDES.into_iter().zip([4 * depth, 2 * depth, depth, channels])
        {
            rows = 2 * (rows - 1) + side;
            shapes.push(ConvolutionShape {
                input_size: (rows, rows),
                channels,
                filters,
                side,
                stride: 2,
            });
            filters = channels;
        }
        Ok((shapes, Activation::Elu))
    }

    /// Decodes features.
    ///
    /// # Shapes
    /// - `features`: `(N, inputs)`
    /// - output: `(N, H, W, C)`, means of pixels scaled to [−½, ½]
    ///
    /// # Errors
    /// Features of another size.
    pub fn forward(&self, features: &Tensor) -> Result<Tensor> {
        let (rows, columns, channels) = self.first;
        let start = self.start.forward_then(features, self.start_activation)?;
        let mut maps = start.reshape(((), rows, columns, channels))?;
        for layer in &self.layers {
            maps = layer.forward(&maps)?;
        }
        Ok(maps)
    }
}

fn initializers(fan_in: usize) -> (Initializer, Initializer) {
    (Initialisation::Uniform.weight(fan_in, 1.0), Initialisation::Uniform.bias(fan_in))
}
