//! Losses that tell a pair from all other pairs of a batch.

use candle_core::{D, Tensor};
use hksl_sac::Result;

use crate::dreamer::categorical::log_softmax;

/// `logits_ij = q_iᵀ W k_j` and the mean cross-entropy of each row with its own index (CURL, eq. 4 and its listing; no
/// temperature, no normalisation).
///
/// # Shapes
/// - `queries`, `keys`: `(B, Z)`
/// - `bilinear`: `(Z, Z)`
/// - output: scalar
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_baselines::contrastive::bilinear_loss;
///
/// let queries = Tensor::new(&[[1f32, 0.], [0., 1.], [1., 1.]], &Device::Cpu)?;
/// let keys = Tensor::new(&[[0.9f32, 0.1], [0.2, 0.8], [0.5, 0.5]], &Device::Cpu)?;
/// let bilinear = Tensor::new(&[[0.5f32, 0.2], [0.1, 0.7]], &Device::Cpu)?;
/// let loss = bilinear_loss(&queries, &keys, &bilinear)?.to_scalar::<f32>()?;
/// assert!((loss - 0.999_276_85).abs() < 1e-6);
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn bilinear_loss(queries: &Tensor, keys: &Tensor, bilinear: &Tensor) -> Result<Tensor> {
    let logits = queries.matmul(bilinear)?.matmul(&keys.t()?.contiguous()?)?;
    Ok(diagonal(&log_softmax(&logits)?)?.mean_all()?.neg()?)
}

/// The three terms of PI-SAC's loss for each item, `(B, 1)`: what the latent says of the past beyond the future
/// (`residual`, and `smoothing` against the future one step later), and of the future (`predictive`).
#[derive(Debug, Clone)]
pub struct CebTerms {
    /// `ln e(z|x) − ln b(z|y0)`, to be small.
    pub residual: Tensor,
    /// `ln b(z_i|y0_i) − ln Σ_k b(z_i|y0_k) + ln B`, to be large.
    pub predictive: Tensor,
    /// `ln e(z|x) − ln b(z|y1)`, to be small.
    pub smoothing: Tensor,
}

impl CebTerms {
    /// From the means of Gaussians of unit variance: of the forward encoder, of the backward encoder at both times,
    /// and a latent drawn from the forward one (PI-SAC §3; the conditional entropy bottleneck).
    ///
    /// # Shapes
    /// - all: `(B, Z)`
    ///
    /// ```
    /// use candle_core::{Device, Tensor};
    /// use hksl_baselines::contrastive::CebTerms;
    ///
    /// let rows = |rows: [[f32; 2]; 3]| Tensor::new(&rows, &Device::Cpu);
    /// let forward = rows([[0.2, -0.1], [0.4, 0.3], [-0.5, 0.6]])?;
    /// let latent = (&forward + rows([[0.1, -0.2], [0.3, 0.], [-0.4, 0.2]])?)?;
    /// let first = rows([[0.25, -0.3], [0.6, 0.2], [-0.7, 0.9]])?;
    /// let second = rows([[0.1, 0.], [0.5, 0.5], [-0.2, 0.3]])?;
    /// let terms = CebTerms::of(&forward, &first, &second, &latent)?;
    /// assert!((terms.predictive.mean_all()?.to_scalar::<f32>()? - 0.451_254_45).abs() < 1e-6);
    /// assert!((terms.loss(0.01, 0.6)?.to_scalar::<f32>()? + 0.451_090_29).abs() < 1e-6);
    /// # Ok::<(), hksl_baselines::Error>(())
    /// ```
    pub fn of(
        forward: &Tensor,
        backward: &Tensor,
        backward_later: &Tensor,
        latent: &Tensor,
    ) -> Result<Self> {
        let near =
            |mean: &Tensor| (latent - mean)?.sqr()?.sum_keepdim(D::Minus1)?.affine(-0.5, 0.0);
        let (forward, own, later) = (near(forward)?, near(backward)?, near(backward_later)?);
        let count = latent.dim(0)? as f64;
        let chosen = diagonal(&log_softmax(&log_densities(latent, backward)?)?)?;
        Ok(Self {
            residual: (&forward - own)?,
            predictive: (chosen + count.ln())?,
            smoothing: (forward - later)?,
        })
    }

    /// `mean(β · residual − predictive + w · β · smoothing)`.
    pub fn loss(&self, compression: f64, smoothing: f64) -> Result<Tensor> {
        let compressed = ((&self.residual + (&self.smoothing * smoothing)?)? * compression)?;
        Ok((compressed - &self.predictive)?.mean_all()?)
    }
}

/// `ln N(z_i; m_k, 1)` but for the constant that all share, `(B, B)`.
fn log_densities(latents: &Tensor, means: &Tensor) -> Result<Tensor> {
    // Differences, not the expanded square: far from the origin that one cancels.
    let differences = latents.unsqueeze(1)?.broadcast_sub(&means.unsqueeze(0)?)?;
    Ok(differences.sqr()?.sum(D::Minus1)?.affine(-0.5, 0.0)?)
}

/// `(B, B)` → `(B, 1)`.
fn diagonal(square: &Tensor) -> Result<Tensor> {
    let own = Tensor::arange(0u32, square.dim(0)? as u32, square.device())?.unsqueeze(1)?;
    Ok(square.gather(&own, 1)?)
}
