//! The trait of encoders.

use candle_core::Tensor;

use crate::Result;

/// An encoder from observations to latents. [`crate::nn::PixelEncoder`] is the paper's encoder.
///
/// Rows of a batch must be independent, because callers concatenate batches. Calls may run in parallel.
pub trait Encoder: Send + Sync {
    /// Encodes observations.
    ///
    /// # Shapes
    /// - `observations`: `(B, …)`, in the form of the trajectories
    /// - output: `(B, Z)`
    fn forward(&self, observations: &Tensor) -> Result<Tensor>;
}
