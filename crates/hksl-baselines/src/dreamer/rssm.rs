//! The recurrent state-space model.

use candle_core::{D, DType, Device, Tensor};
use hksl_core::Builder;
use hksl_core::nn::{Activation, LayerNorm, Linear};
use hksl_sac::Result;

use super::categorical::sample;
use crate::config::DreamerConfig;

/// A state of the model: what is certain of the past, and what was drawn of the present.
#[derive(Debug, Clone)]
pub struct State {
    /// One-hot vectors side by side, `(N, V·K)`.
    pub stochastic: Tensor,
    /// `(N, D)`.
    pub deterministic: Tensor,
}

impl State {
    /// Both side by side, `(N, V·K + D)`: what heads, actor and critic read.
    pub fn feature(&self) -> Result<Tensor> {
        Ok(Tensor::cat(&[&self.stochastic, &self.deterministic], D::Minus1)?)
    }
}

/// Deterministic state by a gated recurrent unit, stochastic state of `V` variables with `K` classes (DreamerV2 §2.2).
///
/// Parameters: `input`, `gru`, `gru_norm`, `prior_hidden`, `prior`, `posterior_hidden`, `posterior`.
#[derive(Debug)]
pub struct Rssm {
    input: Linear,
    gru: Linear,
    gru_norm: LayerNorm,
    prior_hidden: Linear,
    prior: Linear,
    posterior_hidden: Linear,
    posterior: Linear,
    deterministic: usize,
    variables: usize,
    classes: usize,
}

impl Rssm {
    /// Keras's ε.
    const EPSILON: f64 = 1e-3;

    /// A model of embeddings of `embedding` numbers and actions of `action_dims`.
    ///
    /// # Errors
    /// Names that exist already.
    pub fn new(
        builder: &mut Builder,
        embedding: usize,
        action_dims: usize,
        config: &DreamerConfig,
    ) -> Result<Self> {
        let DreamerConfig {
            deterministic_units: size,
            hidden_units: hidden,
            variables,
            classes,
            ..
        } = *config;
        let flat = variables * classes;
        let mut linear = |name: &str, inputs: usize, outputs: usize| {
            Linear::new(&mut builder.under(name), inputs, outputs)
        };
        Ok(Self {
            input: linear("input", flat + action_dims, hidden)?,
            gru: linear("gru", hidden + size, 3 * size)?,
            prior_hidden: linear("prior_hidden", size, hidden)?,
            prior: linear("prior", hidden, flat)?,
            posterior_hidden: linear("posterior_hidden", size + embedding, hidden)?,
            posterior: linear("posterior", hidden, flat)?,
            gru_norm: LayerNorm::with_epsilon(
                &mut builder.under("gru_norm"),
                3 * size,
                Self::EPSILON,
            )?,
            deterministic: size,
            variables,
            classes,
        })
    }

    /// The state before anything was seen, `count` times.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn start(&self, count: usize, device: &Device) -> Result<State> {
        let zeros = |size: usize| Tensor::zeros((count, size), DType::F32, device);
        let stochastic = zeros(self.variables * self.classes)?;
        Ok(State { stochastic, deterministic: zeros(self.deterministic)? })
    }

    /// The deterministic state after an action, `(N, D)`.
    ///
    /// # Shapes
    /// - `action`: `(N, A)`
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn advance(&self, state: &State, action: &Tensor) -> Result<Tensor> {
        let State { stochastic, deterministic } = state;
        let x = Tensor::cat(&[stochastic, action], D::Minus1)?;
        let x = self.input.forward_then(&x, Activation::Elu)?;
        let parts = self.gru.forward(&Tensor::cat(&[&x, deterministic], D::Minus1)?)?;
        let parts = self.gru_norm.forward(&parts)?.chunk(3, D::Minus1)?;
        let reset = sigmoid(&parts[0])?;
        let candidate = (reset * &parts[1])?.tanh()?;
        let update = sigmoid(&(&parts[2] - 1.0)?)?;
        Ok((deterministic + (update * (candidate - deterministic)?)?)?)
    }

    /// Logits of the stochastic state before the observation, `(N, V, K)`.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn prior(&self, deterministic: &Tensor) -> Result<Tensor> {
        let hidden = self.prior_hidden.forward_then(deterministic, Activation::Elu)?;
        self.by_variable(&self.prior.forward(&hidden)?)
    }

    /// Logits of the stochastic state after the observation, `(N, V, K)`.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn posterior(&self, deterministic: &Tensor, embedding: &Tensor) -> Result<Tensor> {
        let x = Tensor::cat(&[deterministic, embedding], D::Minus1)?;
        let hidden = self.posterior_hidden.forward_then(&x, Activation::Elu)?;
        self.by_variable(&self.posterior.forward(&hidden)?)
    }

    /// A state whose stochastic part is drawn from these logits by `uniform`, `(N, V)`.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn draw(&self, deterministic: Tensor, logits: &Tensor, uniform: &Tensor) -> Result<State> {
        Ok(State { stochastic: sample(logits, uniform)?.flatten_from(1)?, deterministic })
    }

    fn by_variable(&self, logits: &Tensor) -> Result<Tensor> {
        Ok(logits.reshape(((), self.variables, self.classes))?)
    }
}

/// `(1 + tanh(x/2)) / 2`, which does not overflow.
fn sigmoid(x: &Tensor) -> Result<Tensor> {
    Ok((x * 0.5)?.tanh()?.affine(0.5, 0.5)?)
}
