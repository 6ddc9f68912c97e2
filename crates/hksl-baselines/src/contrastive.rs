//! Contrastive losses of CURL and PI-SAC.

use candle_core::{D, Tensor};
use hksl_sac::Result;

use crate::dreamer::categorical::log_softmax;

/// CURL's InfoNCE loss: the mean cross-entropy of the logits `q_iᵀ W k_j`, where key `i` is the positive of query `i` (CURL,
/// eq. 4 and its listing). Without temperature and normalisation.
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

/// The three terms of PI-SAC's CEB loss for each item, `(B, 1)`. `residual` and `smoothing` estimate the information in the
/// latent about the past that is not about the future; `predictive` estimates its information about the future.
#[derive(Debug, Clone)]
pub struct CebTerms {
    /// The KL term `ln e(z|x) − ln b(z|y0)`, which the loss minimises.
    pub residual: Tensor,
    /// The InfoNCE term `ln b(z_i|y0_i) − ln Σ_k b(z_i|y0_k) + ln B`, which the loss maximises.
    pub predictive: Tensor,
    /// The KL term `ln e(z|x) − ln b(z|y1)` for one step later, which the loss minimises.
    pub smoothing: Tensor,
}

impl CebTerms {
    /// Computes the terms from the means of Gaussians with unit variance: of the forward encoder, and of the backward
    /// encoder for both times. `latent` is a sample of the forward encoder (PI-SAC §3; conditional entropy bottleneck).
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
    /// let terms = CebTerms::new(&forward, &first, &second, &latent)?;
    /// assert!((terms.predictive.mean_all()?.to_scalar::<f32>()? - 0.451_254_45).abs() < 1e-6);
    /// assert!((terms.loss(0.01, 0.6)?.to_scalar::<f32>()? + 0.451_090_29).abs() < 1e-6);
    /// # Ok::<(), hksl_baselines::Error>(())
    /// ```
    pub fn new(
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

    /// The CEB loss `mean(β · residual − predictive + w · β · smoothing)`, where `w` is `smoothing_weight`.
    pub fn loss(&self, beta: f64, smoothing_weight: f64) -> Result<Tensor> {
        let kl = ((&self.residual + (&self.smoothing * smoothing_weight)?)? * beta)?;
        Ok((kl - &self.predictive)?.mean_all()?)
    }
}

/// `ln N(z_i; m_k, 1)` up to a constant, `(B, B)`.
fn log_densities(latents: &Tensor, means: &Tensor) -> Result<Tensor> {
    // Squared differences. The expanded square would lose precision by cancellation far from the origin.
    let differences = latents.unsqueeze(1)?.broadcast_sub(&means.unsqueeze(0)?)?;
    Ok(differences.sqr()?.sum(D::Minus1)?.affine(-0.5, 0.0)?)
}

/// The diagonal of a matrix `(B, B)` as a column `(B, 1)`.
fn diagonal(square: &Tensor) -> Result<Tensor> {
    let own = Tensor::arange(0u32, square.dim(0)? as u32, square.device())?.unsqueeze(1)?;
    Ok(square.gather(&own, 1)?)
}
