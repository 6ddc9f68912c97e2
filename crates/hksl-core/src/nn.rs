//! Neural network layers.

mod affine;
mod convolution_stack;
mod encoder_head;
pub(crate) mod gates;
mod im2col_gemm;
mod init;
mod layer_norm;
mod linear;
mod map_convolution;
mod mlp;
mod pixel_encoder;
mod pixel_error;
mod row_sum;

pub use crate::kernels::activation::Activation;
pub use encoder_head::EncoderHead;
pub use init::{Initialisation, Initializer};
pub use layer_norm::LayerNorm;
pub use linear::Linear;
pub use map_convolution::{Convolution, ConvolutionShape, TransposedConvolution};
pub use mlp::Mlp;
pub use pixel_encoder::{PixelEncoder, PixelEncoderConfig};
pub use pixel_error::pixel_error;
