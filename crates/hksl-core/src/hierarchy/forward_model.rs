//! The recurrent cell that predicts the next latent.

use candle_core::Tensor;

use crate::Result;
use crate::nn::Linear;
use crate::nn::gates::{blended, gated};
use crate::params::Builder;

/// A gated cell with one pathway for actions and one for the context from above (HKSL appendix, "HKSL's Forward Models").
///
/// Each pathway with input `v` (the level's actions ā, or the context c) computes
///
/// ```text
/// u = σ(U [v; z])     r = σ(R [v; z])
/// actions: ĥ = tanh(H [r ⊙ z; ā])     context: ĥ = tanh(H [r ⊙ c; z])
/// g = (1 − u) ⊙ z + u ⊙ ĥ
/// ```
///
/// and the output is the mean of both pathways' `g`, or the actions' alone where there is no context.
#[derive(Debug, Clone)]
pub struct ForwardModel {
    action: Gates,
    context: Option<Gates>,
}

#[derive(Debug, Clone)]
struct Gates {
    update: Linear,
    reset: Linear,
    candidate: Linear,
}

impl Gates {
    fn new(builder: &mut Builder, pathway: &str, inputs: usize, latent: usize) -> Result<Self> {
        let mut linear = |gate: &str| {
            Linear::new(&mut builder.under(format_args!("{gate}_{pathway}")), inputs, latent)
        };
        let (update, reset) = (linear("update")?, linear("reset")?);
        Ok(Self { update, reset, candidate: linear("candidate")? })
    }

    /// `(1 − u) ⊙ z + u ⊙ ĥ`, where `candidate_input` makes the input of ĥ from the reset gate before σ.
    fn blend(
        &self,
        latent: &Tensor,
        input: &Tensor,
        candidate_input: impl Fn(&Tensor) -> Result<Tensor>,
    ) -> Result<Tensor> {
        let joined = Tensor::cat(&[input, latent], 1)?;
        let reset = self.reset.forward(&joined)?;
        let candidate = self.candidate.forward(&candidate_input(&reset)?)?;
        Ok(blended(&self.update.forward(&joined)?, &candidate, latent)?)
    }
}

impl ForwardModel {
    /// A cell for latents of `latent_dims` and `action_dims` numbers of action in each step: `n·A` where it skips `n`
    /// transitions.
    pub fn new(
        builder: &mut Builder,
        latent_dims: usize,
        action_dims: usize,
        has_context: bool,
    ) -> Result<Self> {
        let action = Gates::new(builder, "action", action_dims + latent_dims, latent_dims)?;
        let context = has_context
            .then(|| Gates::new(builder, "context", 2 * latent_dims, latent_dims))
            .transpose()?;
        Ok(Self { action, context })
    }

    /// # Shapes
    /// - `latent`: `(B, Z)`
    /// - `actions`: `(B, n·A)`, those of all transitions that the step skips
    /// - `context`: `(B, Z)`; without effect on a cell that was made without gates for it
    /// - output: `(B, Z)`
    pub fn forward(
        &self,
        latent: &Tensor,
        actions: &Tensor,
        context: Option<&Tensor>,
    ) -> Result<Tensor> {
        let by_action = self.action.blend(latent, actions, |reset| {
            Ok(Tensor::cat(&[&gated(reset, latent)?, actions], 1)?)
        })?;
        let (Some(gates), Some(context)) = (&self.context, context) else {
            return Ok(by_action);
        };
        let by_context = gates.blend(latent, context, |reset| {
            Ok(Tensor::cat(&[&gated(reset, context)?, latent], 1)?)
        })?;
        Ok(((by_action + by_context)? * 0.5)?)
    }
}
