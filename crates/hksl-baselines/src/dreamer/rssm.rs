//! The recurrent state-space model.

use candle_core::{D, DType, Device, Tensor};
use hksl_core::Builder;
use hksl_core::nn::{Activation, LayerNorm, Linear};
use hksl_sac::Result;

use super::categorical::sample;
use crate::config::DreamerConfig;

/// A state of the model, with a stochastic and a deterministic part.
#[derive(Debug, Clone)]
pub struct State {
    /// The one-hot vectors of the categorical variables, concatenated, `(N, V·K)`.
    pub stochastic: Tensor,
    /// The state of the recurrent unit, `(N, D)`.
    pub deterministic: Tensor,
}

impl State {
    /// Both parts concatenated, `(N, V·K + D)`: the input of decoder, reward head, actor and critic.
    pub fn feature(&self) -> Result<Tensor> {
        Ok(Tensor::cat(&[&self.stochastic, &self.deterministic], D::Minus1)?)
    }
}

/// Recurrent state-space model (DreamerV2 §2.2): the deterministic state of a GRU, and a stochastic state of `V`
/// categorical variables with `K` classes.
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
    /// ε of the layer normalisation, Keras's default.
    const EPSILON: f64 = 1e-3;

    /// Creates a model for embeddings of size `embedding` and actions with `action_dims` dimensions.
    ///
    /// # Errors
    /// Parameter names that exist already.
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

    /// The initial state for a batch of `count` sequences: all zeros.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn initial_state(&self, count: usize, device: &Device) -> Result<State> {
        let zeros = |size: usize| Tensor::zeros((count, size), DType::F32, device);
        let stochastic = zeros(self.variables * self.classes)?;
        Ok(State { stochastic, deterministic: zeros(self.deterministic)? })
    }

    /// The GRU update: the deterministic state after an action, `(N, D)`.
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

    /// Logits of the prior of the stochastic state, `(N, V, K)`.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn prior(&self, deterministic: &Tensor) -> Result<Tensor> {
        let hidden = self.prior_hidden.forward_then(deterministic, Activation::Elu)?;
        self.by_variable(&self.prior.forward(&hidden)?)
    }

    /// Logits of the posterior of the stochastic state given the observation's embedding, `(N, V, K)`.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn posterior(&self, deterministic: &Tensor, embedding: &Tensor) -> Result<Tensor> {
        let x = Tensor::cat(&[deterministic, embedding], D::Minus1)?;
        let hidden = self.posterior_hidden.forward_then(&x, Activation::Elu)?;
        self.by_variable(&self.posterior.forward(&hidden)?)
    }

    /// Samples the stochastic part from logits `(N, V, K)` with noise `uniform`, `(N, V)`.
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

/// The logistic function as `(1 + tanh(x/2)) / 2`, which does not overflow.
fn sigmoid(x: &Tensor) -> Result<Tensor> {
    Ok((x * 0.5)?.tanh()?.affine(0.5, 0.5)?)
}
