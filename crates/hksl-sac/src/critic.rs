//! Twin critics on one level's latents.

use candle_core::{D, Tensor};
use hksl_core::Builder;
use hksl_core::nn::Mlp;
use hksl_core::parallel::both;

use crate::Result;

/// Two independent Q-functions of one level, `Q^l` (HKSL §4).
///
/// Parameters: `q1.{0,2,4}`, `q2.{0,2,4}`.
#[derive(Debug, Clone)]
pub struct Critic {
    q1: Mlp,
    q2: Mlp,
}

impl Critic {
    /// Creates both Q-functions for latents with `latent_dims` and actions with `action_dims` dimensions.
    pub fn new(
        builder: &mut Builder,
        latent_dims: usize,
        action_dims: usize,
        hidden_units: usize,
    ) -> Result<Self> {
        let sizes = [latent_dims + action_dims, hidden_units, hidden_units, 1];
        let q1 = Mlp::new(&mut builder.under("q1"), &sizes)?;
        Ok(Self { q1, q2: Mlp::new(&mut builder.under("q2"), &sizes)? })
    }

    /// Both Q-values.
    ///
    /// # Shapes
    /// - `latent`: `(B, Z)`
    /// - `action`: `(B, A)`
    /// - output: `(B, 1)` twice
    pub fn forward(&self, latent: &Tensor, action: &Tensor) -> Result<(Tensor, Tensor)> {
        let joined = Tensor::cat(&[latent, action], D::Minus1)?;
        let device = joined.device();
        let (q1, q2) = both(device, || self.q1.forward(&joined), || self.q2.forward(&joined));
        Ok((q1?, q2?))
    }

    /// The minimum of the two Q-values, `(B, 1)`.
    pub fn min_q(&self, latent: &Tensor, action: &Tensor) -> Result<Tensor> {
        let (q1, q2) = self.forward(latent, action)?;
        Ok(q1.minimum(&q2)?)
    }

    /// The mean of the two Q-values, `(B, 1)`.
    pub fn mean(&self, latent: &Tensor, action: &Tensor) -> Result<Tensor> {
        let (q1, q2) = self.forward(latent, action)?;
        Ok(((q1 + q2)? * 0.5)?)
    }

    /// The loss `mean (Q1 − y)² + mean (Q2 − y)²` for targets `y`, `(B, 1)`, and the mean Q-value without gradient.
    pub fn loss(
        &self,
        latent: &Tensor,
        action: &Tensor,
        target: &Tensor,
    ) -> Result<(Tensor, Tensor)> {
        let (q1, q2) = self.forward(latent, action)?;
        let loss = ((&q1 - target)?.sqr()?.mean_all()? + (&q2 - target)?.sqr()?.mean_all()?)?;
        Ok((loss, ((q1 + q2)?.mean_all()? * 0.5)?.detach()))
    }
}

/// The `n`-step return `Σ_{j<n} γ^j m_j r_j + γ^n m_n v`, bootstrapped with the value `v` (HKSL §4). `m_j` is the product
/// of the first `j` not-done flags.
///
/// # Shapes
/// - `rewards`, `not_done`: `(B, k)`, `k ≥ n`
/// - `value`, output: `(B, 1)`
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_sac::critic::n_step_return;
///
/// let rewards = Tensor::new(&[[1f32, 2., 4.]], &Device::Cpu)?;
/// let value = Tensor::new(&[[8f32]], &Device::Cpu)?;
/// let alive = Tensor::new(&[[1f32, 1., 1.]], &Device::Cpu)?;
/// let dead = Tensor::new(&[[0f32, 1., 1.]], &Device::Cpu)?;
/// // 1 + 2/2 + 8/4, and the first reward alone if its transition is terminal.
/// assert_eq!(n_step_return(&rewards, &alive, &value, 2, 0.5)?.to_vec2::<f32>()?, [[4.]]);
/// assert_eq!(n_step_return(&rewards, &dead, &value, 2, 0.5)?.to_vec2::<f32>()?, [[1.]]);
/// # Ok::<(), hksl_sac::Error>(())
/// ```
pub fn n_step_return(
    rewards: &Tensor,
    not_done: &Tensor,
    value: &Tensor,
    n: usize,
    discount: f64,
) -> Result<Tensor> {
    let mut alive = value.ones_like()?;
    let mut total = value.zeros_like()?;
    let mut weight = 1.0;
    for step in 0..n {
        let reward = rewards.narrow(1, step, 1)?;
        total = (total + ((&alive * reward)? * weight)?)?;
        alive = (alive * not_done.narrow(1, step, 1)?)?;
        weight *= discount;
    }
    Ok((total + ((alive * value)? * weight)?)?)
}
