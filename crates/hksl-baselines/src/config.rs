//! What describes a method. Units, the originals' values and effects are stated beside each key in
//! `configs/default.toml`; the values are those of `configs/methods`.

use hksl_core::nn::Initialisation;
use hksl_core::{Error, at_least_one};
use hksl_sac::Result;
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

impl BaselineConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Setting`] names the one that is out of range.
    pub fn validate(&self) -> Result<()> {
        Ok(at_least_one("baseline.actor_update_every", self.actor_update_every)?)
    }
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

/// Section `[dreamer]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DreamerConfig {
    /// What sees and draws pictures.
    pub vision: Vision,
    /// Feature maps of the first convolution of the original vision.
    pub vision_depth: usize,
    /// Sequences in a batch, `B`.
    pub batch_sequences: usize,
    /// Observations in a sequence, `T`.
    pub sequence_length: usize,
    /// Agent steps between two learning steps.
    pub train_every: u64,
    /// Learning steps before the first that goes with an agent step.
    pub pretraining_steps: u64,
    /// Numbers of the deterministic state.
    pub deterministic_units: usize,
    /// Units of the model's hidden layers.
    pub hidden_units: usize,
    /// Variables of the stochastic state.
    pub variables: usize,
    /// Classes of each.
    pub classes: usize,
    /// Hidden layers of the reward head.
    pub reward_layers: usize,
    /// Units of each.
    pub reward_units: usize,
    /// Hidden layers of actor and critic.
    pub behaviour_layers: usize,
    /// Units of each.
    pub behaviour_units: usize,
    /// Adam's rate for the world model.
    pub world_learning_rate: f64,
    /// Adam's rate for the actor.
    pub actor_learning_rate: f64,
    /// Adam's rate for the critic.
    pub critic_learning_rate: f64,
    /// Adam's ε.
    pub epsilon: f64,
    /// Largest norm of the gradient of each of the three.
    pub gradient_clip: f64,
    /// Share of every weight that a step takes away.
    pub weight_decay: f64,
    /// Share of the divergence that moves the prior.
    pub kl_balance: f64,
    /// Divergence that costs nothing, in nats.
    pub free_nats: f64,
    /// γ, per agent step.
    pub discount: f64,
    /// λ of the returns.
    pub lambda: f64,
    /// Imagined steps, `H`.
    pub horizon: usize,
    /// Weight of the policy's entropy.
    pub entropy_weight: f64,
    /// Learning steps between two copies of the critic to its target.
    pub slow_critic_every: u64,
}

impl DreamerConfig {
    /// Checks what would make no agent, or one that never learns.
    ///
    /// # Errors
    /// [`Error::Setting`] names the first value that is out of range, and the range.
    pub fn validate(&self) -> Result<()> {
        for (name, value) in [
            ("dreamer.batch_sequences", self.batch_sequences as u64),
            ("dreamer.train_every", self.train_every),
            ("dreamer.deterministic_units", self.deterministic_units as u64),
            ("dreamer.hidden_units", self.hidden_units as u64),
            ("dreamer.variables", self.variables as u64),
            ("dreamer.reward_units", self.reward_units as u64),
            ("dreamer.behaviour_units", self.behaviour_units as u64),
            ("dreamer.horizon", self.horizon as u64),
            ("dreamer.slow_critic_every", self.slow_critic_every),
        ] {
            at_least_one(name, value)?;
        }
        for (name, value) in
            [("dreamer.sequence_length", self.sequence_length), ("dreamer.classes", self.classes)]
        {
            if value < 2 {
                return Err(Error::setting(name, value, "must be at least 2").into());
            }
        }
        Ok(())
    }
}

/// What sees and draws pictures in DreamerV2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Vision {
    /// The encoder of all other methods, and its mirror.
    Shared,
    /// The original's convolutions of 4×4, and its decoder.
    Original,
}
