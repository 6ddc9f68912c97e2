//! The entropy temperature.

use candle_core::{Device, Tensor, Var};
use hksl_core::nn::Initializer;
use hksl_core::{Builder, Parameters};

use crate::Result;

/// The entropy temperature α = exp(log α), trained towards the target entropy −A (Haarnoja et al., arXiv 1812.05905).
///
/// Parameter: `log_alpha`, a scalar.
#[derive(Debug, Clone)]
pub struct Temperature {
    log_alpha: Tensor,
    frozen: Tensor,
    target_entropy: f64,
}

impl Temperature {
    /// Creates a temperature with the initial value `initial` for actions with `action_dims` dimensions.
    pub fn new(
        parameters: &mut Parameters,
        initial: f64,
        action_dims: usize,
        device: &Device,
    ) -> Result<Self> {
        parameters.insert("log_alpha", Var::new(initial.ln() as f32, device)?)?;
        let log_alpha = parameters.get("log_alpha").map(|var| var.as_tensor().clone());
        let log_alpha = log_alpha.ok_or(hksl_core::Error::MissingParameter("log_alpha".into()))?;
        let frozen = Builder::view(parameters, device).parameter(
            "log_alpha",
            &[],
            Initializer::Constant(0.),
        )?;
        Ok(Self { log_alpha, frozen, target_entropy: -(action_dims as f64) })
    }

    /// α, without gradient.
    pub fn alpha(&self) -> Result<Tensor> {
        Ok(self.frozen.exp()?)
    }

    /// The entropy cost `α log π` of actions, `(B, 1)`, without gradient with respect to α.
    pub fn cost(&self, log_prob: &Tensor) -> Result<Tensor> {
        Ok(log_prob.broadcast_mul(&self.alpha()?)?)
    }

    /// The temperature loss `mean( α · (−log π − H̄) )`. Its gradient reaches α alone.
    ///
    /// # Shapes
    /// - `log_prob`: `(B, 1)`
    /// - output: scalar
    pub fn loss(&self, log_prob: &Tensor) -> Result<Tensor> {
        let excess = log_prob.detach().affine(-1.0, -self.target_entropy)?.mean_all()?;
        Ok((self.log_alpha.exp()? * excess)?)
    }
}
