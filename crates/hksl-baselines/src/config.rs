//! What describes a method. Units, the originals' values and effects are stated beside each key in
//! `configs/default.toml`; the values are those of `configs/methods`.

use hksl_core::nn::Initialisation;
use serde::{Deserialize, Serialize};

/// Section `[baseline]`: what the methods other than HKSL have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaselineConfig {
    /// Agent steps between two updates of actor and temperature.
    pub actor_update_every: u64,
    /// How the weights of encoder, actor and critics start.
    pub initialisation: Initialisation,
}

/// Section `[drq]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrqConfig {
    /// Views of the next observation over which a target is averaged, `K`.
    pub target_views: usize,
    /// Views of the observation over which the critics' losses are summed, `M`.
    pub critic_views: usize,
}

impl DrqConfig {
    /// Plain SAC.
    pub const ONE_VIEW: Self = Self { target_views: 1, critic_views: 1 };
}

/// Section `[curl]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurlConfig {
    /// Whether the contrastive gradient moves the encoder twice, as the original's two optimisers do.
    pub double_encoder_step: bool,
}

/// Section `[pi_sac]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PiSacConfig {
    /// Adam's rate for the predictive task.
    pub learning_rate: f64,
    /// How much is compressed, β.
    pub compression: f64,
    /// Weight of the compression against the step after the predicted one.
    pub smoothing: f64,
    /// Units of each of the two hidden layers of both heads.
    pub head_units: usize,
    /// Share of the encoder that the backward encoder takes over at every step.
    pub backward_tau: f64,
    /// Steps of the predictive task alone before the actor-critic learns.
    pub pretraining_steps: u64,
}

/// Section `[dbc]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DbcConfig {
    /// What predicts the next latent.
    pub transition: Transition,
    /// Models in an ensemble.
    pub ensemble_size: usize,
    /// Units of the hidden layer of the transition and reward models.
    pub model_units: usize,
    /// Weight of the bisimulation loss.
    pub bisimulation_weight: f64,
    /// L2 penalty on the weights of the models.
    pub model_l2: f64,
}

/// What predicts the next latent in DBC.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Transition {
    /// A mean.
    Deterministic,
    /// A mean and a standard deviation.
    Probabilistic,
    /// Several such models.
    Ensemble,
}
