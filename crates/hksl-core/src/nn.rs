//! The layers that the hierarchy is built of.

mod affine;
mod convolution_stack;
mod encoder_head;
mod init;
mod layer_norm;
mod linear;
mod mlp;
mod on_host;
mod pixel_encoder;

pub use encoder_head::EncoderHead;
pub use init::{Initialisation, Start};
pub use layer_norm::LayerNorm;
pub use linear::Linear;
pub use mlp::Mlp;
pub use pixel_encoder::{EncoderOperations, PixelEncoder, PixelEncoderConfig};
