//! What a hierarchy asks of an encoder.

use candle_core::Tensor;

use crate::Result;

/// A map from observations to latents; bring your own, or take [`crate::nn::PixelEncoder`].
///
/// Rows must not depend on each other: several batches may come as one. Calls may run at the same time.
pub trait Encoder: Send + Sync {
    /// # Shapes
    /// - `observations`: `(B, …)`, in the form that the trajectories have
    /// - output: `(B, Z)`
    fn forward(&self, observations: &Tensor) -> Result<Tensor>;
}
