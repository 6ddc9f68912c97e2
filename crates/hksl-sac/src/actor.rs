//! The policy: a squashed Gaussian.

use std::f64::consts::{LN_2, PI};

use candle_core::{D, Tensor};
use hksl_core::Builder;
use hksl_core::nn::Mlp;

use crate::Result;
use crate::config::SacConfig;

/// A squashed Gaussian policy: `a = tanh(mean + std · ε)`, with mean and log-std computed from the latents of all levels
/// (HKSL §4, eq. 2).
///
/// Parameters: `trunk.{0,2,4}`. The first half of the outputs is the mean, the second half the raw log-std.
#[derive(Debug, Clone)]
pub struct Actor {
    trunk: Mlp,
    log_std: (f64, f64),
}

/// An action drawn from the policy.
#[derive(Debug, Clone)]
pub struct Sampled {
    /// `(B, A)`, in the closed interval [−1, 1]: tanh rounds to ±1 in f32.
    pub action: Tensor,
    /// Its log-density, `(B, 1)`.
    pub log_prob: Tensor,
}

impl Actor {
    /// Creates a policy with `action_dims` action dimensions. `latent_dims` is the size of all latents concatenated.
    pub fn new(
        builder: &mut Builder,
        latent_dims: usize,
        action_dims: usize,
        config: &SacConfig,
    ) -> Result<Self> {
        let hidden = config.hidden_units;
        let sizes = [latent_dims, hidden, hidden, 2 * action_dims];
        let log_std = (config.log_std_minimum, config.log_std_maximum);
        Ok(Self { trunk: Mlp::new(&mut builder.under("trunk"), &sizes)?, log_std })
    }

    /// Mean and log-std of the Gaussian before squashing, each `(B, A)`. A tanh keeps the log-std within its bounds.
    pub fn distribution(&self, latents: &Tensor) -> Result<(Tensor, Tensor)> {
        let outputs = self.trunk.forward(latents)?.chunk(2, D::Minus1)?;
        let (low, high) = self.log_std;
        let half = 0.5 * (high - low);
        Ok((outputs[0].clone(), outputs[1].tanh()?.affine(half, low + half)?))
    }

    /// The deterministic action used in evaluation: the squashed mean.
    ///
    /// # Shapes
    /// - `latents`: `(B, h·Z)`
    /// - output: `(B, A)`
    pub fn mean(&self, latents: &Tensor) -> Result<Tensor> {
        Ok(self.distribution(latents)?.0.tanh()?)
    }

    /// Samples an action from standard normal noise and computes its exact log-density: the Gaussian's log-density minus
    /// `Σ ln(1 − tanh² u)`. The code computes that sum as `Σ 2 (ln 2 − u − softplus(−2u))`, which does not overflow.
    ///
    /// # Shapes
    /// - `latents`: `(B, h·Z)`
    /// - `noise`: `(B, A)`
    pub fn sample(&self, latents: &Tensor, noise: &Tensor) -> Result<Sampled> {
        let (mean, log_std) = self.distribution(latents)?;
        let unsquashed = (mean + (log_std.exp()? * noise)?)?;
        let gaussian = (noise.sqr()?.affine(-0.5, -0.5 * (2.0 * PI).ln())? - log_std)?;
        let softplus = softplus(&(&unsquashed * -2.0)?)?;
        let squashing = ((&unsquashed + softplus)?.affine(-2.0, 2.0 * LN_2))?;
        let log_prob = (gaussian - squashing)?.sum_keepdim(D::Minus1)?;
        Ok(Sampled { action: unsquashed.tanh()?, log_prob })
    }
}

/// `ln(1 + eˣ)`, computed as `max(x, 0) + ln(1 + e^−|x|)` to avoid overflow.
fn softplus(x: &Tensor) -> Result<Tensor> {
    Ok((x.relu()? + (x.abs()?.neg()?.exp()? + 1.0)?.log()?)?)
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::*;

    #[test]
    fn softplus_does_not_overflow() {
        let x = Tensor::new(&[-200f32, 0., 200.], &Device::Cpu).unwrap();
        let y = softplus(&x).unwrap().to_vec1::<f32>().unwrap();
        assert_eq!((y[0], y[2]), (0.0, 200.0));
        assert!((f64::from(y[1]) - LN_2).abs() < 1e-6);
    }
}
