//! The world model and its loss.

use std::f64::consts::PI;

use candle_core::{D, Tensor};
use hksl_core::nn::{Activation, Mlp, pixel_error};
use hksl_core::{Builder, Encoder};
use hksl_sac::Result;

use super::categorical::balanced_kl_divergence;
use super::rssm::{Rssm, State};
use super::vision::{ConvDecoder, ConvEncoder};
use super::{Sequences, Sizes};

/// Encoder, recurrent state-space model, decoder and reward head (DreamerV2 §2.2).
///
/// Parameters: `encoder`, `rssm`, `decoder`, `reward`.
#[derive(Debug)]
pub struct WorldModel {
    pub(super) encoder: ConvEncoder,
    pub(super) rssm: Rssm,
    decoder: ConvDecoder,
    reward: Mlp,
    balance: f64,
    free_nats: f64,
}

/// States inferred from a batch of sequences. `N = T·B`, with time as the slower dimension.
#[derive(Debug)]
pub struct Filtered {
    /// States sampled from the posterior, one of shape `(B, …)` for each of `T` times.
    pub states: Vec<State>,
    /// Logits of the posterior, `(N, V, K)`.
    pub posterior: Tensor,
    /// Logits of the prior, `(N, V, K)`.
    pub prior: Tensor,
}

impl Filtered {
    /// All states as one batch `(N, …)`, without gradient: the start states of imagined trajectories.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn starts(&self) -> Result<State> {
        let join = |part: fn(&State) -> &Tensor| -> Result<Tensor> {
            let parts: Vec<Tensor> = self.states.iter().map(|state| part(state).detach()).collect();
            Ok(Tensor::cat(&parts, 0)?)
        };
        Ok(State {
            stochastic: join(|state| &state.stochastic)?,
            deterministic: join(|state| &state.deterministic)?,
        })
    }
}

/// The terms of the world model's loss. All are scalars.
#[derive(Debug)]
pub struct WorldLosses {
    /// Negative log-likelihood of the images, summed over pixels.
    pub image: Tensor,
    /// Negative log-likelihood of the rewards.
    pub reward: Tensor,
    /// Balanced KL divergence of posterior and prior.
    pub kl_divergence: Tensor,
}

impl WorldLosses {
    /// The sum of the terms.
    ///
    /// # Errors
    /// Whatever the tensors report.
    pub fn sum(&self) -> Result<Tensor> {
        Ok(((&self.image + &self.reward)? + &self.kl_divergence)?)
    }
}

impl WorldModel {
    pub(super) fn new(builder: &mut Builder, sizes: &Sizes) -> Result<Self> {
        let Sizes { observation, action_dims, encoder, config } = sizes;
        let embedding = ConvEncoder::embedding(*observation, *encoder, config);
        let feature = sizes.feature();
        let mut layers = vec![feature];
        layers.extend(vec![config.reward_units; config.reward_layers]);
        layers.push(1);
        Ok(Self {
            encoder: ConvEncoder::new(
                &mut builder.under("encoder"),
                *observation,
                *encoder,
                config,
            )?,
            rssm: Rssm::new(&mut builder.under("rssm"), embedding, *action_dims, config)?,
            decoder: ConvDecoder::new(
                &mut builder.under("decoder"),
                feature,
                *observation,
                *encoder,
                config,
            )?,
            reward: Mlp::with(&mut builder.under("reward"), &layers, Activation::Elu)?,
            balance: config.kl_balance,
            free_nats: config.free_nats,
        })
    }

    /// Infers the states of sequences, starting from the initial state before the first observation.
    ///
    /// # Shapes
    /// - `uniform`: `(T, B, V)`, noise for sampling the states
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn filter(&self, sequences: &Sequences, uniform: &Tensor) -> Result<Filtered> {
        let (length, batch) = (sequences.observations.dim(0)?, sequences.observations.dim(1)?);
        let embeddings = self.encoder.forward(&sequences.observations.flatten_to(1)?)?;
        let mut state = self.rssm.initial_state(batch, embeddings.device())?;
        let (mut states, mut posteriors, mut priors) = (Vec::new(), Vec::new(), Vec::new());
        for time in 0..length {
            let embedding = embeddings.narrow(0, time * batch, batch)?;
            let mut action = sequences.actions.get(time)?;
            if time == 0 {
                action = action.zeros_like()?;
            }
            let deterministic = self.rssm.advance(&state, &action)?;
            let posterior = self.rssm.posterior(&deterministic, &embedding)?;
            priors.push(self.rssm.prior(&deterministic)?);
            state = self.rssm.draw(deterministic, &posterior, &uniform.get(time)?)?;
            posteriors.push(posterior);
            states.push(state.clone());
        }
        let (posterior, prior) = (Tensor::cat(&posteriors, 0)?, Tensor::cat(&priors, 0)?);
        Ok(Filtered { states, posterior, prior })
    }

    /// The predicted mean of the images, `(N, H, W, C)`, from features `(N, …)`.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn images(&self, features: &Tensor) -> Result<Tensor> {
        self.decoder.forward(features)
    }

    /// The predicted mean of the rewards, `(N)`, from features `(N, …)`.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn rewards(&self, features: &Tensor) -> Result<Tensor> {
        Ok(self.reward.forward(features)?.squeeze(D::Minus1)?)
    }

    /// The loss of what it made of the sequences; a gradient reaches the whole model.
    ///
    /// # Errors
    /// Shapes that do not fit.
    pub fn losses(&self, sequences: &Sequences, filtered: &Filtered) -> Result<WorldLosses> {
        let features: Vec<Tensor> =
            filtered.states.iter().map(State::feature).collect::<Result<_>>()?;
        let features = Tensor::cat(&features, 0)?;
        let images = sequences.observations.flatten_to(1)?;
        let count = images.dim(0)? as f64;
        let constant = 0.5 * (2.0 * PI).ln();
        let numbers = images.elem_count() as f64 / count;
        let apart = pixel_error(&self.images(&features)?, &images)?;
        let rewards = sequences.rewards.flatten_all()?;
        let off = (self.rewards(&features)? - rewards)?.sqr()?.mean_all()?;
        let Filtered { posterior, prior, .. } = filtered;
        Ok(WorldLosses {
            image: apart.affine(0.5 / count, constant * numbers)?,
            reward: off.affine(0.5, constant)?,
            kl_divergence: balanced_kl_divergence(posterior, prior, self.balance, self.free_nats)?,
        })
    }
}
