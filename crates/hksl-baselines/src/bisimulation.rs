//! The bisimulation loss and the transition loss of DBC.

use candle_core::Tensor;
use hksl_sac::Result;

/// The smooth L1 loss of a difference `d`, elementwise: `½ d²` if `|d| < 1`, `|d| − ½` otherwise.
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_baselines::bisimulation::smooth_l1;
///
/// let differences = Tensor::new(&[-3f32, 0.5], &Device::Cpu)?;
/// assert_eq!(smooth_l1(&differences)?.to_vec1::<f32>()?, [2.5, 0.125]);
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn smooth_l1(difference: &Tensor) -> Result<Tensor> {
    // With c = min(|d|, 1), c·(|d| − c/2) equals both branches.
    let size = difference.abs()?;
    let clipped = size.minimum(&size.ones_like()?)?;
    Ok((&clipped * (&size - (&clipped * 0.5)?)?)?)
}

/// DBC's bisimulation loss `mean((d_z − (d_r + γ d_T))²)`. The distances are between the items of a batch and of its
/// permutation: `d_z` between latents, `d_r` between rewards, `d_T` between predicted next-latent distributions. As in
/// the authors' code, `d_T` is the 2-Wasserstein distance of the Gaussians in each dimension separately, without
/// gradient.
///
/// # Shapes
/// - `latents`: `(B, Z)`
/// - `rewards`: `(B, 1)`
/// - `mean`, `deviation`: `(…, B, Z)`, for one model or an ensemble
/// - `permutation`: `(B)` u32
/// - output: scalar
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_baselines::bisimulation::bisimulation_loss;
///
/// let rows = |rows: [[f32; 2]; 3]| Tensor::new(&rows, &Device::Cpu);
/// let latents = rows([[0.5, -1.], [2., 0.3], [-0.4, 0.8]])?;
/// let rewards = Tensor::new(&[[1f32], [0.], [0.5]], &Device::Cpu)?;
/// let mean = rows([[0.2, 0.1], [1.5, -0.3], [0., 0.4]])?;
/// let deviation = rows([[1., 0.5], [0.8, 0.9], [0.3, 0.2]])?;
/// let permutation = Tensor::new(&[2u32, 0, 1], &Device::Cpu)?;
/// let loss = bisimulation_loss(&latents, &rewards, (&mean, &deviation), &permutation, 0.99)?;
/// assert!((loss.to_scalar::<f32>()? - 0.413_290_52).abs() < 1e-6);
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn bisimulation_loss(
    latents: &Tensor,
    rewards: &Tensor,
    (mean, deviation): (&Tensor, &Tensor),
    permutation: &Tensor,
    discount: f64,
) -> Result<Tensor> {
    let apart = |x: &Tensor| -> Result<Tensor> {
        let batch = x.rank() - 2;
        Ok((x - x.contiguous()?.index_select(permutation, batch)?)?)
    };
    let (mean, deviation) = (mean.detach(), deviation.detach());
    // The square root has an infinite derivative at 0, at the fixed points of the permutation. No gradient reaches it,
    // because its arguments are detached.
    let successors = (apart(&mean)?.sqr()? + apart(&deviation)?.sqr()?)?.sqrt()?;
    let behaviour = (successors * discount)?.broadcast_add(&smooth_l1(&apart(rewards)?)?)?;
    let distances = smooth_l1(&apart(latents)?)?;
    Ok(distances.broadcast_sub(&behaviour)?.sqr()?.mean_all()?)
}

/// The transition loss `mean(½ ((m − z′)/σ)² + ln σ)`: the negative log-likelihood of the next latents under the predicted
/// Gaussians, up to a constant.
///
/// # Shapes
/// - `mean`, `deviation`: `(…, B, Z)`
/// - `next`: `(B, Z)`
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_baselines::bisimulation::transition_loss;
///
/// let rows = |rows: [[f32; 2]; 3]| Tensor::new(&rows, &Device::Cpu);
/// let mean = rows([[0.2, 0.1], [1.5, -0.3], [0., 0.4]])?;
/// let deviation = rows([[1., 0.5], [0.8, 0.9], [0.3, 0.2]])?;
/// let next = rows([[0.1, 0.3], [1., 0.2], [0.4, -0.1]])?;
/// let loss = transition_loss(&mean, &deviation, &next)?.to_scalar::<f32>()?;
/// assert!((loss - 0.102_243_40).abs() < 1e-6);
/// # Ok::<(), hksl_baselines::Error>(())
/// ```
pub fn transition_loss(mean: &Tensor, deviation: &Tensor, next: &Tensor) -> Result<Tensor> {
    let off = mean.broadcast_sub(next)?.div(deviation)?;
    Ok(((off.sqr()? * 0.5)? + deviation.log()?)?.mean_all()?)
}
