//! The forward model, a recurrent cell that predicts the next latent.

use candle_core::Tensor;

use crate::Result;
use crate::nn::Linear;
use crate::nn::gates::{apply_gate, gru_update};
use crate::params::Builder;

/// A gated recurrent cell with a pathway for actions and one for the context (HKSL appendix, "HKSL's Forward Models").
///
/// With the pathway's input `v`, which is the level's actions ā or the context c, each pathway computes
///
/// ```text
/// u = σ(U [v; z])     r = σ(R [v; z])
/// actions: ĥ = tanh(H [r ⊙ z; ā])     context: ĥ = tanh(H [r ⊙ c; z])
/// g = (1 − u) ⊙ z + u ⊙ ĥ
/// ```
///
/// The output is the mean of both pathways' `g`, or that of the action pathway in a cell without context.
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

    /// The GRU update `(1 − u) ⊙ z + u ⊙ ĥ`. `candidate_input` computes the input of ĥ from the reset gate's logits.
    fn blend(
        &self,
        latent: &Tensor,
        input: &Tensor,
        candidate_input: impl Fn(&Tensor) -> Result<Tensor>,
    ) -> Result<Tensor> {
        let joined = Tensor::cat(&[input, latent], 1)?;
        let reset = self.reset.forward(&joined)?;
        let candidate = self.candidate.forward(&candidate_input(&reset)?)?;
        Ok(gru_update(&self.update.forward(&joined)?, &candidate, latent)?)
    }
}

impl ForwardModel {
    /// Creates a cell for latents with `latent_dims` and `action_dims` action dimensions per step, which are `n·A` for a level
    /// with skip `n`.
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

    /// Predicts the next latent.
    ///
    /// # Shapes
    /// - `latent`: `(B, Z)`
    /// - `actions`: `(B, n·A)`, the actions of all skipped transitions
    /// - `context`: `(B, Z)`; ignored by a cell without context pathway
    /// - output: `(B, Z)`
    pub fn forward(
        &self,
        latent: &Tensor,
        actions: &Tensor,
        context: Option<&Tensor>,
    ) -> Result<Tensor> {
        let by_action = self.action.blend(latent, actions, |reset| {
            Ok(Tensor::cat(&[&apply_gate(reset, latent)?, actions], 1)?)
        })?;
        let (Some(gates), Some(context)) = (&self.context, context) else {
            return Ok(by_action);
        };
        let by_context = gates.blend(latent, context, |reset| {
            Ok(Tensor::cat(&[&apply_gate(reset, context)?, latent], 1)?)
        })?;
        Ok(((by_action + by_context)? * 0.5)?)
    }
}
